"""Robot tables as CSV: standard and modified Denavit-Hartenberg, screw axes at home, joint origins.

The columns' names carry the units. A row of the name tool, flange, tcp or ee, or of the type fixed, is the transform
from the last joint to the tip.

| columns | row i |
|---|---|
| theta d a alpha, standard | Rz(theta + q) Trans(a, 0, d) Rx(alpha), from axis i to axis i + 1 |
| theta d a alpha, modified (Craig) | Rx(alpha) Trans(a, 0, 0) Rz(theta + q) Trans(0, 0, d), from axis i - 1 to axis i |
| wx wy wz, px py pz or vx vy vz | axis i at home in the base frame, a point on it or v = -w x p; the tip: px ... yaw |
| x y z roll pitch yaw, and axis_x axis_y axis_z | the origin of joint i in the frame of the one before, as in a URDF |
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.frames import invert, make_transform, rotation_from_rpy
from calib.robot_formats.chain.five_parameters import modified_transform, row_transform
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain
from calib.robot_formats.urdf.safe_xml import read_bytes
from calib.text_files.column_names import ANGLES_RAD, LENGTHS_MM, plain, split_unit
from calib.text_files.records import rows_of
from calib.text_files.user_table import Fault, UserTable, load_table

CONVENTIONS = ("standard", "modified")
_TIPS = ("tool", "tool0", "flange", "tcp", "ee", "tip", "home", "m")
_TOOLS = ("tool", "tcp")  # behind the flange
_HERE = np.eye(4)
_LENGTHS: dict[str, float] = dict(LENGTHS_MM)
_UNITS: dict[str, dict[str, float]] = {  # of each kind of column, to mm and rad
    "length": _LENGTHS, "angle": dict(ANGLES_RAD), "number": {"": 1.0},
    "moment": {"": 1000.0, **_LENGTHS},  # without a unit those of metres
}  # fmt: skip
_JOINT = re.compile(r"(?:\+\s*)?\b(?:q|theta|θ)_?\d*\*?(?=\s*(?:$|[+-]))", re.IGNORECASE)  # its own value in a cell
_PI = re.compile(r"π|pi", re.IGNORECASE)
_JSON_KEYS = {"thetaoffset": "theta", "offset": "theta", "jointid": "name", "joint": "name", "jointname": "name",
              "jointtype": "type"}  # fmt: skip
_KINDS = {"a": "length", "d": "length", "alpha": "angle", "theta": "angle"}
_SAME_AXIS_MM, _SAME_AXIS_RAD = 1e-6, 1e-9
_RPY = ("roll", "pitch", "yaw")
_MOST = 1e6
_NO_DIRECTION = 1e-9
_OF_PI = re.compile(  # as makers print angles: π/2, -π/2, pi, 3pi/4, 0.5*pi
    r"(?P<sign>[+-]?)(?P<times>\d{0,9}\.?\d{0,9})\s?\*?\s?(?:π|pi)(?:\s?/\s?(?P<by>\d{1,9}))?", re.I | re.ASCII
)


def chain_of_table(path: Path, convention: str | None) -> SerialChain:
    """Chain of a table, whose kind follows from its columns; `convention` for Denavit-Hartenberg.

    Raises RobotFileError in one line, also where the table looks like one of the other convention.
    """
    loaded, told = _of_json(path) if path.suffix.lower() == ".json" else (load_table(path), None)
    table = _Table(loaded)
    convention = convention or told
    if table.has("a", "alpha", "d", "theta"):
        return _denavit_hartenberg(table, convention)
    if convention is not None:
        raise RobotFileError(f"{path}: --convention is for tables of theta, d, a, alpha; found {table.named}")
    if table.has("wx", "wy", "wz"):
        return _screws(table)
    if table.has(*"xyz", *_RPY):
        return _origins(table)
    raise RobotFileError(
        f"{path}: line 1: found {table.named}; expected theta, d, a, alpha, or wx, wy, wz with px, py, pz, or x, y, z, "
        "roll, pitch, yaw"
    )


def _without_pi(cell: str) -> str:
    """A cell such as -π/2 or q2 - pi/2 as the text of a number without the joint's value; any other cell unchanged."""
    cell = _JOINT.sub("", cell.strip()).replace(" ", "").removeprefix("+") or "0"
    found = _OF_PI.fullmatch(cell.strip().replace("\N{MINUS SIGN}", "-"))
    if found is None or found["times"] == "." or (found["by"] is not None and int(found["by"]) == 0):
        return cell
    value = float(found["times"] or 1) * math.pi / int(found["by"] or 1)
    return repr(-value if found["sign"] == "-" else value)


