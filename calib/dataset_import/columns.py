"""What the columns of a user's table mean, by their names: joints, points, poses and conditions, with their units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.user_tables.unit_names import MOST_CHARACTERS, plain, split_unit

_JOINT = re.compile(r"^(?P<set>.*?)(?:q|j|joint|axis|a|theta|angle|position|pos)(?P<number>\d+)$")
_POINT = re.compile(
    r"^(?:measured|meas|point|position|pos|p|t|coord|laser|tracker|scanner|jig)?(?P<axis>[xyz])$"
)
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
        "pointname",
        "config",
    ),
    "role": ("role", "set", "split"),
    "target": ("target", "reflector", "smr", "marker"),
    "setup": ("setup", "station"),
    "payload_kg": ("payload", "payloadmass", "load"),
    "temperature_c": ("temperature", "temp"),
    "time_s": ("time", "timestamp"),
    "scan": ("scan", "scanfile"),
}
_CONDITION_UNITS = {"payload_kg": "kg", "temperature_c": "c", "time_s": "s"}
_EXACT = re.compile(r"^(q[wxyz]|s[xyz]{2}_(mm|m)2|r[xyz]{2}_rad2|[xyz]_r[xyz]_(mm|m)_rad|approach\d+)$")


@dataclass(frozen=True)
class Column:
    """A column of a table: its name there, what it means, and its unit where the name tells it."""

    name: str
    meaning: (
        str  # "q1" ..., "x", "y", "z", "pose", a condition, or a name of poses.csv and points.csv as it is
    )
    unit: str = ""


@dataclass(frozen=True)
class Recognised:
    """The columns of a table by their meaning; what else it has, and what is wrong."""

    columns: Mapping[str, Column]
    rest: tuple[str, ...]
    faults: tuple[str, ...]


def parsed_mapping(pairs: Sequence[str]) -> dict[str, tuple[str, str]]:
    """--map column=meaning as meaning and unit by column. Raises DatasetError."""
    out = {}
    for pair in pairs:
        column, equals, meaning = pair.rpartition("=")
        base, unit = split_unit(meaning)
        known = (
            base in ("x", "y", "z", "ignore", *_OTHERS)
            or re.fullmatch(r"q([1-9]\d?|\*)", base)
            or _EXACT.match(meaning)
        )
        if not equals or not column.strip() or not known:
            if meaning in _OTHERS or _EXACT.match(meaning):
                base, unit = meaning, ""
            else:
                raise DatasetError(
                    f"--map {pair}: expected column=meaning, a meaning being q1 (q1_deg, q1_rad) ..., x, y, z (x_mm, "
                    f"x_m), {', '.join(_OTHERS)}, ignore"
                )
        if _EXACT.match(meaning) or meaning in _OTHERS:
            base, unit = meaning, ""
        out[column.strip()] = (base, unit)
    return out


def recognise(names: Sequence[str], robot: Robot, mapping: Mapping[str, tuple[str, str]]) -> Recognised:
    """What the columns mean. A mapping wins over names; `prefix*` maps the numbered columns of a prefix to q1 ..."""
    found: dict[str, Column] = {}
    faults: list[str] = []
    taken: set[str] = set()

    def take(name: str, meaning: str, unit: str) -> None:
        taken.add(name)
        if meaning in found:
            faults.append(
                f"columns {found[meaning].name!r} and {name!r} both stand for {meaning}; tell with --map"
            )
        elif meaning != "ignore":
            found[meaning] = Column(name, meaning, unit)

    for pattern, (meaning, unit) in mapping.items():
        matching = _matching(names, pattern)
        if not matching:
            continue
        for k, name in enumerate(matching):
            own = split_unit(name)[1]
            take(name, f"q{k + 1}" if meaning == "q*" else meaning, unit or own)
    left = [name for name in names if name not in taken and len(name) <= MOST_CHARACTERS]
    if not any(re.fullmatch(r"q\d+", meaning) for meaning in found):
        joints, said = _joints(left, robot)
        faults += said
        for k, name in enumerate(joints):
            take(name, f"q{k + 1}", split_unit(name)[1])
    for name in (name for name in left if name not in taken):
        base, unit = split_unit(name)
        point = _POINT.match(plain(base))
        if _EXACT.match(name):
            take(name, name, "")
        elif point and unit in ("", "mm", "m", "cm", "in", "um"):
            if point["axis"] not in found:
                take(name, point["axis"], unit)
        else:
            for meaning, words in _OTHERS.items():
                wanted = _CONDITION_UNITS.get(meaning, "")
                if plain(base) in words and meaning not in found and unit in ("", wanted):
                    take(name, meaning, "")
    rest = tuple(name for name in names if name not in taken)
    return Recognised(found, rest, tuple(faults))


def _matching(names: Sequence[str], pattern: str) -> list[str]:
    """The columns that a pattern of --map means; those of `prefix*` by their number."""
    if "*" not in pattern:
        return [name for name in names if name == pattern]
    ends = re.compile(re.escape(pattern).replace(r"\*", r"(\d+)"))
    numbered = [(int(match[1]), name) for name in names if (match := ends.fullmatch(name))]
    return [name for _, name in sorted(numbered)]


def _joints(names: Sequence[str], robot: Robot) -> tuple[list[str], list[str]]:
    """The columns of the joints in order, and what is wrong. By the joints' own names, else by number."""
    wanted = [plain(joint.name) for joint in robot.joints]
    by_name = {plain(split_unit(name)[0]): name for name in names}
    ends = [[name for key, name in by_name.items() if key.endswith(joint)] for joint in wanted]
    if (
        len(set(wanted)) == len(wanted)
        and all(len(found) == 1 for found in ends)
        and min(map(len, wanted)) > 2
    ):
        return [found[0] for found in ends], []
    sets: dict[str, dict[int, str]] = {}
    for name in names:
        match = _JOINT.match(plain(split_unit(name)[0]))
        if match:
            sets.setdefault(match["set"], {})[int(match["number"])] = name
    n = robot.n_joints
    complete = {
        key: [numbered[k] for k in sorted(numbered)]
        for key, numbered in sets.items()
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
