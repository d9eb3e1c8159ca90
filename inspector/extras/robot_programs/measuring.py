"""The program that measures the poses of a plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from calib.errors import CalibError
from calib.extras.robot_programs.measuring_program import (
    Measured,
    MeasuringOptions,
    Trigger,
    check_program,
    program_files,
)
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
    usual = MeasuringOptions()
    match asked.trigger:
        case ("output", signal):
            trigger = Trigger("output", signal)
        case ("socket", host, port):
            trigger = Trigger("socket", host=host, port=int(port))
        case _:
            trigger = Trigger()
    match asked.measured:
        case ("input", signal):
            done = Measured("input", signal)
        case ("reply",):
            done = Measured("reply")
        case _:
            done = Measured()
    return MeasuringOptions(
        speed=asked.speed,
        settle_s=usual.settle_s if asked.settle_s is None else asked.settle_s,
        stand_s=usual.stand_s if asked.stand_s is None else asked.stand_s,
        trigger=trigger,
        pulse_s=usual.pulse_s if asked.pulse_s is None else asked.pulse_s,
        measured=done,
        tool=asked.tool_name or "",
    )