def _of_json(path: Path) -> tuple[UserTable, str | None]:
    """Table of a JSON with a row for each joint, a list or a dict, under any key, and the convention that it tells."""
    try:
        document = json.loads(read_bytes(path))
    except (ValueError, RecursionError) as error:
        raise RobotFileError(f"{path}: is no JSON: {error}") from None
    told: dict[str, Any] = document if isinstance(document, dict) else {"rows": document}
    rows = next((rows for value in (told, *told.values()) if (rows := _rows_of(value))), None)
    if rows is None:
        raise RobotFileError(
            f"{path}: found {', '.join(map(str, told))[:200]}; a list with a, alpha, d, theta of each joint is needed"
        )
    units = told.get("units")
    keys, *cells = rows_of(path, [{"theta": 0, **row} if _THETAS.isdisjoint(_bare(row)) else row for row in rows])
    columns = []
    for key in keys:
        base, unit = split_unit(key)
        name = _JSON_KEYS.get(plain(base), plain(base))
        unit = unit or (str(units.get(_KINDS.get(name), "")) if isinstance(units, dict) else "")
        columns.append(f"{name}_{unit}" if unit else name)
    convention = next((str(value).lower() for key, value in told.items() if "convention" in key.lower()), "")
    found = "modified" if "mod" in convention or "craig" in convention else "standard" if convention else None
    table = UserTable(path, tuple(columns), tuple(map(tuple, cells)), tuple(range(1, len(cells) + 1)), has_header=True)
    return table, found


_THETAS = {"theta", "thetaoffset", "offset"}


def _bare(row: Mapping[str, Any]) -> set[str]:
    """Keys of a joint without their units."""
    return {plain(split_unit(str(key))[0]) for key in row}


def _rows_of(value: object) -> list[dict[str, Any]]:
    """Joints with a, alpha and d of a JSON's list, or of its dict by their names; [] where it has others."""
    if isinstance(value, dict):
        value = [{"name": name, **row} for name, row in value.items() if isinstance(row, dict)]
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        return []
    return [] if any({"a", "alpha", "d"} - _bare(row) for row in value) else value


