"""The command `correct`: corrected joint targets, or a corrected robot program, by a fit or a saved model."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial

from calib.compensation.program_correction import corrected_program, require_no_conditions
from calib.compensation.target_files import Targets, corrected_file, load_targets, require_conditions
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_bytes_atomically, write_text_atomically
from calib.errors import CalibError, visible
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model
from calib.present.fit.calibration import tool_shift_sentence
from calib.present.moves.correction import correction_blocks, correction_document
from calib.present.moves.program_correction import program_correction_blocks, program_correction_document
from calib.rendering.text import block_text
from calib.robot_formats.program_targets import Frames, Program, frames_given, load_program, require_frames
from calib.robot_formats.programs import is_point_list, require_joints, require_point_list
from inspector.cli.calibrate_command import fitted, require_plausible
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.model_commands import refuse_fit_options
from inspector.cli.options.fits import CorrectOptions
from inspector.cli.output_paths import check_outputs


def run_correct(options: CorrectOptions) -> int:
    """Write targets that bring the real arm to the positions intended for the nominal arm."""
    if options.model is not None:
        refuse_fit_options(options)
    dataset = load(options.path, options.leave_out, options.finder)
    check_outputs(
        dataset, [options.out], [options.joints, options.program, *options.others, options.effects_file, options.model]
    )
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
    return write(result.fitted_model)


def _correct(options: CorrectOptions, dataset: Dataset) -> Callable[[FittedModel], int]:
    """The targets as they were read, to be corrected by a model."""
    if options.program is not None:
        return partial(_write_program, options, dataset, _program(options, dataset))
    for option, given in (*_frames(options), ("--with", options.others)):
        if given:
            raise CalibError(f"{option} goes with --program; joint targets have no frames")
    assert options.joints is not None  # one of the two is required
    if is_point_list(options.out):
        require_point_list(options.out, dataset.robot.is_revolute.tolist())
    return partial(_write_targets, options, dataset, load_targets(options.joints, dataset.robot))


def _write_targets(options: CorrectOptions, dataset: Dataset, targets: Targets, model: FittedModel) -> int:
    ids = targets.poses.ids
    require_conditions(targets, model.needs, model.model.family_names)
    correction = model.correct(targets.poses.q, targets.poses, options.what, dataset.robot, ids)
    write_text_atomically(options.out, corrected_file(options.out, targets, correction))
    show(options, correction_document(correction, ids), block_text(*correction_blocks(correction, ids)))
    return 0 if correction.reached.all() else 1


def _program(options: CorrectOptions, dataset: Dataset) -> Program:
    """The program, once its robot, frames and output are seen to fit."""
    assert options.program is not None
    program = load_program(options.program, options.others)
    require_joints(options.program, program.language, dataset.robot.is_revolute.tolist())
    if options.out.suffix.lower() != options.program.suffix.lower():
        raise CalibError(
            f"--out {options.out}: a corrected program has the suffix of its own, {options.program.suffix}"
        )
    require_frames(program, *_given(options, program))
    return program


def _frames(options: CorrectOptions) -> tuple[tuple[str, Sequence[str]], tuple[str, Sequence[str]]]:
    return ("--tool-frame", options.tool_frame), ("--work-frame", options.work_frame)


def _given(options: CorrectOptions, program: Program) -> tuple[Frames, Frames]:
    tools, works = (frames_given(program.language, option, texts) for option, texts in _frames(options))
    return tools, works


def _write_program(options: CorrectOptions, dataset: Dataset, program: Program, model: FittedModel) -> int:
    require_no_conditions(program, model.needs, model.model.family_names)
    tool, work = _given(options, program)
    trained = dataset.poses.q
    result = corrected_program(program, dataset.robot, model, trained, kind=options.what, tool=tool, work=work)
    write_bytes_atomically(options.out, result.content)
    show(options, program_correction_document(result), block_text(*program_correction_blocks(result)))
    return 0 if result.reached else 1
