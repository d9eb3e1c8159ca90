"""Programs that measure planned poses: move to each, wait until the arm has settled, trigger, and record the joints.

Each language has a text template in `templates/` (Jinja2). Every move is a joint move that ends at rest, as the ways
between poses were checked for collisions that way. Sources: Universal Robots, *The URScript Programming
Language* (`movej`, `is_steady`, sockets, `popup`); KUKA, *KSS System Software, Operating and Programming Instructions
for System Integrators* (`PTP`, `$VEL_AXIS`, `PULSE`, `WAIT FOR`, `$AXIS_ACT`, values of a data list that outlive the
run); ABB, *Technical reference manual, RAPID Instructions, Functions and Data types* (`MoveAbsJ`, `WaitTime \\InPos`,
`PulseDO`, `WaitDI`, `CJointT`, `Open`, `Write`, strings of 80 characters at most).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from calib.array_types import BoolArray
from calib.errors import CalibError
from calib.extras.robot_programs.measuring_options import MeasuringOptions
from calib.extras.robot_programs.program_templates import (
    TemplatePose,
    identifiers,
    plain_line,
    quoted,
    rendered,
    require_joints,
    template_pose,
)
from calib.robot_formats.joint_targets import MeasuringStep


@dataclass(frozen=True)
class _Controller:
    """What a controller's language can do."""

    language: str
    templates: tuple[str, ...]  # further ones are of files that stand beside the program
    longest: int  # name, characters; URScript tells no limit
    usual: float  # speed
    fastest: float
    unit: str  # of speeds
    outputs: tuple[int, int] | None  # least and greatest number of digital signals; None where they have names


_CONTROLLERS = {
    ".script": _Controller(
        "URScript", ("measure.script",), 32, 15.0, 180.0, "deg/s of the leading joint", outputs=(0, 7)
    ),
    ".src": _Controller(
        "KRL", ("measure.src", "measure.dat"), 24, 10.0, 100.0, "% of each axis's own top speed", outputs=(1, 8192)
    ),
    ".mod": _Controller("RAPID", ("measure.mod",), 32, 100.0, 7000.0, "mm/s of the tool", outputs=None),
}
_KEPT_FREE = (
    "measure_here", "joints", "answer", "joints_file", "recorded", "instrument", "slow", "axis_number", "label",
)  # fmt: skip
_SIGNAL = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,252}[A-Za-z0-9])?")


def program_files(path: Path) -> tuple[Path, ...]:
    """Files of a program: its own, and those that come with it."""
    controller = _CONTROLLERS.get(path.suffix.lower())
    return path, *(path.with_suffix(Path(name).suffix) for name in (controller.templates[1:] if controller else ()))


def check_program(path: Path, options: MeasuringOptions) -> None:
    """Raise CalibError for a program whose language is not known, or cannot do what the options ask for."""
    wrong = _wrong(path, options)
    if wrong:
        raise CalibError(f"{path}: {wrong}")