class _Table:
    """A robot's table with columns by their plain names; values in mm and rad."""

    def __init__(self, table: UserTable) -> None:
        self.table, self.path = table, table.path
        self._columns: dict[str, tuple[str, str]] = {}
        for name in table.columns:
            base, unit = split_unit(name)
            self._columns.setdefault(plain(base), (name, unit))
        types = [word.lower() for word in self.words("type", "revolute")]
        names = self.words("name", "")
        if not any(names):
            names = self.words("joint", "")
        last = len(table) - 1
        is_tip = [
            kind == "fixed" or (i == last and plain(name) in _TIPS)
            for i, (kind, name) in enumerate(zip(types, names, strict=True))
        ]
        if any(is_tip[:-1]):
            self.fail(is_tip.index(True), "a fixed row stands between joints; join it to the next")
        self.joints = [i for i in range(len(table)) if not is_tip[i]]
        self.tip = last if is_tip[-1] else None
        self.ends_at_tool = is_tip[-1] and plain(names[last]) in _TOOLS
        for i in self.joints:
            if types[i] not in ("revolute", "prismatic"):
                self.fail(i, f"type {types[i][:30]!r}; expected revolute, prismatic or fixed")
        if not self.joints:
            raise RobotFileError(f"{self.path}: has no row of a joint")
        if self.has("d") and not self.has("type"):
            slides = [_JOINT.search(cell) is not None for cell in self.words("d", "")]
            types = ["prismatic" if slide else kind for slide, kind in zip(slides, types, strict=True)]
        self.types = [types[i] for i in self.joints]
        self.names = [names[i] or f"J{k}" for k, i in enumerate(self.joints, 1)]

    @property
    def named(self) -> str:
        """Names of the columns, for messages."""
        return ", ".join(self.table.columns[:20])

    def has(self, *columns: str) -> bool:
        """Whether the table has all of some columns."""
        return all(column in self._columns for column in columns)

    def words(self, column: str, default: str) -> list[str]:
        """Texts of a column; the default where the column is missing, or for empty cells."""
        if column not in self._columns:
            return [default] * len(self.table)
        return [cell or default for cell in self.table.text(self._columns[column][0])]

    def values(self, column: str, kind: str) -> Array:
        """Values (rows,) of a column of a kind, in mm or rad; an empty cell is 0."""
        name, unit = self._columns[column]
        faults: list[Fault] = []
        cells = [cell or "0" for cell in self.table.text(name)]
        if kind == "angle" and not unit and any(map(_PI.search, cells)):
            unit = "rad"
        if kind in ("angle", "length") and unit != "deg":
            cells = list(map(_without_pi, cells))
        out = replace(self.table, columns=(name,), rows=tuple((cell,) for cell in cells)).numbers(name, faults.append)
        if faults:
            raise RobotFileError(str(faults[0]))
        units = _UNITS[kind]
        if unit not in units:
            needed = " or ".join(f"{plain(column)}_{known}" for known in list(units)[:2])
            raise RobotFileError(
                f"{self.path}: line 1: column {name!r} tells no unit that it may have; name it {needed}"
            )
        out = out * units[unit]
        i = int(np.abs(out).argmax())
        if abs(out[i]) > _MOST:
            self.fail(i, f"column {name}: {out[i]:g} is beyond {_MOST:g} mm or rad")
        return out

    def vectors(self, columns: Sequence[str], kind: str) -> Array:
        """Values (rows, columns) of some columns of a kind."""
        return np.column_stack([self.values(column, kind) for column in columns])

    def directions(self, vectors: Array) -> Array:
        """Unit vectors (joints, 3) of the joints' rows."""
        lengths = np.linalg.norm(vectors, axis=1)
        for i in self.joints:
            if lengths[i] < _NO_DIRECTION:
                self.fail(i, "the axis has no direction")
        return np.asarray(vectors[self.joints] / lengths[self.joints, None])

    def limits(self, end: str) -> list[float | None]:
        """Lower or upper limits of the joints, rad or mm; None where the table has none."""
        if end not in self._columns:
            return [None] * len(self.joints)
        cells = self.table.text(self._columns[end][0])
        turning = all(kind == "revolute" for kind in self.types)
        values = self.values(end, "angle" if turning or self._columns[end][1] in ANGLES_RAD else "length")
        return [float(values[i]) if cells[i] else None for i in self.joints]

    def fail(self, row: int, words: str) -> None:
        """Raise RobotFileError with the line of a row."""
        raise RobotFileError(f"{self.path}: line {self.table.lines[row]}: {words}")

    def chain_of_ways(self, ways: Sequence[Array], axes: Array | None = None) -> SerialChain:
        """Chain of a transform (4, 4) to each row from the one before."""
        return self.chain([ways[i] for i in self.joints], _HERE if self.tip is None else ways[self.tip], axes)

    def chain(
        self, places: Sequence[Array], end: Array, axes: Array | None = None, last_T_flange: Array = _HERE
    ) -> SerialChain:
        """Chain of the joints at origins (4, 4) in the frame before, each about its axis (3,), by default z.

        last_T_flange: where the flange is if the tip is that of a tool.
        """
        low, high = self.limits("min"), self.limits("max")
        joints = []
        for k, (name, kind, place) in enumerate(zip(self.names, self.types, places, strict=True)):
            x, y, z = (0.0, 0.0, 1.0) if axes is None else map(float, axes[k])
            joints.append(ChainJoint(name, place, (x, y, z), kind, low[k], high[k]))
        return SerialChain(
            self.path.stem, tuple(joints), end, tip_T_flange=invert(end) @ last_T_flange if self.ends_at_tool else None
        )


