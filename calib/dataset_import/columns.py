"""Meaning of a user's columns by their names: joints, points, poses and conditions, with units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calib.dataset.signals import is_signal
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.text_files.column_names import LENGTHS_MM, MOST_CHARACTERS, listed, plain, split_unit

_JOINT = re.compile(
    r"(?P<set>.*?(?:q|j|joint|axis|a|theta|angle|position|pos|achse|gelenk|winkel|axe|eje|asse|rax|mp|actuator|articulation|articulación|giunto|juntas?|关节|轴|関節|軸|第))"
    r"[^\w]*_?(?P<number>\d+)(?P<end>\D*)|(?P<first>\d+)\s*(?:軸|轴|关节|関節|节)\D*",
    re.IGNORECASE,
)
_ENDS = frozenset(
    listed(
        "actual act ist istwert measured meas position pos positions angle value feedback fb state winkel grad 轴 "
        "軸 角度 关节 関節 轴角度 軸角度 关节角度 関節角度 角"
    )
) | {""}
_SERIES = (  # joints that some makers name and do not number
    ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3"),
    ("shoulderpan", "shoulderlift", "elbow", "wrist1", "wrist2", "wrist3"),
    ("s", "l", "u", "r", "b", "t"),
)
NOT_POSITIONS = frozenset(
    listed(
        "target desired command commanded cmd reference ref setpoint goal nominal error velocity velocities vel "
        "speed qd qdd dq ddq qdot acceleration acc current effort eff torque tau tq moment temperature "
        "temperatures temp voltage mode control action jerk tcp force d ip mt et aspos macur drehmoment "
        "geschwindigkeit consigne vitesse"
    )
)
_SET_VALUES = ("soll", "strom")  # beginnings of German words for them
_ACTUAL = {"actual", "measured", "meas", "ist", "istposition"}
_MEASURED = listed(
    "measured measurement measure meas gemessen mess laser lt tracker scanner jig smr reflector marker 测量 "
    "实测 mesuré mesurée mesure misurato medido 測定値 測定 計測値 計測 实测值 测量值 gemessene istwert"
)
_ACTUAL_POINT = ("actual", "act", "ist")  # of a controller its own, but beside nominal ones
_MARKER_NAMES = listed(
    "marker reflector reflektor smr prism tag ball kugel aruco messpunkt cible マーカー ターゲット 标记 靶球"
)
_NOMINAL = listed("nominal nom soll theoretical theo 名义 理论")
_DEVIATIONS = listed("deviation dev abweichung delta error 余量")
_AXES = {"easting": "x", "northing": "y", "elevation": "z"}  # of surveyors
_WORDS = "|".join(
    (
        *_MEASURED,
        *_ACTUAL_POINT,
        *listed("point punkt position pos coordinate coord koordinate coordonnée 座標 坐标 p t"),
    )
)
_NUMBERED = re.compile(rf"(?P<stem>{_WORDS}|xyz)s?[\W_]*\d+\W?", re.IGNORECASE)
_POINT = re.compile(rf"^(?P<before>(?:{_WORDS})*)(?P<axis>[xyz])(?P<after>1?(?:{_WORDS})*)$")
_NO_MARKER = frozenset(
    listed(
        "r q f d s u v w m sigma std ori roll euler quat force moment torque vel acc speed cov base frame flange "
        "nozzle rot rotation orientation quaternion velocity acceleration normal imu gyro wrench dir uncertainty "
        "cmd command commanded goal consigne tcp tool0 robot controller steuerung ee eef effector fk odom "
        "cartesian calculated berechnet desired setpoint reference sollwert 指令 目標"
    )
)
_MARKER_FORMS = tuple(
    re.compile(form, re.IGNORECASE)
    for form in (
        r"(?P<stem>.*?\w.*?)(?:[\W_]+|(?<=\d)|(?<=[a-z])(?=[XYZ]))(?P<axis>[xyz])(?P<after>)",
        r"(?P<after>)(?P<axis>[xyz])(?:[\W_]+|(?=\d))(?P<stem>.*\w.*)",
        r"(?P<stem>.*?\w.*?)[\W_]+(?P<axis>[xyz])[\W_]+(?P<after>.*\w.*)",
    )
)
_OTHERS = {  # spellings, without signs
    "pose": "pose poseid id name no nr number index idx measurement point pointname pointid config punkt messpunkt "
    "punktname punktnr repère pointno pointnr 测点 点号 測定点 測点 番号 序号 file",
    "role": "role set split",
    "target": "target reflector smr marker",
    "setup": "setup station",
    "payload_kg": "payload payloadmass load",
    "temperature_c": "temperature temp temperatur",
    "time_s": "time timestamp zeit",
    "scan": "scan scanfile",
}
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
Markers = dict[str, tuple[str, str, str]]
"""Columns x, y, z by the name of the marker or point that they are of."""
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
                f"q3-q2) ..., x, y, z (x_mm, x_m), length_mm, anchor, {', '.join(_OTHERS)}, ignore"
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
        others = re.findall(r"([+-])(q\d+)", turned["others"] or "")
        return Meaning(
            turned["name"], turned["unit"] or "", sign, float(turned["offset"] or 0.0),
            tuple((name, -1.0 if of == "-" else 1.0) for of, name in others),
        )  # fmt: skip
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
    points = _point_columns([name for name in unmapped if name not in taken])
    for name in (name for name in unmapped if name not in taken):
        base, unit = split_unit(name)
        if _EXACT.match(name):
            take(name, Meaning(name))
        elif name in points:
            if points[name] not in found:
                take(name, Meaning(points[name], unit))
        else:
            for meaning, spellings in _OTHERS.items():
                usual = _CONDITION_UNITS.get(meaning, "")
                if plain(base) in listed(spellings) and meaning not in found and unit in ("", usual):
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


def words_of(name: str) -> set[str]:
    """Words of a column's name, in lower case."""
    return {word for word in re.split(r"[\W_]+|(?<=[^\W\d_])(?=\d)", name.lower()) if word}


