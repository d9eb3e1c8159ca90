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
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal

import numpy as np
from jinja2 import Environment, StrictUndefined

from calib.array_types import BoolArray
from calib.errors import CalibError
from calib.extras.robot_programs.point_lists import identifiers, plain_line, require_joints
from calib.robot_formats.joint_targets import JointTarget, MeasuringStep

TEMPLATES = {".script": ("measure.script",), ".src": ("measure.src", "measure.dat"), ".mod": ("measure.mod",)}
"""Templates by the suffix of a program; further ones are of files that stand beside it."""
LANGUAGES = {".script": "URScript", ".src": "KRL", ".mod": "RAPID"}
LONGEST = {".script": 32, ".src": 24, ".mod": 32}  # characters of a name; URScript tells no limit
SPEEDS = {
    ".script": (15.0, 180.0, "deg/s of the leading joint"),
    ".src": (10.0, 100.0, "% of each axis's own top speed"),
    ".mod": (100.0, 7000.0, "mm/s of the tool"),
}  # usual and highest, with the unit
SETTLE_S, STAND_S, PULSE_S = 1.0, 3.0, 0.2
_KEPT_FREE = (
    "measure_here", "joints", "answer", "joints_file", "recorded", "instrument", "slow", "axis_number", "label",
)  # fmt: skip
_OUTPUTS = {".script": (0, 7), ".src": (1, 8192)}  # numbers of a controller's digital signals
_SIGNAL = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,252}[A-Za-z0-9])?")


@dataclass(frozen=True)
class Trigger:
    """What tells the instrument to measure: nothing, a pulse of a digital output, or a line sent to a socket."""

    kind: Literal["none", "output", "socket"] = "none"
    signal: str = ""  # number or name of the output
    host: str = ""
    port: int = 0


@dataclass(frozen=True)
class Measured:
    """What the arm waits for before it moves on: some seconds, a digital input, or a line as reply on the socket."""

    kind: Literal["time", "input", "reply"] = "time"
    signal: str = ""  # number or name of the input


@dataclass(frozen=True)
class MeasuringOptions:
    """How a measuring program moves, waits and triggers."""

    speed: float | None = None  # in the unit of the language (`SPEEDS`); None: its usual one
    settle_s: float = SETTLE_S  # at rest before the trigger
    stand_s: float = STAND_S  # after the trigger, where nothing tells that it is measured
    trigger: Trigger = Trigger()
    pulse_s: float = PULSE_S  # length of the pulse of an output
    measured: Measured = Measured()
    tool: str = ""  # tool whose load counts: number (KRL) or name (RAPID); "" leaves the controller's


@dataclass(frozen=True)
class TemplatePoint:
    """A joint target as a template sees it."""

    name: str  # valid in every language
    label: str  # the user's name for it, printable ASCII without quotes and backslashes
    rad: tuple[float, ...]  # joint values as commanded, rad, of prismatic joints mm
    deg: tuple[float, ...]  # the same in degrees, of prismatic joints mm


@dataclass(frozen=True)
class TemplatePose(TemplatePoint):
    """A pose to measure as a template sees it."""

    number: int  # from 1, in the order of measuring
    way: tuple[TemplatePoint, ...]
    ask: str


def program_files(path: Path) -> tuple[Path, ...]:
    """Files of a program: its own, and those that come with it."""
    suffix = path.suffix.lower()
    return path, *(path.with_suffix(Path(name).suffix) for name in TEMPLATES.get(suffix, ())[1:])


def _template(name: str) -> str:
    return (files("calib.extras.robot_programs") / "templates" / name).read_text(encoding="utf-8")


def check_program(path: Path, options: MeasuringOptions) -> None:
    """Raise CalibError for a program whose language is not known, or cannot do what the options ask for."""
    suffix = path.suffix.lower()
    if suffix not in TEMPLATES:
        raise CalibError(
            f"{path}: a measuring program is written as .script (URScript), .src (KRL, with its .dat) or .mod (RAPID); "
            "for another controller write the poses as .csv"
        )
    language = LANGUAGES[suffix]
    if identifiers([path.stem], LONGEST[suffix])[0] != path.stem:
        name = identifiers([path.stem], LONGEST[suffix])[0]
        raise CalibError(f"{path}: a program of {language} cannot be called {path.stem!r}; {name}{suffix} will do")
    if suffix == ".src" and options.trigger.kind == "socket":
        raise CalibError(f"{path}: KRL itself has no sockets; trigger by output:NUMBER")
    if options.measured.kind == "reply" and options.trigger.kind != "socket":
        raise CalibError(f"{path}: --measured reply is read from the socket of --trigger socket:HOST:PORT; give both")
    for option, signal in (("--trigger output", options.trigger.signal), ("--measured input", options.measured.signal)):
        if signal and suffix in _OUTPUTS:
            low, high = _OUTPUTS[suffix]
            if not signal.isdecimal() or not low <= int(signal) <= high:
                raise CalibError(f"{path}: {option}:{signal}: signals of {language} have numbers, {low} to {high}")
        elif signal and not _SIGNAL.fullmatch(signal):
            raise CalibError(f"{path}: {option}:{signal}: signals of {language} have names, such as doMeasure")
    if options.trigger.kind == "socket" and not _HOST.fullmatch(options.trigger.host):
        raise CalibError(f"{path}: --trigger socket: {options.trigger.host!r} is no host's name or address")
    _, most, unit = SPEEDS[suffix]
    if options.speed is not None and options.speed > most:
        raise CalibError(f"{path}: --speed {options.speed:g} is in {unit}, {most:g} at most")
    if suffix == ".src" and options.speed is not None and (options.speed < 1.0 or options.speed % 1.0):
        raise CalibError(f"{path}: --speed {options.speed:g} is in {unit}, a whole number from 1")
    if options.tool and suffix == ".script":
        raise CalibError(f"{path}: the tool and load of URScript are those of the installation; leave out --tool-name")
    if options.tool and suffix == ".src" and not (options.tool.isdecimal() and 1 <= int(options.tool) <= 128):
        raise CalibError(f"{path}: --tool-name {options.tool}: tools of KRL have numbers, from 1")
    if options.tool and suffix == ".mod" and not _SIGNAL.fullmatch(options.tool):
        raise CalibError(f"{path}: --tool-name {options.tool}: tools of RAPID have names, such as tool0")


