"""The command `validate --model`, and what commands share that use a saved model without fitting."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.files.folder import usual_residual_of
from calib.errors import CalibError
from calib.models.model_file import load_model
from calib.options import DEFAULT_FOLDS
from calib.rendering.text import block_text
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options.fits import CorrectOptions, ValidateOptions


def validate_model(options: ValidateOptions, path: Path) -> int:
    """Print the errors of a saved model at a dataset's points, training and test poses apart."""
    from calib.present.fit.validation import (  # no other command here needs these
        saved_model_blocks,
        saved_model_document,
    )

    refuse_fit_options(options)
    dataset = load(options.path, finder=options.finder)
    model = load_model(path, options.effects_file)
    model.require_same_arm(dataset)
    dataset = measured(dataset)
    before, after = model.before_and_after(dataset)
    text = block_text(*saved_model_blocks(model, dataset, before, after))
    show(options, saved_model_document(model, dataset, before, after), text)
    return 0


def refuse_fit_options(options: ValidateOptions | CorrectOptions) -> None:
    """Raise CalibError for options of a fit, which do not apply to a saved model."""
    given: dict[str, object] = {
        "--residual": options.residual != usual_residual_of(options.path),
        "--effect": options.effect,
        "--hold": options.hold,
        "--tolerance": options.tolerance,
        "--no-prior": options.no_prior,
        "--robust": options.robust,
        "--leave-out": options.leave_out,
        "--new-setup": options.new_setup,
    }
    if isinstance(options, CorrectOptions):
        given["--add"] = options.add
    else:
        given["--folds"] = options.folds != DEFAULT_FOLDS
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(f"--model: the model is used as it was fitted; leave out {used[0]}")