def names_poses(name: str) -> bool:
    """Whether a column is called as those are that name poses."""
    return plain(split_unit(name)[0]) in listed(_OTHERS["pose"])


def is_exact(meaning: str) -> bool:
    """Whether a meaning is a column of points.csv or poses.csv by its own name."""
    return _EXACT.match(meaning) is not None


def is_position(name: str) -> bool:
    """Whether a column may hold where a joint is: neither its speed nor what it was commanded."""
    words = words_of(name)
    return not words & NOT_POSITIONS and not any(word.startswith(_SET_VALUES) for word in words)


def is_beside_point(name: str) -> bool:
    """Whether a column beside the measured point is a further or nominal point, or how far the point is from it."""
    words, base = words_of(name), plain(split_unit(name)[0])
    of_axis = bool(words & {"x", "y", "z"}) and bool(words & {*_NOMINAL, *_DEVIATIONS})
    return of_axis or re.fullmatch(r"[xyz]\d{1,3}", base) is not None


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


def point_groups(names: Sequence[str]) -> Markers:
    """Columns x, y, z of each point, by what stands beside the axis in their names.

    Nominal points, deviations, turns and the controller's own poses are none.
    """
    found: dict[str, dict[str, str]] = {}
    for name in names:
        base = split_unit(name)[0].strip()
        match = next((m for form in _MARKER_FORMS if (m := form.fullmatch(base))), None)
        stem = "" if match is None else f"{match['stem']} {match['after']}".strip(" _./-")
        axis = match["axis"].lower() if match is not None else base.lower()
        words = set(re.split(r"[\W_]+", stem.lower()))  # m1 is a marker, m a moment
        if axis in ("x", "y", "z") and not words & {*_NO_MARKER, *_NOMINAL, *_DEVIATIONS}:
            found.setdefault(stem, {}).setdefault(axis, name)
    return {stem: (axes["x"], axes["y"], axes["z"]) for stem, axes in found.items() if len(axes) == 3}


