"""The command `correct`: corrected joint targets by a fit or a saved model."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

from calib.compensation.target_files import Targets, corrected_table, load_targets, require_conditions
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError, visible
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model
from calib.present.fit.calibration import tool_shift_sentence
from calib.present.plans.correction import correction_blocks, correction_document
from calib.rendering.text import block_text
from inspector.cli.calibrate_command import fitted, require_plausible
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.model_commands import refuse_fit_options
from inspector.cli.options.fits import CorrectOptions
from inspector.cli.output_paths import check_outputs


def run_correct(options: CorrectOptions) -> int:
    """Write targets that bring the real arm to the positions intended for the nominal arm."""
    if options.model is not None:
        refuse_fit_options(options)
    dataset = load(options.path, options, options.finder)
    further = [path for added in options.added for path in added.inputs()]
    check_outputs(dataset, [options.out], [options.joints, *further, options.effects_file, options.model])
    if options.model is not None:
        model = load_model(options.model, options.effects_file)
        model.require_same_arm(dataset)
        return _correct(options, dataset)(model)
    write = _correct(options, dataset)  # what is wrong with the targets is told before the fit
    dataset = measured(dataset, options.residual)
    result = fitted(options, dataset)[-1].calibration
    require_plausible(result, options.force)
    if result.tool_shift is not None:
        print(visible(f"inspector: warning: {tool_shift_sentence(result.tool_shift)}"), file=sys.stderr)
    return write(FittedModel.of(result.calibration))


def _correct(options: CorrectOptions, dataset: Dataset) -> Callable[[FittedModel], int]:
    """Writer of the targets, which were read, as a model corrects them."""
    for added in options.added:
        if (write := added.corrected(dataset)) is not None:
            return write
    assert options.joints is not None  # required where nothing else is corrected
    if options.out.suffix.lower() != ".csv":
        raise CalibError(
            f"--out {options.out}: corrected targets are written as .csv; a program is corrected by --program"
        )
    return partial(_write_targets, options, dataset, load_targets(options.joints, dataset.robot))


def _write_targets(options: CorrectOptions, dataset: Dataset, targets: Targets, model: FittedModel) -> int:
    ids = targets.poses.ids
    require_conditions(targets, model.needs, model.model.family_names)
    correction = model.correct(targets.poses.q, targets.poses, options.what, dataset.robot, ids)
    write_text_atomically(options.out, corrected_table(targets, correction))
    show(options, correction_document(correction, ids), block_text(*correction_blocks(correction, ids)))
    return 0 if correction.reached.all() else 1
