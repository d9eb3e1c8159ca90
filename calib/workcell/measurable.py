"""Check whether joint vectors can be measured in a cell, with the first reason against each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.array_types import Array, BoolArray
from calib.frames import apply, invert
from calib.jig import jig_geometry
from calib.kinematics.chain import Chain, joint_jacobian
from calib.workcell.bodies.arm_bodies import reach_mm, touching
from calib.workcell.bodies.distances import between_segments, pass_box, to_box
from calib.workcell.bodies.sight import hidden_by_arm, on_faces
from calib.workcell.workcell import Workcell

LIMIT = "beyond a joint's limit"
FIELD = "outside the scanner's field"
STEEP = "a face too steep"
SINGULAR = "near a singularity"
FLOOR = "the arm in the floor"
BOX = "the arm in a box"
SCANNER = "the arm at the scanner"
ROOM_TARGET = "the arm at the target"
SELF = "the arm in itself"
HIDDEN = "a face hidden by the arm"
BOX_HIDES = "a face hidden by a box"
REASONS = (LIMIT, FIELD, STEEP, SINGULAR, FLOOR, BOX, SCANNER, ROOM_TARGET, SELF, HIDDEN, BOX_HIDES)
"""Reasons in the order of the checks: a pose gets the first that holds."""

_ROUNDING = 1e-9  # rad or mm: a joint commanded to its limit is within it
_SCANNER_RADIUS_MM = 100.0
_ROOM_TARGET_MM = 30.0  # about a target in the room that no body of the arm enters


@dataclass(frozen=True)
class Measurable:
    """Result for N poses: the first of REASONS why each cannot be measured, "" where it can."""

    reason: NDArray[np.str_]  # (N,)

    @property
    def ok(self) -> BoolArray:
        """Mask (N,): whether each pose can be measured."""
        return self.reason == ""


def counted(reasons: Sequence[NDArray[np.str_]]) -> str:
    """Counts of the reasons, the most frequent first: "3100 outside the scanner's field, 12 the arm in a box"."""
    named, times = np.unique(np.concatenate([*reasons, np.array([], dtype=str)]), return_counts=True)
    order = np.argsort(-times, kind="stable")
    return ", ".join(f"{times[k]} {named[k]}" for k in order if named[k])


def measurable(cell: Workcell, q: ArrayLike) -> Measurable:
    """Check of joints (N, n), rad or mm, against all known facts of the cell, cheap and frequent reasons first."""
    q = np.atleast_2d(np.asarray(q, dtype=float))
    reason = np.full(len(q), "", dtype=f"<U{max(map(len, REASONS))}")
    poses = _ArmPoses(cell, q, cell.chain(q))
    remaining = np.arange(len(q))
    for name, refuses in _CHECKS:
        refused = refuses(poses)
        if refused is None or not refused.any():
            continue
        reason[remaining[refused]] = name
        remaining, poses = remaining[~refused], poses.take(~refused)
    return Measurable(reason)


@dataclass(frozen=True)
class _ArmPoses:
    """The arm at N poses in its cell."""

    cell: Workcell
    q: Array  # (N, n)
    chain: Chain

    def take(self, rows: BoolArray) -> _ArmPoses:
        """The poses that a mask (N,) selects."""
        chain = Chain(self.chain.base_T_frame[rows], self.chain.turned_x[rows])
        return replace(self, q=self.q[rows], chain=chain)

    @property
    def base_T_scanner(self) -> Array | None:
        """Frames (N, 4, 4) of the scanner; None where its place is not known."""
        return self.cell.scanner_at(self.chain)

    @property
    def eye_mm(self) -> Array | None:
        """Positions (N, 3) of the scanner, base frame; None where it is not known."""
        placed = self.base_T_scanner
        return None if placed is None else placed[:, :3, 3]

    @property
    def target_mm(self) -> Array:
        """Positions (N, 3) of the jig's apex or of the target in the room, base frame."""
        target = self.cell.room_target
        return self.chain.target_mm if target is None else np.broadcast_to(target.place_mm, (len(self.q), 3))

    @property
    def base_T_jig(self) -> Array:
        """Poses (N, 4, 4) of the jig, base frame."""
        return self.chain.base_T_frame[:, -1] @ self.cell.tool_T_jig

    def jig_points_mm(self) -> Array:
        """Points (N, P, 3) that the scanner has to see, base frame: points on the faces, or the target itself."""
        if self.cell.jig is None:
            return self.target_mm[:, None]
        return on_faces(self.base_T_jig, jig_geometry(self.cell.jig)[0])