def marker_columns(names: Sequence[str]) -> Markers:
    """Columns x, y, z of each of several markers, such as T1_x ... T2_x ..., or x1 ... x2 ..., by the markers' names.

    {} unless their names differ by numbers or single letters alone, or all have a word for a marker.
    """
    kinds: dict[str, Markers] = {}
    for stem, columns in point_groups(names).items():
        kinds.setdefault(kind_of_marker(stem), {})[stem or "1"] = columns
    most = max(kinds.values(), key=len, default={})
    return most if len(most) > 1 else {}


def kind_of_marker(name: str) -> str:
    """What markers of one kind have in common: a word for them, or their name without numbers and single letters."""
    if any(word.startswith(_MARKER_NAMES) for word in words_of(name)):
        return "marker"
    return plain(re.sub(r"\d+|(?<![^\W_])[A-Za-z](?![^\W_])", "9", name) or "9")


def _joints(names: Sequence[str], robot: Robot | None) -> tuple[list[str], list[str]]:
    """Names of the joints' columns in order, by the robot's joint names or else by number, and faults.

    What was commanded is taken only where there is nothing else.
    """
    names = [name for name in names if not is_signal(name)]
    positions = [name for name in names if is_position(name)]
    found, faults = _joints_among(positions, robot)
    return (found, faults) if found or faults else _joints_among(names, robot)


def numbered_joints(names: Sequence[str]) -> list[str]:
    """Columns of joints by their numbers, however many there are."""
    return _joints(names, None)[0]


def _joints_among(names: Sequence[str], robot: Robot | None) -> tuple[list[str], list[str]]:
    wanted = [] if robot is None else [plain(joint.name) for joint in robot.joints]
    by_name = {plain(_VALUE.sub("", split_unit(name)[0])): name for name in names}
    is_clear = bool(wanted) and len(set(wanted)) == len(wanted)
    for series in (wanted if is_clear else [], *_SERIES):
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
    actual = [columns for columns in complete.values() if words_of(columns[0]) & _ACTUAL]
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


def _point_columns(names: Sequence[str]) -> dict[str, str]:
    """Axis of each column of the measured point: a whole point before single ones, one said to be measured first."""
    has_nominal = any(words_of(name) & set(_NOMINAL) for name in names)
    found: dict[tuple[int, str], dict[str, str]] = {}
    for name in names:
        base, unit = split_unit(name)
        base = _AXES.get(plain(base), base)
        match = _POINT.match(plain(base)) if unit in ("", *LENGTHS_MM) else None
        words = "" if match is None else match["before"] + match["after"]
        if match is None or (not has_nominal and any(word in words for word in _ACTUAL_POINT)):
            continue
        rank = 0 if any(word in words for word in (*_MEASURED, *_ACTUAL_POINT)) else 1
        found.setdefault((rank, f"{match['before']} {match['after']}"), {}).setdefault(match["axis"], name)
    if not any(len(axes) == 3 for axes in found.values()):
        groups = point_groups(names)
        for columns in (groups if len(groups) == 1 else marker_columns(names)).values():
            return dict(zip(columns, "xyz", strict=True))
        sets: dict[str, list[str]] = {}
        for name in names:
            if match := _NUMBERED.fullmatch(split_unit(name)[0]):
                sets.setdefault(match["stem"], []).append(name)
        if [len(columns) for columns in sets.values()] == [3]:  # such as p[0], p[1], p[2]
            return dict(zip(next(iter(sets.values())), "xyz", strict=True))
    order = sorted(found, key=lambda key: (-len(found[key]), key[0]))
    return {name: axis for key in order[:1] for axis, name in found[key].items()} | (
        {} if not order or len(found[order[0]]) == 3 else {n: a for key in order[1:] for a, n in found[key].items()}
    )
