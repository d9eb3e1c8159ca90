"""Poses of the flange in a table, in every way in which its numbers may be meant.

What was measured at the poses tells which it is (`clear_reading`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset_import.place_columns import ANY_FORM, FIXED, VECTOR, XYZ, ZYX, ZYZ, PoseColumns, pose_columns
from calib.errors import CalibError
from calib.kinematics.cartesian import joints_of_poses
from calib.text_files.column_names import LENGTHS_MM, UNITS, plain, split_unit
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import UserTable

CARTESIAN_JOINTS = ("q1_mm", "q2_mm", "q3_mm", "q4_deg", "q5_deg", "q6_deg")
"""Columns of the joints of an arm that stands for poses of the flange."""
_CLEAR = 3.0  # ratio of misfits from which one reading is clearly the right one
_SAME_MM = 1e-3  # readings whose poses differ by less, 3D and over this many mm of a lever, are one
_LEVER_MM = 1000.0
_EULER = {FIXED: "xyz", ZYX: "ZYX", XYZ: "XYZ", ZYZ: "ZYZ"}  # as SciPy calls them
_REACH_M = 20.0  # places below are metres where no unit is told


@dataclass(frozen=True, eq=False)
class FlangePoses:
    """Poses of the flange as one reading of a file has them."""

    base_T_flange: Array  # (N, 4, 4) mm
    form: str  # how the numbers were read, for people
    columns: tuple[str, ...] = ()  # of a table that they were read from


def readings_of(table: UserTable, *, any_form: bool = False, what: str = "the flange") -> list[FlangePoses]:
    """Every reading of a table's poses of something, the usual ones first. Raises CalibError where there is none.

    any_form: whether three angles may be meant in any way, whatever their columns are called.
    """
    named = pose_columns(table.columns) if table.has_header else None
    choices = _by_number(table) if not table.has_header else [] if named is None else [named]
    if not choices:
        raise CalibError(
            f"{table.path}: line 1: found {', '.join(table.columns[:30])}; poses of {what} are x, y, z with "
            "rx, ry, rz, with a, b, c, with roll, pitch, yaw, or with qx, qy, qz, qw"
        )
    if any_form:
        choices = [replace(each, forms=tuple(dict.fromkeys((*each.forms, *ANY_FORM)))) for each in choices]
    found = [one for columns in choices for one in _readings(table, columns)]
    if not found:
        used = ", ".join(name for each in choices for name in each.attitude)
        raise CalibError(
            f"{table.path}: {used} are no unit quaternions and no matrices of a rotation; export them anew"
        )
    if len(table) > 1 and not np.ptp(found[0].base_T_flange, axis=0).any():
        raise CalibError(
            f"{table.path}: {what} stands at one pose in all {len(table)} rows: nothing can be learned from them; "
            "log its pose anew at each measurement"
        )
    return found


def clear_reading(
    path: Path, readings: Sequence[FlangePoses], off_mm: Sequence[float], by: str, what: str
) -> tuple[FlangePoses, str]:
    """The reading that misses what was measured least, with a note; CalibError where another is nearly as good.

    by, what: by what it is told, and what is missed, as "what the camera saw" and "the board".
    """
    best = int(np.argmin(off_mm))
    others = [off for one, off in zip(readings, off_mm, strict=True) if not _is_same(one, readings[best])]
    if others and min(others) < _CLEAR * off_mm[best]:
        raise CalibError(
            f"{path}: the attitudes may be meant in several ways, and {by} does not tell which: the best miss {what} "
            f"by {off_mm[best]:.3g} and {min(others):.3g} mm; name the columns rvec_x, rvec_y, rvec_z, or roll, pitch, "
            "yaw, or a, b, c, or qw, qx, qy, qz, and check that both are of one run"
        )
    note = f"{path}: {readings[best].form}"
    if others:
        note += f"; so the arm misses {what} by {off_mm[best]:.3g} mm rms, otherwise by {min(others):.3g} mm and more"
    return readings[best], note


def _is_same(one: FlangePoses, other: FlangePoses) -> bool:
    a, b = one.base_T_flange, other.base_T_flange
    turned = np.abs(a[:, :3, :3] - b[:, :3, :3]).max() * _LEVER_MM
    return bool(max(turned, np.abs(a[:, :3, 3] - b[:, :3, 3]).max()) < _SAME_MM)


def joints_in_place(table: UserTable, chosen: FlangePoses) -> UserTable:
    """Table with the joints of an arm that stands for the poses in place of the columns that they were read from."""
    q = joints_of_poses(chosen.base_T_flange)
    kept = [k for k, name in enumerate(table.columns) if name not in chosen.columns]
    values = np.concatenate([q[:, :3], np.degrees(q[:, 3:])], axis=1)
    columns = (*(table.columns[k] for k in kept), *CARTESIAN_JOINTS)
    rows = tuple(
        (*(cells[k] for k in kept), *map(repr, of_row.tolist()))
        for cells, of_row in zip(table.rows, values, strict=True)
    )
    return replace(table, columns=columns, rows=rows, has_header=True)


def _by_number(table: UserTable) -> list[PoseColumns]:
    """Columns of a table without a header by their number, behind names or times."""
    numbers = [name for name in table.columns if all(as_number(cell) is not None for cell in table.text(name))]
    out = []
    for count, forms in ((6, ANY_FORM), (7, ()), (12, ()), (16, ())):
        if len(numbers) in (count, count + 1):
            first = 3 if count < 12 else 0
            last = tuple(numbers[-count:])
            out.append(PoseColumns(last[:first], last[first:], forms))
    return out


def _readings(table: UserTable, columns: PoseColumns) -> list[FlangePoses]:
    """Readings of some columns; none where the numbers are no attitude of that kind."""
    faults: list[str] = []

    def numbers(names: Sequence[str]) -> Array:
        return np.column_stack([table.numbers(name, lambda fault: faults.append(str(fault))) for name in names])

    attitude = numbers(columns.attitude)
    used = (*columns.place, *columns.attitude)
    if not columns.place:
        return [] if faults else _of_matrices(attitude, used)
    unit, place = split_unit(columns.place[0])[1], numbers(columns.place)
    if faults:
        raise CalibError("\n".join(faults))
    scale, length = length_of(unit, place)
    if len(columns.attitude) == 4:
        by_name = any("w" in plain(name) for name in columns.attitude)
        orders = ((0, 1, 2, 3),) if by_name else ((0, 1, 2, 3), (3, 0, 1, 2))
        if np.abs(np.linalg.norm(attitude, axis=1) - 1.0).max() > 0.01:
            return []
        turns = [
            (f"quaternions{'' if by_name else ' w, x, y, z' if order[0] == 0 else ' x, y, z, w'}",
             frames.rotation_from_quaternion(attitude[:, order]))
            for order in orders
        ]  # fmt: skip
    else:
        told = UNITS.get(split_unit(columns.attitude[0])[1], "")
        likely = ["deg"] if np.abs(attitude).max() > 2.0 * np.pi else ["rad", "deg"]
        units = [told] if told in ("deg", "rad") else likely
        turns = [
            (f"{form} in {angle}" if form == VECTOR else f"turns about {form} in {angle}",
             _rotations(form, np.radians(attitude) if angle == "deg" else attitude))
            for form in columns.forms
            for angle in units
        ]  # fmt: skip
    return [
        FlangePoses(frames.make_transform(turn, place * scale), f"{', '.join(used)} are {length} and {how}", used)
        for how, turn in turns
    ]


def length_of(unit: str, place: Array) -> tuple[float, str]:
    """Factor of places to mm, and the unit's name: by the column's name, else by the arm's reach."""
    unit = unit if unit in LENGTHS_MM else "m" if np.abs(place).max() < _REACH_M else "mm"
    return LENGTHS_MM[unit], unit


