"""The commands `validate --model` and `correct --model`, which use a saved model without fitting."""

from __future__ import annotations

from pathlib import Path

from calib.compensation.target_files import corrected_file, load_targets, require_conditions
from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError
from calib.models.model_file import load_model
from calib.options import DEFAULT_FOLDS
from calib.present.correction import correction_blocks, correction_document
from calib.rendering.text import block_text
from calib.robot_formats.programs import is_point_list, require_point_list
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options import CorrectOptions, ValidateOptions
from inspector.cli.output_paths import check_outputs


def validate_model(options: ValidateOptions, path: Path) -> int:
    """Print the errors of a saved model at a dataset's points, training and test poses apart."""
    from calib.present.validation import saved_model_blocks, saved_model_document  # no other command here needs these

    _refuse_fit_options(options)
    dataset = load(options.path, finder=options.finder)
    model = load_model(path, options.effects_file)
    model.require_same_arm(dataset)
    dataset = measured(dataset)
    before, after = model.before_and_after(dataset)
    text = block_text(*saved_model_blocks(model, dataset, before, after))
    show(options, saved_model_document(model, dataset, before, after), text)
    return 0


def correct_by_model(options: CorrectOptions, path: Path) -> int:
    """Print targets corrected by a saved model; the dataset needs no measurements."""
    _refuse_fit_options(options)
    dataset = load(options.path, finder=options.finder)
    check_outputs(dataset, [options.out], [options.joints, options.effects_file, path])
    model = load_model(path, options.effects_file)
    model.require_same_arm(dataset)
    if is_point_list(options.out):
        require_point_list(options.out, dataset.robot.is_revolute.tolist())
    targets = load_targets(options.joints, dataset.robot)
    require_conditions(targets, model.needs, model.model.family_names)
    correction = model.correct(targets.poses.q, targets.poses, options.what, dataset.robot, targets.poses.ids)
    write_text_atomically(options.out, corrected_file(options.out, targets, correction))
    ids = targets.poses.ids
    show(options, correction_document(correction, ids), block_text(*correction_blocks(correction, ids)))
    return 0 if correction.reached.all() else 1


def _refuse_fit_options(options: ValidateOptions | CorrectOptions) -> None:
    """Raise CalibError for options of a fit, which do not apply to a saved model."""
    given: dict[str, object] = {
        "--residual": options.residual != "position",
        "--effect": options.effect,
        "--hold": options.hold,
        "--tolerance": options.tolerance,
        "--no-prior": options.no_prior,
        "--robust": options.robust,
        "--leave-out": options.leave_out,
    }
    if isinstance(options, CorrectOptions):
        given["--add"] = options.add
    else:
        given["--folds"] = options.folds != DEFAULT_FOLDS
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(f"--model: the model is used as it was fitted; leave out {used[0]}")
