"""Finder of three or more balls on one body, identified by the known distances between their centres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from calib.array_types import Array, IndexArray
from calib.errors import TargetError
from calib.scans.scan import Scan
from calib.target_shapes import Spheres
from calib.targets.protocol.finder import FoundPoint, Wanted
from calib.targets.spheres.sphere_finder import find_spheres

_MORE = 3  # spheres that may be in view besides
_SIGMAS = 6.0
_SLACK_MM = 0.3  # by which a distance on the drawing, or in another temperature, may differ
_CLEARER = 3.0  # times the misfit of the best naming, that the next-best has to have


@dataclass(frozen=True)
class _Naming:
    """Names for some of the balls found, and the misfit of the distances between them."""

    which: IndexArray  # (K,) of the balls found
    names: IndexArray  # (K,) of the shape's
    misfit_mm: float  # the largest of the distances' errors


def find_constellation(scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Centres of the balls, each with its name, or without where the distances do not identify them.

    At least two have to be seen. Raises TargetError where they are not found.
    """
    shape = wanted.shape
    assert isinstance(shape, Spheres)
    many = replace(wanted, names=tuple(map(str, range(len(shape.names) + _MORE))))
    places = find_spheres(scan, many)
    if len(places) < 2:
        raise TargetError(
            f"1 sphere is in view, which says not which of {', '.join(shape.names)} it is; clear the view to more"
        )
    distances = _matrix(shape)
    centres = np.array([place.xyz_mm for place in places])
    sigma_mm = max(place.sigma_mm() for place in places)
    slack_mm = _SLACK_MM + _SIGMAS * np.sqrt(2) * sigma_mm
    for count in range(min(len(places), len(shape.names)), 1, -1):
        namings = _namings(centres, distances, count, slack_mm)
        if not namings:
            continue
        best = namings[0]
        others = [n for n in namings[1:] if n.misfit_mm < max(_CLEARER * best.misfit_mm, slack_mm)]
        if any(set(other.which) != set(best.which) for other in others):
            raise TargetError(
                f"of {len(places)} spheres in view several sets fit distances_mm, to {best.misfit_mm:.2g} and "
                f"{others[0].misfit_mm:.2g} mm; use distances that differ, or show all spheres"
            )
        if others:  # these balls, but not which is which: the robot decides
            return [places[k] for k in best.which]
        pairs = zip(best.which, best.names, strict=True)
        return [replace(places[k], name=shape.names[name]) for k, name in pairs]
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)[np.triu_indices(len(centres), 1)]
    raise TargetError(
        f"{len(places)} spheres are in view, {', '.join(f'{d:.4g}' for d in np.sort(apart))} mm apart, none as "
        f"distances_mm has it ({', '.join(f'{d:g}' for d in shape.distances_mm)}); check them in dataset.toml"
    )


def _matrix(shape: Spheres) -> Array:
    """Declared distances between the balls as a symmetric matrix (S, S), mm."""
    count = len(shape.names)
    distances = np.zeros((count, count))
    distances[np.triu_indices(count, 1)] = shape.distances_mm
    return distances + distances.T


def _namings(centres: Array, distances: Array, count: int, slack_mm: float) -> list[_Naming]:
    """All ways to name `count` of the centres (B, 3) that agree with the distances (S, S), the best first."""
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    i, j = np.triu_indices(count, 1)
    of_names = np.array(list(permutations(range(len(distances)), count)), dtype=np.int64)
    namings = []
    for which in map(np.array, combinations(range(len(centres)), count)):
        seen = apart[np.ix_(which, which)][i, j]
        misfit = np.abs(distances[of_names[:, i], of_names[:, j]] - seen).max(axis=1)
        namings += [_Naming(which, of_names[k], float(misfit[k])) for k in np.flatnonzero(misfit < slack_mm)]
    return sorted(namings, key=lambda naming: naming.misfit_mm)