def _of_matrices(numbers: Array, used: tuple[str, ...]) -> list[FlangePoses]:
    """Readings of rows of 12 or 16 numbers as matrices, row by row or column by column."""
    rows = numbers.reshape(len(numbers), -1, 4)
    turned = np.swapaxes(numbers.reshape(len(numbers), 4, -1), 1, 2)
    out = []
    for matrix, how in ((rows, "row by row"), (turned, "column by column")):
        rotation = matrix[:, :3, :3]
        is_whole = np.allclose(matrix[:, 3:], [0.0, 0.0, 0.0, 1.0], atol=1e-6)  # of rows of 16
        if is_whole and np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max() < 1e-2:
            scale, length = length_of("", matrix[:, :3, 3])
            form = f"its numbers are matrices, {how}, in {length}"
            out.append(FlangePoses(frames.make_transform(rotation, matrix[:, :3, 3] * scale), form, used))
    return out[:1] if len(out) == 2 and np.allclose(out[0].base_T_flange, out[1].base_T_flange) else out


def _rotations(form: str, angles_rad: Array) -> Array:
    """Rotations (N, 3, 3) of three angles (N, 3) each, or of rotation vectors."""
    from scipy.spatial.transform import Rotation

    if form == VECTOR:
        return frames.rotation_from_rotvec(angles_rad)
    return np.asarray(Rotation.from_euler(_EULER[form], angles_rad).as_matrix())
