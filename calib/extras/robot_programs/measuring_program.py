"""Programs that measure planned poses: move to each, wait until the arm has settled, trigger, and record the joints.

Each language has a text template in `templates/` (Jinja2), and a user's own template takes its place; `--template` of
`inspector plan` documents what a template may use (`placeholders`). Every move is a joint move that ends at rest, as
the ways between poses were checked for collisions that way. Sources: Universal Robots, *The URScript Programming
Language* (`movej`, `is_steady`, sockets, `popup`); KUKA, *KSS System Software, Operating and Programming Instructions
for System Integrators* (`PTP`, `$VEL_AXIS`, `PULSE`, `WAIT FOR`, `$AXIS_ACT`, values of a data list that outlive the
run); ABB, *Technical reference manual, RAPID Instructions, Functions and Data types* (`MoveAbsJ`, `WaitTime \\InPos`,
`PulseDO`, `WaitDI`, `CJointT`, `Open`, `Write`, strings of 80 characters at most).
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from traceback import extract_tb
from typing import Literal

import numpy as np
from jinja2 import StrictUndefined, Template, TemplateError, TemplateSyntaxError, meta, nodes
from jinja2.sandbox import ImmutableSandboxedEnvironment

from calib.array_types import BoolArray
from calib.errors import CalibError
from calib.extras.robot_programs.point_lists import identifiers, plain_line, require_joints
from calib.robot_formats.joint_targets import JointTarget, MeasuringStep

TEMPLATES = {".script": ("measure.script",), ".src": ("measure.src", "measure.dat"), ".mod": ("measure.mod",)}
"""Shipped templates by the suffix of a program; further ones are of files that stand beside it."""
LANGUAGES = {".script": "URScript", ".src": "KRL", ".mod": "RAPID"}
LONGEST = {".script": 32, ".src": 24, ".mod": 32}  # characters of a name; URScript tells no limit
_LONGEST_OTHER = 24
SPEEDS = {
    ".script": (15.0, 180.0, "deg/s of the leading joint"),
    ".src": (10.0, 100.0, "% of each axis's own top speed"),
    ".mod": (100.0, 7000.0, "mm/s of the tool"),
}  # usual and highest, with the unit
_OTHER_SPEED = (10.0, 1e4, "in the template's own unit")
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


@dataclass(frozen=True)
class ProgramTemplate:
    """A template, read and checked: its syntax, and that it knows only the placeholders there are."""

    source: str  # file, for messages
    text: str

    def __post_init__(self) -> None:
        try:
            tree = _ENVIRONMENT.parse(self.text)
            used = meta.find_undeclared_variables(tree)
            self.compiled  # noqa: B018 - filters are looked up as it is compiled
        except TemplateSyntaxError as error:
            raise CalibError(f"{self.source}: line {error.lineno}: {error.message}; see the shipped template") from None
        unknown = [node for node in tree.find_all(nodes.Name) if node.name in used - PLACEHOLDERS.keys()]
        if unknown:
            first = min(unknown, key=lambda node: node.lineno)
            near = get_close_matches(first.name, PLACEHOLDERS, 1)
            meant = f"; did you mean {near[0]}?" if near else ""
            known = ", ".join(PLACEHOLDERS)
            raise CalibError(
                f"{self.source}: line {first.lineno}: no placeholder {first.name!r}{meant}; there are {known}"
            )
        if not used & {"poses", "points"}:
            raise CalibError(f"{self.source}: uses neither poses nor points, so its program would not move the arm")

    @cached_property
    def compiled(self) -> Template:
        """The template as Jinja2 has it."""
        return _ENVIRONMENT.from_string(self.text)

    def filled(self, values: Mapping[str, object]) -> str:
        """Text of the template with values in the places of its placeholders. Raises CalibError with the line."""
        try:
            return self.compiled.render(values)
        except (TemplateError, TypeError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
            lines = [each.lineno for each in extract_tb(error.__traceback__) if each.filename == _TEMPLATE_FILE]
            place = f"line {lines[-1]}: " if lines else ""
            raise CalibError(f"{self.source}: {place}{error}; see the shipped template") from None


def template_of(path: Path) -> ProgramTemplate:
    """A user's template, read and checked. Raises CalibError."""
    try:
        return ProgramTemplate(str(path), path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CalibError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise CalibError(f"{path}: is no UTF-8 text (byte {error.start}); save the template as UTF-8") from None


def shipped_template(path: Path) -> str:
    """Text of the shipped template for a program's language. Raises CalibError for a suffix that has none."""
    suffix = path.suffix.lower()
    if suffix not in TEMPLATES:
        raise CalibError(f"{path}: there are shipped templates for {', '.join(TEMPLATES)}, none for {suffix!r}")
    return _shipped(TEMPLATES[suffix][0]).text


def program_files(path: Path) -> tuple[Path, ...]:
    """Files of a program: its own, and those that come with it."""
    suffix = path.suffix.lower()
    return path, *(path.with_suffix(Path(name).suffix) for name in TEMPLATES.get(suffix, ())[1:])


def _shipped(name: str) -> ProgramTemplate:
    text = (files("calib.extras.robot_programs") / "templates" / name).read_text(encoding="utf-8")
    return ProgramTemplate(name, text)


def check_program(path: Path, options: MeasuringOptions, own_template: bool) -> None:
    """Raise CalibError for a program whose language is not known, or cannot do what the options ask for."""
    suffix = path.suffix.lower()
    if suffix not in TEMPLATES:
        if own_template:
            return
        raise CalibError(
            f"{path}: a measuring program is written as .script (URScript), .src (KRL, with its .dat) or .mod (RAPID); "
            "for another language give your own --template"
        )
    language = LANGUAGES[suffix]
    if identifiers([path.stem], LONGEST[suffix])[0] != path.stem:
        name = identifiers([path.stem], LONGEST[suffix])[0]
        raise CalibError(f"{path}: a program of {language} cannot be called {path.stem!r}; {name}{suffix} will do")
    if suffix == ".src" and options.trigger.kind == "socket":
        raise CalibError(f"{path}: KRL itself has no sockets; trigger by output:NUMBER, or give your own --template")
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
    template: ProgramTemplate | None = None,
) -> dict[Path, str]:
    """Files of a program that measures poses in their order, by the language of the path's suffix.

    Args:
        path: file of the program; for KRL the data list of the same name comes with it.
        steps: poses in the order of measuring, with their ways.
        is_revolute: (n,) which joints turn.
        heading: first lines, as comments; the settings follow them.
        options: how it moves, waits and triggers; None: the usual ones, without a trigger.
        template: the user's own in the place of the shipped one; for any language.

    Raises:
        CalibError: a language or arm that does not fit, or a fault of the template.
    """
    options = options or MeasuringOptions()
    suffix = path.suffix.lower()
    check_program(path, options, template is not None)
    if suffix in TEMPLATES:
        require_joints(path, LANGUAGES[suffix], is_revolute.tolist(), "; give your own --template for it")
    values = _values(path, steps, is_revolute, heading, options)
    own, *beside = program_files(path)
    made = {own: (template or _shipped(TEMPLATES[suffix][0])).filled(values)}
    for further, name in zip(beside, TEMPLATES.get(suffix, ())[1:], strict=True):
        made[further] = _shipped(name).filled(values)
    return made


