"""A robot program that is corrected in place of joint targets."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.errors import CalibError
from calib.extras.robot_programs.measuring_program import require_joints
from calib.extras.robot_programs.program_blocks import program_correction_blocks, program_correction_document
from calib.extras.robot_programs.program_correction import corrected_program, require_no_conditions
from calib.extras.robot_programs.program_targets import Program, frame_given, load_program, require_frames
from calib.kinematics.robot import Robot
from calib.models.fitted_model import FittedModel
from calib.rendering.blocks import Block
from calib.rendering.text import block_text
from inspector.cli.additions import CorrectAddition
from inspector.cli.dataset_commands import show
from inspector.cli.options.fits import CorrectOptions
from inspector.extras.robot_programs.options import CorrectProgramOptions


class CorrectedProgram(CorrectAddition[CorrectProgramOptions, CorrectOptions]):
    """The program of `correct --program`."""

    def begin(self) -> None:
        """Refuse frames and further files without a program."""
        asked = self.asked
        given = {"--tool-frame": asked.tool_frame, "--work-frame": asked.work_frame, "--with": asked.others}
        for option in [option for option, value in given.items() if value and asked.program is None]:
            raise CalibError(f"{option} goes with --program; joint targets have no frames")

    def inputs(self) -> Iterable[Path | None]:
        """The program and its further files."""
        return [self.asked.program, *self.asked.others]

    def corrected(self, dataset: Dataset) -> Callable[[FittedModel], int] | None:
        """Writer of the program, once its robot, frames and output are seen to fit."""
        path, out = self.asked.program, self.command.out
        assert path is not None  # see `begin`
        program = load_program(path, self.asked.others)
        require_joints(path, program.language, dataset.robot.is_revolute.tolist())
        if out.suffix.lower() != path.suffix.lower():
            raise CalibError(f"--out {out}: a corrected program has the suffix of its own, {path.suffix}")
        tool = frame_given(program.language, "--tool-frame", self.asked.tool_frame)
        work = frame_given(program.language, "--work-frame", self.asked.work_frame)
        require_frames(program, tool, work)

        def write(model: FittedModel) -> int:
            require_no_conditions(program, model.needs, model.model.family_names)
            result = corrected_program(program, dataset.robot, model, kind=self.command.what, tool=tool, work=work)
            write_bytes_atomically(out, result.content)
            show(self.command, program_correction_document(result), block_text(*program_correction_blocks(result)))
            return 0 if result.reached else 1

        return write


def read_program(path: Path, robot: Robot) -> Program:
    """A robot program that a page brought, for an arm that its language can move."""
    program = load_program(path)
    require_joints(path, program.language, robot.is_revolute.tolist())
    require_frames(program, None, None)
    return program


def correct_program(program: Program, robot: Robot, model: FittedModel) -> tuple[bytes, list[Block]]:
    """The program corrected by a model, and what is told of it. Raises CalibError."""
    require_no_conditions(program, model.needs, model.model.family_names)
    result = corrected_program(program, robot, model)
    return result.content, program_correction_blocks(result)
