"""Meaning of a user's columns by their names: joints, points, poses and conditions, with units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.dataset.signals import is_signal
from calib.dataset_import.column_words import MEANINGS, SERIES, WORDS, is_called, words_of
from calib.dataset_import.place_columns import point_columns
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.text_files.column_names import MOST_CHARACTERS, plain, split_unit

_JOINT = re.compile(
    r"(?P<set>.*?(?:q|j|joint|axis|a|theta|angle|position|pos|achse|gelenk|winkel|axe|eje|asse|rax|mp|actuator|articulation|articulación|giunto|juntas?|关节|轴|関節|軸|第))"
    r"[^\w]*_?(?P<number>\d+)(?P<end>\D*)|(?P<first>\d+)\s*(?:軸|轴|关节|関節|节)\D*",
    re.IGNORECASE,
)
_ENDS = WORDS["end of joint"] | WORDS["read"] | {""}
_SET_VALUES = ("soll", "strom")  # beginnings of German words for them
_NO_JOINT = ("no joint", "commanded", "nominal", "deviation", "rate")
_CONDITION_UNITS = {"payload_kg": "kg", "temperature_c": "c", "time_s": "s"}
_VALUE = re.compile(r"[/._ ](?:position|pos|value|actual|angle|meas|measured)(?:\[\d+\])?$")  # behind a joint's name
_EXACT = re.compile(
    r"^(length_(mm|m)|anchor|counts_as|q[wxyz]|s[xyz]{2}_(mm|m)2|r[xyz]{2}_rad2|[xyz]_r[xyz]_(mm|m)_rad|approach[1-9]\d{0,2})$",
    re.ASCII,
)


_TURNED = re.compile(
    r"^(?P<sign>-?)(?P<name>q(?:[1-9]\d?|\*))(?:_(?P<unit>deg|rad|mm|m|cm|in))?"
    r"(?:(?P<others>(?:[+-]q[1-9]\d?)+)|(?P<offset>[+-]\d{1,4}(?:\.\d{1,6})?))?$"
)
_FEW_JOINTS = 2
BY_NAME, AS_MAPPED, BY_PLACE = "by its name", "as told", "by its place, as there is no header"


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column: a joint q = sign * value + offset, a coordinate, or another column of the format.

    With `others` the column's value is sign * q and these joints, each with its sign: J3 = q3 - q2.
    """

    name: str  # "q1" ..., "x", "y", "z", "pose", a condition, or a name of poses.csv and points.csv as it is
    unit: str = ""
    sign: float = 1.0
    offset: float = 0.0  # in the unit
    others: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        unit = f"_{self.unit}" if self.unit else ""
        others = "".join(f"{'-' if sign < 0 else '+'}{name}" for name, sign in self.others)
        return f"{'-' if self.sign < 0 else ''}{self.name}{unit}{others}{f'{self.offset:+g}' if self.offset else ''}"


@dataclass(frozen=True)
class Column:
    """A recognised column of a table: name, meaning, unit where known, and how both were found."""

    name: str
    meaning: str
    unit: str = ""
    sign: float = 1.0
    offset: float = 0.0
    why: str = BY_NAME
    others: tuple[tuple[str, float], ...] = ()


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
                f"--map {pair}: expected column=meaning, a meaning being q1 (q1_deg, q1_rad, -q1_deg, q1_deg+90, "
                f"q3-q2) ..., x, y, z (x_mm, x_m), length_mm, anchor, {', '.join(MEANINGS)}, ignore"
            )
        out[column.strip()] = meaning
    return out


def meaning_of(text: str) -> Meaning | None:
    """Meaning written as in --map, such as -q1_deg+90; None for a text without a meaning."""
    text = text.strip()
    if text in MEANINGS or _EXACT.match(text):
        return Meaning(text)
    turned = _TURNED.match(text)
    if turned:
        sign = -1.0 if turned["sign"] else 1.0
        others = re.findall(r"([+-])(q\d+)", turned["others"] or "")
        return Meaning(
            turned["name"], turned["unit"] or "", sign, float(turned["offset"] or 0.0),
            tuple((name, -1.0 if of == "-" else 1.0) for of, name in others),
        )  # fmt: skip
    base, unit = split_unit(text)
    if base in ("x", "y", "z", "ignore", *MEANINGS) or re.fullmatch(r"q([1-9]\d?|\*)", base):
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
            found[meant.name] = Column(name, meant.name, meant.unit, meant.sign, meant.offset, why, meant.others)

    for pattern, meant in mapping.items():
        for k, name in enumerate(_matching(names, pattern, robot)):
            unit = meant.unit or split_unit(name)[1]
            take(
                name,
                replace(meant, name=f"q{k + 1}" if meant.name == "q*" else meant.name, unit=unit),
                AS_MAPPED,
            )
    for name, meaning in (by_place or {}).items():
        if name not in taken and meaning not in found:
            take(name, Meaning(meaning), BY_PLACE)
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
    points = point_columns([name for name in unmapped if name not in taken])
    for name in (name for name in unmapped if name not in taken):
        base, unit = split_unit(name)
        if _EXACT.match(name):
            take(name, Meaning(name))
        elif name in points:
            if points[name] not in found:
                take(name, Meaning(points[name], unit))
        else:
            for meaning, spellings in MEANINGS.items():
                usual = _CONDITION_UNITS.get(meaning, "")
                if plain(base) in spellings and meaning not in found and unit in ("", usual):
                    take(name, Meaning(meaning))
    rest = tuple(name for name in names if name not in taken)
    return Recognised(found, rest, tuple(faults))