def measuring_program(
    path: Path,
    steps: Sequence[MeasuringStep],
    is_revolute: BoolArray,
    heading: Sequence[str],
    options: MeasuringOptions | None = None,
) -> dict[Path, str]:
    """Files of a program that measures poses in their order, by the language of the path's suffix.

    Args:
        path: file of the program; for KRL the data list of the same name comes with it.
        steps: poses in the order of measuring, with their ways.
        is_revolute: (n,) which joints turn.
        heading: first lines, as comments; the settings follow them.
        options: how it moves, waits and triggers; None: the usual ones, without a trigger.

    Raises:
        CalibError: a language or arm that does not fit.
    """
    options = options or MeasuringOptions()
    suffix = path.suffix.lower()
    check_program(path, options)
    require_joints(path, LANGUAGES[suffix], is_revolute.tolist(), "; write the poses as .csv")
    values = _values(path, steps, is_revolute, heading, options)
    templates = zip(program_files(path), TEMPLATES[suffix], strict=True)
    return {file: _ENVIRONMENT.from_string(_template(name)).render(values) for file, name in templates}


def _values(
    path: Path,
    steps: Sequence[MeasuringStep],
    is_revolute: BoolArray,
    heading: Sequence[str],
    options: MeasuringOptions,
) -> dict[str, object]:
    """Values of the templates' placeholders."""
    suffix = path.suffix.lower()
    targets = [target for step in steps for target in (*step.way, step.target)]
    free = [path.stem, f"run_{path.stem}", *_KEPT_FREE]
    whole, *names = identifiers([*free, *(target.name for target in targets)], LONGEST[suffix])
    named = iter(names[len(free) - 1 :])
    poses: list[TemplatePose] = []
    points: list[TemplatePoint] = []
    for number, step in enumerate(steps, 1):
        way = tuple(_point(next(named), target, is_revolute) for target in step.way)
        at = _point(next(named), step.target, is_revolute)
        poses.append(TemplatePose(at.name, at.label, at.rad, at.deg, number, way, quoted(step.ask)))
        points += [*way, poses[-1]]
    usual, _, unit = SPEEDS[suffix]
    speed = usual if options.speed is None else options.speed
    return {
        "program": whole,
        "heading": tuple(plain_line(line) for line in (*heading, *_settings(options, speed, unit))),
        "points": tuple(points),
        "poses": tuple(poses),
        "speed": speed,
        "settle_s": options.settle_s,
        "stand_s": options.stand_s,
        "trigger": options.trigger,
        "pulse_s": options.pulse_s,
        "measured": options.measured,
        "tool": options.tool,
    }


def _settings(options: MeasuringOptions, speed: float, unit: str) -> list[str]:
    """Lines with the settings of a program, as its head tells them."""
    trigger, measured = options.trigger, options.measured
    by = {
        "none": "none",
        "output": f"output {trigger.signal}, a pulse of {options.pulse_s:g} s",
        "socket": f"a line to {trigger.host}:{trigger.port}",
    }[trigger.kind]
    until = {
        "time": f"for {options.stand_s:g} s",
        "input": f"until input {measured.signal} is high, as long as that takes",
        "reply": "until a line comes back, as long as that takes",
    }[measured.kind]
    tool = f"; tool {options.tool}" if options.tool else ""
    return [
        f"Speed {speed:g} {unit}{tool}.",
        f"At each pose: {options.settle_s:g} s to settle; trigger: {by}; then at rest {until}.",
    ]


def _point(name: str, target: JointTarget, is_revolute: BoolArray) -> TemplatePoint:
    rad = tuple(map(float, target.q))
    deg = tuple(map(float, np.where(is_revolute, np.degrees(target.q), target.q)))
    return TemplatePoint(name, quoted(target.name)[:_LONGEST_LABEL], rad, deg)


_LONGEST_LABEL = 40  # characters, as a string of RAPID holds 80, and the recorded joints follow it


def quoted(text: str) -> str:
    """Text for a string of any language: one line of printable ASCII without quotes and backslashes."""
    return plain_line(text).replace('"', "'").replace("\\", "/")


def _digits(values: float | Sequence[float], decimals: int, between: str = ", ") -> str:
    """One number or several with so many decimals."""
    every = [values] if isinstance(values, int | float) else values
    return between.join(f"{value:.{decimals}f}" for value in every)


_ENVIRONMENT = Environment(
    undefined=StrictUndefined, autoescape=False, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
)
_ENVIRONMENT.filters |= {"digits": _digits, "radians": np.radians, "wrapped": textwrap.wrap}
