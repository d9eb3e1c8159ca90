"""Check of the length unit of a scan without a jig: names a unit in which a jig is found, but scales no scan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array
from calib.jig import Jig
from calib.planes.point_selection import finite_rows
from calib.units import UNITS_MM

MOST_EDGES = 400.0  # across, in edges of the jig: a hall; larger scans are not searched
_ENOUGH = 5000  # points, to know how far a scan reaches
_LEAST_EDGES = 0.5  # scans smaller than a face are not searched either
# Across in edges, of a scan in millimetres that shows the jig; beyond, where no jig is found, its unit is in doubt.
_USUAL_EDGES = (1.0, 200.0)


def some_finite(points_mm: Array) -> Array:
    """Some thousands of the points (N, 3) with finite coordinates, or all of them where there are fewer."""
    some = points_mm[:: max(1, len(points_mm) // (2 * _ENOUGH))]
    some = some[finite_rows(some)]
    if len(some) >= _ENOUGH:
        return some
    finite = np.flatnonzero(finite_rows(points_mm))
    return points_mm.take(finite[:: max(1, len(finite) // _ENOUGH)], axis=0)


def extent_of(points_mm: Array) -> float:
    """Longest side of the box about points (N, 3), the outer 2 % left out as stray points; 0 where there are none."""
    points = some_finite(points_mm)
    if len(points) == 0:
        return 0.0
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    return float(np.max(high - low))


def failure_with_unit(failure: str, points_mm: Array, jig: Jig, is_found: Callable[[Array], bool]) -> str:
    """Reason why a scan (N, 3) has no corner, extended by what its size says about its unit.

    For a scan that is smaller than the jig or far larger, the other units are tried in which its size would fit;
    `is_found` searches points for the jig. A jig has the outline that edge_mm gives it in one unit only, so the unit in
    which it is found is the scan's.
    """
    extent, edge, longest = extent_of(points_mm), jig.shortest_mm, jig.longest_mm
    if _USUAL_EDGES[0] * edge <= extent <= _USUAL_EDGES[1] * longest or extent <= 0.0:
        return failure
    tried = []
    for unit, factor in UNITS_MM.items():
        if _LEAST_EDGES * edge <= factor * extent <= MOST_EDGES * longest:
            if is_found(factor * points_mm):
                return (
                    f"the scan spans {extent:.3g} mm, the jig has {jig.edges_text()}: the scan seems to be in {unit}, "
                    f"for with coordinates times {factor:g} the jig is found; multiply them by {factor:g}, or "
                    "correct edge_mm in dataset.toml"
                )
            tried.append(unit)
    if not tried:
        return failure
    units = " or ".join(tried)
    return f"{failure}; it spans {extent:.3g} mm, and taken for {units} it shows no jig either: check its unit"