def _denavit_hartenberg(table: _Table, convention: str | None) -> SerialChain:
    rows = np.column_stack([table.values(key, kind) for key, kind in _KINDS.items()])  # a, d, alpha, theta
    readings = {"standard": _standard(table, rows), "modified": _modified(table, rows)}
    coinciding = {name: _same_axes(chain) for name, chain in readings.items()}
    if convention is None:
        clear = [name for name, pairs in coinciding.items() if not pairs]
        hint = f"; by its axes it looks {clear[0]}" if len(clear) == 1 else ""
        raise RobotFileError(f"{table.path}: give --convention standard or modified (Craig){hint}")
    other = next(name for name in readings if name != convention)
    if coinciding[convention] and not coinciding[other]:
        i = coinciding[convention][0]
        raise RobotFileError(
            f"{table.path}: read as {convention}, joints {i} and {i + 1} turn about one axis, and as {other} none "
            f"do; it is a {other} table: --convention {other}"
        )
    return readings[convention]


def _standard(table: _Table, rows: Array) -> SerialChain:
    ends = [row_transform((a, alpha, d, theta, 0.0)) for a, d, alpha, theta in rows]
    of_joints = [ends[i] for i in table.joints]
    end = of_joints[-1] if table.tip is None else of_joints[-1] @ ends[table.tip]
    return table.chain([_HERE, *of_joints[:-1]], end, last_T_flange=of_joints[-1])


def _modified(table: _Table, rows: Array) -> SerialChain:
    return table.chain_of_ways([modified_transform(a, alpha, d, theta) for a, d, alpha, theta in rows])


def _same_axes(chain: SerialChain) -> list[int]:
    """Numbers, from 1, of the joints that turn about the same axis as the next joint."""
    out = []
    for k, (joint, following) in enumerate(zip(chain.joints, chain.joints[1:], strict=False), 1):
        place = following.before_T_joint
        lean, off_mm = np.hypot(*place[:2, 2]), np.hypot(*place[:2, 3])
        if joint.is_revolute and following.is_revolute and lean < _SAME_AXIS_RAD and off_mm < _SAME_AXIS_MM:
            out.append(k)
    return out


def _screws(table: _Table) -> SerialChain:
    w = table.vectors(("wx", "wy", "wz"), "number")
    if table.has("px", "py", "pz"):
        p_mm = table.vectors(("px", "py", "pz"), "length")
    elif table.has("vx", "vy", "vz"):
        v_mm = table.vectors(("vx", "vy", "vz"), "moment")
        p_mm = np.cross(w, v_mm) / np.maximum(np.sum(w**2, axis=1, keepdims=True), 1e-300)
        slides = np.linalg.norm(w, axis=1) < _NO_DIRECTION
        w = np.where(slides[:, None], v_mm, w)
        p_mm[slides] = 0.0
    else:
        raise RobotFileError(
            f"{table.path}: line 1: found {table.named}; axes need points px, py, pz or moments vx, vy, vz"
        )
    of_joints = p_mm[table.joints]
    places = [make_transform(np.eye(3), step) for step in np.diff(of_joints, axis=0, prepend=np.zeros((1, 3)))]
    end = make_transform(np.eye(3), -of_joints[-1])
    if table.tip is not None:
        rpy = [table.values(key, "angle")[table.tip] if table.has(key) else 0.0 for key in _RPY]
        end = make_transform(rotation_from_rpy(rpy), p_mm[table.tip] - of_joints[-1])
    return table.chain(places, end, table.directions(w))


def _origins(table: _Table) -> SerialChain:
    turns, places = table.vectors(_RPY, "angle"), table.vectors("xyz", "length")
    ways = [make_transform(rotation_from_rpy(turn), place) for turn, place in zip(turns, places, strict=True)]
    axes = ("axisx", "axisy", "axisz")
    return table.chain_of_ways(ways, table.directions(table.vectors(axes, "number")) if table.has(*axes) else None)
