"""Meaning of a user's columns by their names: joints, points, poses and conditions, with units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.dataset.signals import is_signal
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.text_files.user_table import MOST_CHARACTERS, plain, split_unit

_JOINT = re.compile(
    r"^(?P<set>.*?)(?:q|j|joint|axis|a|theta|angle|position|pos|achse|gelenk|winkel|axe|eje|asse)(?P<number>\d+)$"
)
_POINT = re.compile(r"^(?:measured|meas|point|position|pos|p|t|coord|laser|tracker|scanner|jig)?(?P<axis>[xyz])$")
_OTHERS = {
    "pose": (
        "pose",
        "poseid",
        "id",
        "name",
        "no",
        "nr",
        "number",
        "index",
        "idx",
        "measurement",
        "point",
        "pointname",
        "pointid",
        "config",
        "punkt",
        "messpunkt",
        "punktname",
        "punktnr",
    ),
    "role": ("role", "set", "split"),
    "target": ("target", "reflector", "smr", "marker"),
    "setup": ("setup", "station"),
    "payload_kg": ("payload", "payloadmass", "load"),
    "temperature_c": ("temperature", "temp", "temperatur"),
    "time_s": ("time", "timestamp", "zeit"),
    "scan": ("scan", "scanfile"),
}
_CONDITION_UNITS = {"payload_kg": "kg", "temperature_c": "c", "time_s": "s"}
_VALUE = re.compile(r"[/.](?:position|pos|value|actual)(?:\[\d+\])?$")  # of a joint, behind its name in a log of ROS
_EXACT = re.compile(
    r"^(length_(mm|m)|anchor|q[wxyz]|s[xyz]{2}_(mm|m)2|r[xyz]{2}_rad2|[xyz]_r[xyz]_(mm|m)_rad|approach[1-9]\d{0,2})$",
    re.ASCII,
)


_TURNED = re.compile(
    r"^(?P<sign>-?)(?P<name>q(?:[1-9]\d?|\*))(?:_(?P<unit>deg|rad|mm|m|cm|in))?(?P<offset>[+-]\d{1,4}(?:\.\d{1,6})?)?$"
)
BY_NAME, AS_MAPPED, BY_PLACE = "by its name", "as told", "by its place, as there is no header"


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column: a joint q = sign * value + offset, a coordinate, or another column of the format."""

    name: str  # "q1" ..., "x", "y", "z", "pose", a condition, or a name of poses.csv and points.csv as it is
    unit: str = ""
    sign: float = 1.0
    offset: float = 0.0  # in the unit

    def __str__(self) -> str:
        unit = f"_{self.unit}" if self.unit else ""
        return f"{'-' if self.sign < 0 else ''}{self.name}{unit}{f'{self.offset:+g}' if self.offset else ''}"


@dataclass(frozen=True)
class Column:
    """A recognised column of a table: name, meaning, unit where known, and how both were found."""

    name: str
    meaning: str
    unit: str = ""
    sign: float = 1.0
    offset: float = 0.0
    why: str = BY_NAME


@dataclass(frozen=True)
class Recognised:
    """Result of recognising a table's columns: columns by meaning, the other columns, and faults."""

    columns: Mapping[str, Column]
    rest: tuple[str, ...]
    faults: tuple[str, ...]


def length_column(meant: Recognised) -> Column | None:
    """Recognised column of measured lengths, `length_mm` or `length_m`; None where points have coordinates."""
    return meant.columns.get("length_mm") or meant.columns.get("length_m")


def parsed_mapping(pairs: Sequence[str]) -> dict[str, Meaning]:
    """Meanings by column from the values of --map, column=meaning. Raises DatasetError."""
    out = {}
    for pair in pairs:
        column, equals, text = pair.rpartition("=")
        meaning = meaning_of(text)
        if not equals or not column.strip() or meaning is None:
            raise DatasetError(
                f"--map {pair}: expected column=meaning, a meaning being q1 (q1_deg, q1_rad, -q1_deg, q1_deg+90) ..., "
                f"x, y, z (x_mm, x_m), length_mm, anchor, {', '.join(_OTHERS)}, ignore"
            )
        out[column.strip()] = meaning
    return out


def meaning_of(text: str) -> Meaning | None:
    """Meaning written as in --map, such as -q1_deg+90; None for a text without a meaning."""
    text = text.strip()
    if text in _OTHERS or _EXACT.match(text):
        return Meaning(text)
    turned = _TURNED.match(text)
    if turned:
        sign = -1.0 if turned["sign"] else 1.0
        return Meaning(turned["name"], turned["unit"] or "", sign, float(turned["offset"] or 0.0))
    base, unit = split_unit(text)
    if base in ("x", "y", "z", "ignore", *_OTHERS) or re.fullmatch(r"q([1-9]\d?|\*)", base):
        return Meaning(base, unit)
    return None