def _wrong(path: Path, options: MeasuringOptions) -> str:
    """What a language cannot do of what is asked for; "" where it can."""
    suffix = path.suffix.lower()
    if suffix not in _CONTROLLERS:
        return (
            "a measuring program is written as .script (URScript), .src (KRL, with its .dat) or .mod (RAPID); "
            "for another controller write the poses as .csv"
        )
    can, trigger, measured, speed = _CONTROLLERS[suffix], options.trigger, options.measured, options.speed
    (name,) = identifiers([path.stem], can.longest)
    if name != path.stem:
        return f"a program of {can.language} cannot be called {path.stem!r}; {name}{suffix} will do"
    if suffix == ".src" and trigger.kind == "socket":
        return "KRL itself has no sockets; trigger by output:NUMBER"
    if measured.kind == "reply" and trigger.kind != "socket":
        return "--measured reply is read from the socket of --trigger socket:HOST:PORT; give both"
    for option, signal in (("--trigger output", trigger.signal), ("--measured input", measured.signal)):
        if signal and can.outputs is None and not _SIGNAL.fullmatch(signal):
            return f"{option}:{signal}: signals of {can.language} have names, such as doMeasure"
        if signal and can.outputs is not None and not _is_whole(signal, *can.outputs):
            least, most = can.outputs
            return f"{option}:{signal}: signals of {can.language} have numbers, {least} to {most}"
    if trigger.kind == "socket" and not _HOST.fullmatch(trigger.host):
        return f"--trigger socket: {trigger.host!r} is no host's name or address"
    if speed is not None and speed > can.fastest:
        return f"--speed {speed:g} is in {can.unit}, {can.fastest:g} at most"
    if suffix == ".src" and speed is not None and (speed < 1.0 or speed % 1.0):
        return f"--speed {speed:g} is in {can.unit}, a whole number from 1"
    tool = options.tool_name
    if tool and suffix == ".script":
        return "the tool and load of URScript are those of the installation; leave out --tool-name"
    if tool and suffix == ".src" and not _is_whole(tool, 1, 128):
        return f"--tool-name {tool}: tools of KRL have numbers, from 1"
    if tool and suffix == ".mod" and not _SIGNAL.fullmatch(tool):
        return f"--tool-name {tool}: tools of RAPID have names, such as tool0"
    return ""


def _is_whole(text: str, least: int, most: int) -> bool:
    return text.isdecimal() and least <= int(text) <= most


def measuring_program(
    path: Path,
    steps: Sequence[MeasuringStep],
    is_revolute: BoolArray,
    heading: Sequence[str],
    options: MeasuringOptions,
) -> dict[Path, str]:
    """Files of a program that measures poses in their order, by the language of the path's suffix.

    Args:
        path: file of the program; for KRL the data list of the same name comes with it.
        steps: poses in the order of measuring, with their ways.
        is_revolute: (n,) which joints turn.
        heading: first lines, as comments; the settings follow them.
        options: how it moves, waits and triggers.

    Raises:
        CalibError: a language or arm that does not fit.
    """
    check_program(path, options)
    can = _CONTROLLERS[path.suffix.lower()]
    require_joints(path, can.language, is_revolute.tolist(), "; write the poses as .csv")
    targets = [target for step in steps for target in (*step.way, step.target)]
    free = [path.stem, f"run_{path.stem}", *_KEPT_FREE]
    whole, *names = identifiers([*free, *(target.name for target in targets)], can.longest)
    named = iter(names[len(free) - 1 :])
    points: list[TemplatePose] = []
    for number, step in enumerate(steps, 1):
        way = tuple(template_pose(next(named), target, is_revolute) for target in step.way)
        pose = template_pose(next(named), step.target, is_revolute)
        points += [*way, replace(pose, number=number, way=way, ask=quoted(step.ask))]
    speed = can.usual if options.speed is None else options.speed
    values = asdict(options) | {
        "program": whole,
        "heading": [plain_line(line) for line in (*heading, *_settings(options, f"{speed:g} {can.unit}"))],
        "points": points,
        "poses": [point for point in points if point.number],
        "speed": speed,
    }
    return {file: rendered(name, values) for file, name in zip(program_files(path), can.templates, strict=True)}


def _settings(options: MeasuringOptions, speed: str) -> list[str]:
    """Lines with the settings of a program, as its head tells them."""
    trigger, measured = options.trigger, options.measured
    told = {
        "none": "none",
        "output": f"output {trigger.signal}, a pulse of {options.pulse_s:g} s",
        "socket": f"a line to {trigger.host}:{trigger.port}",
        "time": f"for {options.stand_s:g} s",
        "input": f"until input {measured.signal} is high, as long as that takes",
        "reply": "until a line comes back, as long as that takes",
    }
    tool = f"; tool {options.tool_name}" if options.tool_name else ""
    return [
        f"Speed {speed}{tool}.",
        f"At each pose: {options.settle_s:g} s to settle; trigger: {told[trigger.kind]}; then at rest "
        f"{told[measured.kind]}.",
    ]
