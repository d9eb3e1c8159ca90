"""Measured lengths, of a draw wire or a ball bar, as points that are known along one line each.

A length L from an anchor, whose place is not known, tells one coordinate of the target: that along the line of sight
u = (p - a) / |p - a| from the anchor a to where the target p is predicted. So it is kept as the point L u in a frame
that starts at the anchor, with its direction u; a fit takes the error along u alone, and finds the frame's origin as it
finds a scanner's. `with_directions` makes the lines anew from a better prediction. The first come from the nominal arm,
with each anchor where the lengths meet best.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, IndexArray, Vector
from calib.dataset.dataset import Lengths, Points, Poses
from calib.errors import DatasetError
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot

_FEWEST = 4  # lengths from which an anchor's place follows
_STEPS = 60
_STARTS = 24  # directions around the arm in which an anchor is looked for


def length_points(
    robot: Robot, poses: Poses, pose: IndexArray, target: NDArray[np.str_], length_mm: Array, anchor: NDArray[np.str_]
) -> Points:
    """Points of M measured lengths, with directions by the nominal arm. Raises DatasetError for too few of one."""
    lengths = Lengths(length_mm, anchor, np.zeros((len(length_mm), 3)), np.full((len(length_mm), 3), np.nan))
    points = Points(pose, np.zeros((len(pose), 3)), target, lengths=lengths)
    predicted_mm = _nominal_mm(robot, poses, points)
    setup = poses.setup[pose]
    seen_mm = np.zeros_like(predicted_mm)
    for name in np.unique(np.column_stack([setup, anchor]), axis=0):
        rows = (setup == name[0]) & (anchor == name[1])
        if np.count_nonzero(rows) < _FEWEST:
            raise DatasetError(
                f"anchor {str(name[1])!r}: {np.count_nonzero(rows)} lengths; its place needs {_FEWEST} or more"
            )
        seen_mm[rows] = predicted_mm[rows] - _anchor(predicted_mm[rows], length_mm[rows])
    return with_directions(points, seen_mm)


def with_known_anchors(points: Points, robot: Robot, poses: Poses, places_mm: Mapping[str, Vector]) -> Points:
    """The lengths with the places of some anchors known, by name: mm, base frame."""
    assert points.lengths is not None
    lengths = points.lengths
    known = np.isin(lengths.anchor, list(places_mm))
    place_mm = lengths.place_mm.copy()
    place_mm[known] = [places_mm[str(name)] for name in lengths.anchor[known]]
    seen_mm = np.where(known[:, None], _nominal_mm(robot, poses, points) - place_mm, points.xyz_mm)
    return with_directions(replace(points, lengths=replace(lengths, place_mm=place_mm)), seen_mm)


def with_directions(points: Points, seen_mm: Array) -> Points:
    """The lengths with the lines to where the targets are predicted, (M, 3) mm from the anchors."""
    assert points.lengths is not None
    direction = seen_mm / np.maximum(np.linalg.norm(seen_mm, axis=1), 1e-9)[:, None]
    lengths = replace(points.lengths, direction=direction)
    return replace(points, xyz_mm=lengths.length_mm[:, None] * direction, lengths=lengths)


def _nominal_mm(robot: Robot, poses: Poses, points: Points) -> Array:
    """Position (M, 3) of each point's target by the nominal arm, base frame, mm."""
    chain = nominal_chain(robot, poses.q)
    out = chain.target_mm[points.pose].copy()
    for target in robot.targets:
        rows = points.target == target.name
        link = chain.base_T_link(target.joint)[points.pose[rows]]
        out[rows] = link[:, :3, :3] @ np.array(target.xyz_mm) + link[:, :3, 3]
    return out


def _anchor(places_mm: Array, length_mm: Array) -> Array:
    """Place (3,), mm, from which places (M, 3) have given lengths (M,) as nearly as possible, of many starts."""
    centre, reach = places_mm.mean(axis=0), float(length_mm.mean())
    starts = _directions(_STARTS) * reach + centre
    return min((_settled(start, places_mm, length_mm) for start in starts), key=lambda found: found[1])[0]


def _settled(start: Array, places_mm: Array, length_mm: Array) -> tuple[Array, float]:
    """Anchor found from a start by damped least squares, and its squared error."""
    anchor, damping = start, 1e-3
    error = np.linalg.norm(places_mm - anchor, axis=1) - length_mm
    for _ in range(_STEPS):
        away = anchor - places_mm
        rows = away / np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
        normal = rows.T @ rows
        step = -np.linalg.solve(normal + damping * np.trace(normal) * np.eye(3), rows.T @ error)
        after = np.linalg.norm(places_mm - anchor - step, axis=1) - length_mm
        if after @ after < error @ error:
            anchor, error, damping = anchor + step, after, 0.3 * damping
            if np.linalg.norm(step) < 1e-9:
                break
        else:
            damping *= 4.0
    return anchor, float(error @ error)


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) that are spread evenly (a spiral on the sphere)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
