"""Points as total stations and trackers tell them: two angles and a distance, in every way that they may be meant.

Azimuths count from x to y or, as a total station's, from north (y) to east (x); heights are counted from the zenith or
from the horizon. The way is the one in which the arm meets the points (`calib.dataset_import.plan`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.dataset_import.column_words import POLAR
from calib.dataset_import.place_columns import Triple, point_columns
from calib.text_files.column_names import ANGLES_RAD, GON_RAD, plain, split_unit
from calib.text_files.user_table import UserTable

_ANGLES = ANGLES_RAD | {"gon": GON_RAD}
_TURNS = (("rad", 2.0 * np.pi), ("deg", 360.0), ("gon", 400.0))


def polar_columns(names: Sequence[str]) -> dict[str, str]:
    """Columns of an azimuth, a height and a distance by their kind; {} where there are not all, or x, y, z as well."""
    named = {plain(split_unit(name)[0]): name for name in reversed(names)}
    found = {kind: named[word] for kind, words in POLAR.items() for word in reversed(words) if word in named}
    heights = [kind for kind in ("zenith", "elevation", "height") if kind in found]
    is_whole = heights and {"azimuth", "distance"} <= set(found) and len(point_columns(names)) < 3
    return {kind: found[kind] for kind in ("azimuth", heights[0], "distance")} if is_whole else {}


def with_places(table: UserTable) -> tuple[UserTable, list[Triple]]:
    """The table with places in place of angles and distances, and the columns of each reading of them; [] of none."""
    polar = polar_columns(table.columns) if table.has_header else {}
    if not polar:
        return table, []
    azimuth, up, distance = (table.numbers(name, lambda _: None) for name in polar.values())
    told, unit = (split_unit(polar[kind])[1] for kind in ("azimuth", "distance"))
    largest = float(np.nanmax(np.abs([azimuth, up])))
    likely = [unit for unit, turn in _TURNS if largest <= 1.001 * turn][: 1 if largest <= _TURNS[0][1] else None]
    columns: dict[str, list[str]] = {n: table.text(n) for n in table.columns if n not in polar.values()}
    readings: list[Triple] = []
    for angle in [told] if told in _ANGLES else likely:
        turn, height = _ANGLES[angle] * azimuth, _ANGLES[angle] * up
        for above in [np.pi / 2.0 - height] * ("elevation" not in polar) + [height] * ("zenith" not in polar):
            x, y, z = np.cos(above) * np.cos(turn), np.cos(above) * np.sin(turn), np.sin(above)
            for places in ((x, y, z), (y, x, z)):
                ends = (f"reading {len(readings) + 1}{letter}" for letter in "abc") if readings else iter("xyz")
                a, b, c = (f"{end} [{unit}]" if unit else end for end in ends)
                readings.append((a, b, c))
                for name, axis in zip(readings[-1], places, strict=True):
                    columns[name] = ["" if np.isnan(v) else repr(v) for v in (distance * axis).tolist()]
    rows = tuple(zip(*columns.values(), strict=True))
    return replace(table, columns=tuple(columns), rows=rows), readings