def _beyond_limit(at: _ArmPoses) -> BoolArray:
    """Mask (N,): whether a joint is beyond its range."""
    beyond = (at.q < at.cell.low - _ROUNDING) | (at.q > at.cell.high + _ROUNDING)
    return np.asarray(beyond.any(axis=1))


def _outside_field(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether what is to be seen is outside the scanner's field; None where the field is not known."""
    cut = None if at.cell.in_view is None else ~at.cell.in_view.shows_all(at.chain.base_T_flange)
    placed = at.base_T_scanner
    if at.cell.field is None or placed is None:
        return cut
    outside = ~at.cell.field.contains(apply(invert(placed), at.target_mm))
    return outside if cut is None else cut | outside


def _too_steep(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): a face is seen at too large an incidence; None where the scanner's place or the jig is not known."""
    if at.cell.in_view is not None:
        return at.cell.in_view.too_steep(at.chain.base_T_flange)
    if at.cell.room_target is not None and at.eye_mm is not None:
        return ~at.cell.room_target.sees(at.eye_mm)
    if at.eye_mm is None or at.cell.jig is None or at.cell.field is None:
        return None
    cosine = incidence_cosines(at.base_T_jig, jig_geometry(at.cell.jig)[1], at.eye_mm)
    return np.any(cosine < np.cos(np.radians(at.cell.field.max_incidence_deg)), axis=1)


def incidence_cosines(base_T_jig: Array, normals: Array, eye_mm: Array) -> Array:
    """Cosines (N, 3) of the angles at the apex between face normals and the line to the scanner, (3,) or (N, 3)."""
    to_eye = eye_mm - base_T_jig[:, :3, 3]
    to_eye = to_eye / np.linalg.norm(to_eye, axis=1, keepdims=True)
    return np.einsum("nij,kj,ni->nk", base_T_jig[:, :3, :3], normals, to_eye, optimize=True)


def _near_singularity(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether the manipulability is below the cell's limit; None where the cell has no limit."""
    if at.cell.least_manipulability <= 0.0:
        return None
    return manipulability(at.cell, at.chain) < at.cell.least_manipulability


def manipulability(cell: Workcell, chain: Chain) -> Array:
    """Least over largest singular value (N,) of the Jacobian, rotations times a third of the reach; 0 where singular.

    An arm of fewer than six joints has as many singular values as joints. A prismatic joint's unit is a third of the
    reach too, so that the ratio has no unit.
    """
    third_mm = reach_mm(cell.robot) / 3.0
    moved, axes = joint_jacobian(chain, cell.robot.is_revolute)
    unit = np.where(cell.robot.is_revolute, 1.0, third_mm)
    values = np.linalg.svd(np.concatenate([moved / third_mm, axes], axis=1) * unit, compute_uv=False)
    return values[:, -1] / np.maximum(values[:, 0], 1e-12)


def _in_floor(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether a moving body is below the floor; None where there is no floor."""
    if at.cell.floor_z_mm is None or not len(at.cell.bodies):
        return None
    start, end, radius = _moving(at)
    lowest = np.minimum(start[..., 2], end[..., 2]) - radius
    return np.any(lowest < at.cell.floor_z_mm, axis=1)


def _in_box(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether a moving body is in one of the cell's boxes; None where there are none."""
    if not at.cell.boxes or not len(at.cell.bodies):
        return None
    start, end, radius = _moving(at)
    refused = np.zeros(len(at.q), dtype=bool)
    for box in at.cell.boxes:
        refused |= np.any(to_box(start, end, np.array(box.min_mm), np.array(box.max_mm)) < radius, axis=1)
    return refused


def _at_scanner(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether a moving body is within 100 mm of a scanner in the room; None where its place is not known."""
    if at.cell.base_T_scanner is None or at.cell.jig is None or not len(at.cell.bodies):
        return None
    return _is_near(at, at.cell.base_T_scanner[:3, 3], _SCANNER_RADIUS_MM)


def _at_room_target(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether a moving body is within 30 mm of a target in the room; None where there is none."""
    if at.cell.room_target is None or not len(at.cell.bodies):
        return None
    return _is_near(at, at.cell.room_target.place_mm, _ROOM_TARGET_MM)


def _is_near(at: _ArmPoses, place_mm: Array, clearance_mm: float) -> BoolArray:
    """Mask (N,): whether a moving body is nearer to a place (3,), base frame, than a clearance."""
    start, end, radius = _moving(at)
    return np.any(between_segments(start, end, place_mm, place_mm) < radius + clearance_mm, axis=1)


def _moving(at: _ArmPoses) -> tuple[Array, Array, Array]:
    """Ends (N, K, 3) and radii (K,) of the bodies that the joints move."""
    bodies = at.cell.bodies
    start, end = bodies.at(at.chain)
    return start[:, ~bodies.static], end[:, ~bodies.static], bodies.radius_mm[~bodies.static]


def _in_itself(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether two bodies of the arm collide; None where no pair of bodies can."""
    bodies = at.cell.bodies
    if not len(bodies.pairs):
        return None
    return np.asarray(touching(bodies, *bodies.at(at.chain), bodies.pairs).any(axis=1))


def _arm_hides(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether the arm hides a face from the scanner; None where the scanner's place is not known."""
    if at.eye_mm is None or not len(at.cell.bodies):
        return None
    return np.asarray(hidden_by_arm(at.cell.bodies, at.chain, at.eye_mm, at.jig_points_mm()).any(axis=1))


def _box_hides(at: _ArmPoses) -> BoolArray | None:
    """Mask (N,): whether a box hides a face from the scanner; None where scanner or boxes are not known."""
    if at.eye_mm is None or not at.cell.boxes:
        return None
    points_mm = at.jig_points_mm()
    refused = np.zeros(len(at.q), dtype=bool)
    for box in at.cell.boxes:
        refused |= np.any(pass_box(at.eye_mm[:, None], points_mm, np.array(box.min_mm), np.array(box.max_mm)), axis=1)
    return refused


def collides(cell: Workcell, q: Array) -> BoolArray:
    """Mask (N,): whether the arm at joints (N, n) collides with the floor, a box, the scanner or itself."""
    poses = _ArmPoses(cell, q, cell.chain(q))
    hits = np.zeros(len(q), dtype=bool)
    for _, refuses in _COLLISIONS:
        refused = refuses(poses)
        if refused is not None:
            hits |= refused
    return hits


_Check: TypeAlias = tuple[str, Callable[[_ArmPoses], BoolArray | None]]

_COLLISIONS: tuple[_Check, ...] = (
    (FLOOR, _in_floor),
    (BOX, _in_box),
    (SCANNER, _at_scanner),
    (ROOM_TARGET, _at_room_target),
    (SELF, _in_itself),
)
_CHECKS: tuple[_Check, ...] = (
    (LIMIT, _beyond_limit),
    (FIELD, _outside_field),
    (STEEP, _too_steep),
    (SINGULAR, _near_singularity),
    *_COLLISIONS,
    (HIDDEN, _arm_hides),
    (BOX_HIDES, _box_hides),
)
