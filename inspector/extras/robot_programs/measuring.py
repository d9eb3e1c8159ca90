"""The program that measures the poses of a plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from calib.errors import CalibError
from calib.extras.robot_programs.measuring_options import MeasuringOptions
from calib.extras.robot_programs.measuring_program import check_program, program_files
from calib.planning.plan import Plan
from inspector.cli.additions import PlanAddition
from inspector.cli.options.planning import PlanOptions
from inspector.extras.robot_programs.options import PlanProgramOptions
from inspector.extras.robot_programs.planned_program import planned_program


class MeasuringProgram(PlanAddition[PlanProgramOptions, PlanOptions]):
    """The program of `plan --program`."""

    def begin(self) -> None:
        """Refuse what the program's language cannot do."""
        asked = self.asked
        if asked.program is None:
            alone = next(name for name, value in vars(asked).items() if value is not None)
            raise CalibError(f"--{alone.replace('_', '-')} is of a measuring program; give --program FILE with it")
        check_program(asked.program, _measuring(asked))
        places = [path.resolve() for path in (self.command.out, *self.outputs()) if path is not None]
        again = [path for path in places if places.count(path) > 1]
        if again:
            raise CalibError(f"{again[0]}: is to be written twice; name a file for each")

    def outputs(self) -> Iterable[Path | None]:
        """The program's files."""
        return () if self.asked.program is None else program_files(self.asked.program)

    def files(self, plan: Plan) -> Mapping[Path, str]:
        """The program's files."""
        assert self.asked.program is not None  # see `begin`
        return planned_program(self.asked.program, plan, _measuring(self.asked))


def _measuring(asked: PlanProgramOptions) -> MeasuringOptions:
    given = {name: value for name, value in vars(asked).items() if value is not None and name != "program"}
    return replace(MeasuringOptions(), **given)