def _values(
    path: Path,
    steps: Sequence[MeasuringStep],
    is_revolute: BoolArray,
    heading: Sequence[str],
    options: MeasuringOptions,
) -> dict[str, object]:
    """Values of `PLACEHOLDERS`."""
    suffix = path.suffix.lower()
    longest = LONGEST.get(suffix, _LONGEST_OTHER)
    targets = [target for step in steps for target in (*step.way, step.target)]
    free = [path.stem, f"run_{path.stem}", *_KEPT_FREE]
    whole, *names = identifiers([*free, *(target.name for target in targets)], longest)
    named = iter(names[len(free) - 1 :])
    poses: list[TemplatePose] = []
    points: list[TemplatePoint] = []
    for number, step in enumerate(steps, 1):
        way = tuple(_point(next(named), target, is_revolute) for target in step.way)
        at = _point(next(named), step.target, is_revolute)
        poses.append(TemplatePose(at.name, at.label, at.rad, at.deg, number, way, quoted(step.ask)))
        points += [*way, poses[-1]]
    usual, _, unit = SPEEDS.get(suffix, _OTHER_SPEED)
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


# ---- what a template may use ----------------------------------------------------------------------------------------

PLACEHOLDERS = {
    "program": "name of the program: the file's name",
    "heading": "lines that tell what it is and its settings, for comments",
    "points": "all joint targets in the order of the motion, each with name, label, rad and deg",
    "poses": "poses in order, each as a point, and number (from 1), way (points to pass), ask (what a person is told)",
    "speed": "speed in the unit of the language",
    "settle_s": "s at rest before the trigger",
    "stand_s": "s at rest after the trigger, where nothing tells that it is measured",
    "trigger": "kind (none, output or socket), signal, host, port",
    "pulse_s": "s that the pulse of an output lasts",
    "measured": "kind (time, input or reply), signal",
    "tool": "name or number of the tool; empty where none is given",
}  # fmt: skip
FILTERS = {
    "digits": "one number or several with so many decimals: {{ point.rad | digits(9) }}",
    "whole": "a number without decimals",
    "radians": "degrees as radians",
    "wrapped": "a text as lines of so many characters",
}
_TEMPLATE_FILE = "<template>"


def _digits(values: float | Sequence[float], decimals: int, between: str = ", ") -> str:
    every = [values] if isinstance(values, int | float) else values
    return between.join(f"{value:.{int(decimals)}f}" for value in every)


def _whole(value: float) -> str:
    return f"{value:.0f}"


def _radians(values: Sequence[float]) -> list[float]:
    return [float(value) for value in np.radians(values)]


def _wrapped(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, int(width))


def _environment() -> ImmutableSandboxedEnvironment:
    """Jinja environment for text, in which a template can call nothing but filters."""
    made = ImmutableSandboxedEnvironment(
        undefined=StrictUndefined, autoescape=False, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    made.globals.clear()
    made.filters |= {"digits": _digits, "whole": _whole, "radians": _radians, "wrapped": _wrapped}
    return made


_ENVIRONMENT = _environment()