def _matching(names: Sequence[str], pattern: str, robot: Robot | None) -> list[str]:
    """Names that a pattern of --map matches; those of `prefix*` in the order of their numbers or the robot's joints."""
    if "*" not in pattern:
        return [name for name in names if name == pattern]
    ends = re.compile(re.escape(pattern).replace(r"\*", r"(\d+)"))
    numbered = [(int(match[1]), name) for name in names if (match := ends.fullmatch(name))]
    if not numbered and robot is not None:
        of_joints = [(re.escape(joint.name).join(map(re.escape, pattern.split("*", 1)))) for joint in robot.joints]
        return [
            name for of_joint in of_joints for name in names if re.fullmatch(rf"{of_joint}(?:{_VALUE.pattern})?", name)
        ]
    return [name for _, name in sorted(numbered)]


def names_poses(name: str) -> bool:
    """Whether a column is called as those are that name poses."""
    return plain(split_unit(name)[0]) in MEANINGS["pose"]


def is_exact(meaning: str) -> bool:
    """Whether a meaning is a column of points.csv or poses.csv by its own name."""
    return _EXACT.match(meaning) is not None


def _is_position(name: str) -> bool:
    """Whether a column may hold where a joint is: neither its speed nor what it was commanded."""
    return not is_called(name, *_NO_JOINT) and not any(word.startswith(_SET_VALUES) for word in words_of(name))


def are_names(names: Sequence[str], robot: Robot | None = None, mapping: Mapping[str, Meaning] | None = None) -> bool:
    """Whether texts name the columns of joints or of a point, or a mapping has them."""
    if any(name in (mapping or {}) for name in names):
        return True
    meant = recognise(names, robot, mapping or {})
    is_point = all(axis in meant.columns for axis in "xyz") or length_column(meant) is not None
    return "q1" in meant.columns or bool(meant.faults) or is_point or end_in_joint(names)


def end_in_joint(names: Sequence[str]) -> bool:
    """Whether more than two names end in "joint", as those of a robot's own joints do."""
    return sum(plain(split_unit(name)[0]).endswith("joint") for name in names) > _FEW_JOINTS


def _joints(names: Sequence[str], robot: Robot | None) -> tuple[list[str], list[str]]:
    """Names of the joints' columns in order, by the robot's joint names or else by number, and faults.

    What was commanded is taken only where there is nothing else.
    """
    names = [name for name in names if not is_signal(name)]
    positions = [name for name in names if _is_position(name)]
    found, faults = _joints_among(positions, robot)
    return (found, faults) if found or faults else _joints_among(names, robot)


def numbered_joints(names: Sequence[str]) -> list[str]:
    """Columns of joints by their numbers, however many there are."""
    return _joints(names, None)[0]


def _joints_among(names: Sequence[str], robot: Robot | None) -> tuple[list[str], list[str]]:
    wanted = [] if robot is None else [plain(joint.name) for joint in robot.joints]
    by_name = {plain(_VALUE.sub("", split_unit(name)[0])): name for name in names}
    is_clear = bool(wanted) and len(set(wanted)) == len(wanted)
    for series in (wanted if is_clear else [], *SERIES):
        if series and set(series) <= set(by_name) and (robot is None or robot.n_joints == len(series)):
            return [by_name[name] for name in series], []
    if is_clear and min(map(len, wanted)) > 2:
        ends = [[name for key, name in by_name.items() if key.endswith(joint)] for joint in wanted]
        counts = set(map(len, ends))
        if counts == {1}:
            return [found[0] for found in ends], []
        if len(counts) == 1 and min(counts) > 1:
            return [], [_which_arm(list(zip(*ends, strict=True)), robot)]
    sets: dict[str, dict[int, str]] = {}
    for name in names:
        match = _JOINT.fullmatch(split_unit(name)[0].strip())
        if robot is not None and name.isascii() and name.isdigit() and len(name) < 3:
            sets.setdefault("", {})[int(name)] = name
        elif match and match["first"]:
            sets.setdefault("first", {})[int(match["first"])] = name
        elif match and plain(match["end"]) in _ENDS:
            key = f"{plain(match['set'])} {plain(match['end'])}"
            sets.setdefault(key, {})[int(match["number"])] = name
    complete = {
        key: [numbered[k] for k in sorted(numbered)]
        for key, numbered in sets.items()
        for n in (len(numbered) if robot is None else robot.n_joints,)
        if n > 1 or robot is not None
        if sorted(numbered) in (list(range(1, n + 1)), list(range(n)))
        if robot is not None or key.strip() != "q" or sorted(numbered) != [0, 1, 2, 3]  # a quaternion
    }
    actual = [columns for columns in complete.values() if is_called(columns[0], "read")]
    if len(complete) == 1 or len(actual) == 1:
        return (actual or list(complete.values()))[0], []
    return [], [_which_arm(list(complete.values()), None)] if complete else []


def _which_arm(sets: Sequence[Sequence[str]], robot: Robot | None) -> str:
    """Fault that tells what to type for each of several sets of joint columns."""
    typed = []
    for columns in sets:
        ends = [joint.name for joint in robot.joints][:1] if robot is not None else re.findall(r"\d+", columns[0])[-1:]
        before, found, after = columns[0].rpartition(ends[0])
        pattern = f"{before}*{_VALUE.sub('', after)}"
        typed.append(f"--map '{pattern}=q*'" if found else f"--map '{columns[0]}=q1' ...")
    named = " and ".join(f"{columns[0]} ..." for columns in sets)
    return f"found {len(sets)} sets of joint columns, {named}; say which by {' or '.join(typed)}"