def recognise(
    names: Sequence[str],
    robot: Robot | None,
    mapping: Mapping[str, Meaning],
    by_place: Mapping[str, str] | None = None,
) -> Recognised:
    """Recognise the columns of a table; a mapping takes precedence over names.

    In a mapping `prefix*` maps the numbered columns of a prefix to q1 ... by_place  # meanings of unnamed columns
    """
    found: dict[str, Column] = {}
    faults: list[str] = []
    taken: set[str] = set()

    def take(name: str, meant: Meaning, why: str = BY_NAME) -> None:
        taken.add(name)
        if meant.name in found:
            faults.append(
                f"columns {found[meant.name].name!r} and {name!r} both stand for {meant.name}; tell with --map"
            )
        elif meant.name != "ignore":
            found[meant.name] = Column(name, meant.name, meant.unit, meant.sign, meant.offset, why)

    for pattern, meant in mapping.items():
        for k, name in enumerate(_matching(names, pattern)):
            unit = meant.unit or split_unit(name)[1]
            take(
                name,
                replace(meant, name=f"q{k + 1}" if meant.name == "q*" else meant.name, unit=unit),
                AS_MAPPED,
            )
    for name, words in (by_place or {}).items():
        if name not in taken and words not in found:
            take(name, Meaning(words), BY_PLACE)
    unmapped = [name for name in names if name not in taken and len(name) <= MOST_CHARACTERS]
    mapped_joints = [meaning for meaning in found if re.fullmatch(r"q\d+", meaning)]
    if not mapped_joints or robot is None or len(mapped_joints) < robot.n_joints:
        of_joints = {column.name for meaning, column in found.items() if meaning in mapped_joints}
        others = taken - of_joints
        joints, joint_faults = _joints([name for name in names if name not in others], robot)
        faults += joint_faults if not mapped_joints else []
        for k, name in enumerate(joints):
            if name in unmapped and f"q{k + 1}" not in found:
                take(name, Meaning(f"q{k + 1}", split_unit(name)[1]))
    for name in (name for name in unmapped if name not in taken):
        base, unit = split_unit(name)
        point = _POINT.match(plain(base))
        if _EXACT.match(name):
            take(name, Meaning(name))
        elif point and unit in ("", "mm", "m", "cm", "in", "um"):
            if point["axis"] not in found:
                take(name, Meaning(point["axis"], unit))
        else:
            for meaning, spellings in _OTHERS.items():
                usual = _CONDITION_UNITS.get(meaning, "")
                if plain(base) in spellings and meaning not in found and unit in ("", usual):
                    take(name, Meaning(meaning))
    rest = tuple(name for name in names if name not in taken)
    return Recognised(found, rest, tuple(faults))


def _matching(names: Sequence[str], pattern: str) -> list[str]:
    """Names that a pattern of --map matches; those of `prefix*` ordered by their number."""
    if "*" not in pattern:
        return [name for name in names if name == pattern]
    ends = re.compile(re.escape(pattern).replace(r"\*", r"(\d+)"))
    numbered = [(int(match[1]), name) for name in names if (match := ends.fullmatch(name))]
    return [name for _, name in sorted(numbered)]


def _joints(names: Sequence[str], robot: Robot | None) -> tuple[list[str], list[str]]:
    """Names of the joints' columns in order, by the robot's joint names or else by number, and faults."""
    wanted = [] if robot is None else [plain(joint.name) for joint in robot.joints]
    names = [name for name in names if not is_signal(name)]
    by_name = {plain(_VALUE.sub("", split_unit(name)[0])): name for name in names}
    if wanted and len(set(wanted)) == len(wanted):
        if all(joint in by_name for joint in wanted):
            return [by_name[joint] for joint in wanted], []
        ends = [[name for key, name in by_name.items() if key.endswith(joint)] for joint in wanted]
        if all(len(found) == 1 for found in ends) and min(map(len, wanted)) > 2:
            return [found[0] for found in ends], []
    sets: dict[str, dict[int, str]] = {}
    for name in names:
        match = _JOINT.match(plain(split_unit(name)[0]))
        if match:
            sets.setdefault(match["set"], {})[int(match["number"])] = name
    complete = {
        key: [numbered[k] for k in sorted(numbered)]
        for key, numbered in sets.items()
        for n in (len(numbered) if robot is None else robot.n_joints,)
        if n > 1 or robot is not None
        if sorted(numbered) in (list(range(1, n + 1)), list(range(n)))
    }
    if len(complete) == 1:
        return next(iter(complete.values())), []
    if complete:
        named = " and ".join(f"{columns[0]} ..." for columns in complete.values())
        return [], [
            f"found {len(complete)} sets of joint columns, {named}; say which by --map, such as 'actual_q_*=q*'"
        ]
    return [], []
