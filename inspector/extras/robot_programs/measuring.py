"""The program that measures the poses of a plan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError
from calib.extras.robot_programs.measuring_program import (
    Measured,
    MeasuringOptions,
    ProgramTemplate,
    Trigger,
    program_files,
    shipped_template,
)
from calib.planning.plan import Plan
from inspector.cli.additions import PlanAddition
from inspector.cli.options.planning import PlanOptions
from inspector.extras.robot_programs.options import PlanProgramOptions
from inspector.extras.robot_programs.planned_program import check_plan_program, planned_program


class MeasuringProgram(PlanAddition[PlanProgramOptions, PlanOptions]):
    """The program of `plan --program`."""

    template: ProgramTemplate | None = None  # a user's own

    def begin(self) -> None:
        """Read the user's template; the shipped one is written where it is asked for."""
        asked = self.asked
        if asked.program is None:
            chosen = {
                "--template": asked.template, "--template-out": asked.template_out, "--speed": asked.speed,
                "--settle-s": asked.settle_s, "--stand-s": asked.stand_s, "--trigger": asked.trigger,
                "--pulse-s": asked.pulse_s, "--measured": asked.measured, "--tool-name": asked.tool_name,
            }  # fmt: skip
            alone = next(name for name, value in chosen.items() if value is not None)
            raise CalibError(f"{alone} is of a measuring program; give --program FILE with it")
        self.template = check_plan_program(asked.program, _measuring(asked), asked.template)
        places = [path.resolve() for path in (self.command.out, *self.outputs()) if path is not None]
        again = [path for path in places if places.count(path) > 1]
        if again:
            raise CalibError(f"{again[0]}: is to be written twice; name a file for each")
        if asked.template is not None and asked.template.resolve() in places:
            raise CalibError(f"{asked.template}: is what this command reads, which would be lost; name another file")
        if asked.template_out is not None:
            write_text_atomically(asked.template_out, shipped_template(asked.program))

    def inputs(self) -> Iterable[Path | None]:
        """The user's template."""
        return [self.asked.template]

    def outputs(self) -> Iterable[Path | None]:
        """The program's files, and the template."""
        program = () if self.asked.program is None else program_files(self.asked.program)
        return [*program, self.asked.template_out]

    def files(self, plan: Plan) -> Mapping[Path, str]:
        """The program's files."""
        assert self.asked.program is not None  # see `begin`
        return planned_program(self.asked.program, plan, _measuring(self.asked), self.template)


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
