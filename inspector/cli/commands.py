"""The commands: core's own, and behind them those of plug-ins, each in its place. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TypeVar

from calib.plugins import load
from inspector import plugins
from inspector.cli.options.declaration import arguments_of, spelling
from inspector.plugins import Command, CommandOptions, PipExtra

Declared = TypeVar("Declared", Command, CommandOptions)

_OPTIONS = "inspector.cli.options"

CORE = (
    Command("serve", f"{_OPTIONS}.datasets:ServeOptions", "inspector.cli.dataset_commands:run_serve"),
    Command("corners", f"{_OPTIONS}.datasets:CornersOptions", "inspector.cli.dataset_commands:run_corners"),
    Command("redundancy", f"{_OPTIONS}.datasets:RedundancyOptions", "inspector.cli.dataset_commands:run_redundancy"),
    Command("calibrate", f"{_OPTIONS}.fits:CalibrateOptions", "inspector.cli.calibrate_command:run_calibrate"),
    Command("validate", f"{_OPTIONS}.fits:ValidateOptions", "inspector.cli.fit_commands:run_validate"),
    Command("correct", f"{_OPTIONS}.fits:CorrectOptions", "inspector.cli.correct_command:run_correct"),
    Command("diagnose", f"{_OPTIONS}.fits:DiagnoseOptions", "inspector.cli.fit_commands:run_diagnose"),
    Command("compare", f"{_OPTIONS}.fits:CompareOptions", "inspector.cli.compare_command:run_compare"),
    Command("repeat", f"{_OPTIONS}.fits:RepeatOptions", "inspector.cli.compare_command:run_repeat"),
    Command("plan", f"{_OPTIONS}.fits:PlanOptions", "inspector.cli.planning.plan_command:run_plan"),
    Command("report", f"{_OPTIONS}.fits:ReportOptions", "inspector.cli.fit_commands:run_report"),
    Command("effects", f"{_OPTIONS}.datasets:EffectsOptions", "inspector.cli.dataset_commands:run_effects"),
    Command("sample", f"{_OPTIONS}.datasets:SampleOptions", "inspector.cli.robots.sample_command:run_sample"),
    Command("simulate", f"{_OPTIONS}.datasets:SimulateOptions", "inspector.cli.robots.simulate_command:run_simulate"),
    Command("check", f"{_OPTIONS}.fits:CheckOptions", "inspector.cli.fit_commands:run_check"),
    Command("convert", f"{_OPTIONS}.datasets:ConvertOptions", "inspector.cli.robots.convert_command:run_convert"),
    Command("where", f"{_OPTIONS}.datasets:WhereOptions", "inspector.cli.robots.convert_command:run_where"),
    Command("import", f"{_OPTIONS}.datasets:ImportOptions", "inspector.cli.robots.import_command:run_import"),
)

PIP_EXTRAS = (
    PipExtra("scans", ("open3d", "trimesh")),
    PipExtra("page", ("viser", "websockets", "plotly", "PIL")),
)

EXTRA_OF = {
    "pool": "fleet",
    "watch": "watch",
    "follow": "follow",
    "jig": "printed_parts",
    "fleet": "fleet",
    "mcp": "mcp",
    "--program": "robot_programs",
    "--type": "fleet",
    "--hand-eye-out": "camera",
    "--images": "camera",
    "--marker-poses": "camera",
}
"""The extra that brings each command or option which is not core's, for who asks where it is not there."""


def commands() -> dict[str, Command]:
    """All commands that are there by their names, in the order of `inspector --help`."""
    found = list(CORE)
    for brought in _readable(Command)[0]:
        names = [command.name for command in found]
        found.insert(names.index(brought.after) + 1 if brought.after in names else len(found), brought)
    return {command.name: command for command in found}


def additions(command: Command) -> tuple[CommandOptions, ...]:
    """Options that plug-ins add to a command."""
    return tuple(added for added in _readable(CommandOptions)[0] if added.command == command.name)


def left_out() -> tuple[str, ...]:
    """A line for each plug-in, command and group of options that could not be imported; all else works without it."""
    return (*plugins.left_out(), *_readable(Command)[1], *_readable(CommandOptions)[1])


@cache
def _readable(kind: type[Declared]) -> tuple[tuple[Declared, ...], tuple[str, ...]]:
    """Contributions whose options can be imported, and a line for each of the others."""
    readable, lines = [], []
    for brought in plugins.contributions(kind):
        try:
            load(brought.options)
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            lines.append(f"options {brought.options} cannot be imported and are left out: {reason}")
        else:
            readable.append(brought)
    return tuple(readable), tuple(lines)


def lacking(words: Sequence[str]) -> str:
    """Why a command line cannot run for the want of one of this project's extras; "" where none is missing."""
    asked = [word for at, word in enumerate(words) if word in EXTRA_OF and (at == 0 or word.startswith("--"))]
    added = arguments_of(*(load(each.options) for each in _readable(CommandOptions)[0]))
    there = {*commands(), *map(spelling, added)}
    missing = next((word for word in asked if word not in there), "")
    if not missing:
        return ""
    return (
        f"{missing} is of the extra {EXTRA_OF[missing]}, which is not here; "
        "a whole installation of robot-calibration-inspector has it"
    )


def declarations(command: Command) -> tuple[type, ...]:
    """The options of a command, its own first, then those that plug-ins add."""
    return tuple(load(place) for place in (command.options, *(added.options for added in additions(command))))


def pip_extra_of(module: str) -> str:
    """Extra of pyproject.toml that brings a package; "" where none does."""
    return next(
        (extra.name for extra in (*PIP_EXTRAS, *plugins.contributions(PipExtra)) if module in extra.modules), ""
    )
