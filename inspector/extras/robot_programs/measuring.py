"""The program that measures the poses of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calib.extras.robot_programs.measuring_program import measuring_program, program_files
from calib.planning.plan import Plan
from inspector.cli.additions import PlanAddition
from inspector.cli.options.fits import PlanOptions
from inspector.extras.robot_programs.options import PlanProgramOptions


class MeasuringProgram(PlanAddition[PlanProgramOptions, PlanOptions]):
    """The program of `plan --program`."""

    def begin(self) -> None:
        """Refuse a name that is none of a program."""
        self.outputs()

    def outputs(self) -> tuple[Path, ...]:
        """The program's files."""
        return () if self.asked.program is None else program_files(self.asked.program)

    def files(self, plan: Plan) -> Mapping[Path, str]:
        """The program's files."""
        return {} if self.asked.program is None else measuring_program(self.asked.program, plan)
