"""Units and quaternion order of a dataset's tables, from `[units]` of dataset.toml or the columns' names.

Columns carry their unit in their name: q1_deg or q1_rad, x_mm or x_m. After reading, angles are rad and lengths mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.dataset.files.csv_table import TableFile
from calib.errors import DatasetError
from calib.text_files.toml_table import TomlTable

QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
QUATERNION_ORDERS = ("wxyz", "xyzw")


@dataclass(frozen=True)
class DeclaredUnits:
    """Units that `[units]` declares; "" where it declares none and the columns' names decide."""

    angle: str = ""  # of the joints: "deg" or "rad"
    length: str = ""  # of prismatic joints and points: "mm" or "m"
    quaternion: str = ""  # what the four columns hold from left to right: "wxyz" or "xyzw"


NOT_DECLARED = DeclaredUnits()


def load_units(table: TomlTable) -> DeclaredUnits:
    """Units declared in [units]. Raises DatasetError for an unknown key or unit."""
    units = DeclaredUnits(
        angle=table.text("angle", "", choices=("deg", "rad")) or "",
        length=table.text("length", "", choices=("mm", "m")) or "",
        quaternion=table.text("quaternion", "", choices=QUATERNION_ORDERS) or "",
    )
    for key, value in table.unread().items():
        raise table.error(key, f"found {value!r}", "there are angle, length and quaternion")
    return units


def unit_of(file: TableFile, columns: Mapping[str, Sequence[str]], declared: str) -> str:
    """The unit of a table: the declared one, else the unit in its columns' names.

    `columns` has the names by unit, the usual unit first; it is taken where columns of both are complete.

    Raises:
        DatasetError: columns of both units and neither complete, or only those of the unit that is not declared.
    """
    there = {unit: [name for name in names if name in file] for unit, names in columns.items()}
    other = next((unit for unit in columns if unit != declared and there[unit]), "")
    if declared and not there[declared] and other:
        raise DatasetError(
            f"{file.path}: line 1: found {there[other][0]}, and [units] of dataset.toml says {declared}; name the "
            f"columns {columns[declared][0]} ... if they are {declared}, else correct [units]"
        )
    if declared:
        return declared
    complete = [unit for unit, names in columns.items() if names and len(there[unit]) == len(names)]
    if complete:
        return complete[0]
    found = [unit for unit, names in there.items() if names]
    if len(found) > 1:
        raise DatasetError(
            f"{file.path}: line 1: found {there[found[0]][0]} and {there[found[1]][0]}; give all of them in one unit, "
            f"{' or '.join(columns)}"
        )
    return found[0] if found else next(iter(columns))


def internal(values: Array, columns: Sequence[str]) -> Array:
    """Values (N, n) converted to rad and mm from the units that the n columns' names end with."""
    out = values.copy()
    for k, name in enumerate(columns):
        if name.endswith("_deg"):
            out[:, k] = np.radians(values[:, k])
        elif name.endswith("_m"):
            out[:, k] = values[:, k] * 1000.0
    return out


def quaternion_order(file: TableFile, declared: str) -> tuple[str, ...]:
    """Names of the columns that hold w, x, y and z: as named, or from left to right in the declared order."""
    if not declared:
        return QUATERNION_COLUMNS
    left_to_right = [name for name in file.cells if name in QUATERNION_COLUMNS]
    by_part = dict(zip(declared, left_to_right, strict=True))
    return tuple(by_part[part] for part in "wxyz")
