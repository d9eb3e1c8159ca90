"""Solids of an arm: a capsule along each straight piece of its chain, with a radius estimated from its lengths.

A row of the table leads from one frame to the next in two straight pieces, d along the joint's axis and a across it.
The jig's holder is a straight rod from the flange to the jig's back. A link whose mesh is known is a capsule around
that mesh instead, and the mesh itself for lines of sight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import tip_T_last
from calib.workcell.bodies.distances import between_segments
from calib.workcell.bodies.link_mesh import LinkMesh

FIRST_THICKNESS, LAST_THICKNESS = 0.045, 0.033  # radius over the links' lengths: RB5, Panda, UR10e
LEAST_MM = 30.0  # radius of a guessed body
TOOL_MM = 20.0  # radius of the jig's holder
SCANNER_MM = 60.0  # radius of a scanner on the flange, about its eye
USUAL_REACH_MM = 500.0  # of an arm whose table is all zero
ALONG_D, ALONG_A, FIXED = 0, 1, 2  # piece of the chain that a body follows, or fixed in its link's frame
_SHORTEST = 1e-3  # of the reach: a shorter piece is no body
_ALWAYS = 0.3  # of random poses: pairs that meet at more of them do so by the guess of their shape


def reach_mm(robot: Robot) -> float:
    """Reach of the arm, mm: all its lengths in one line, prismatic joints extended to their limits."""
    lengths = float(np.abs(robot.table[:-1, [0, 2]]).sum())
    strokes = sum(max(abs(j.min or 0.0), abs(j.max or 0.0)) for j in robot.joints if not j.is_revolute)
    return lengths + strokes or USUAL_REACH_MM


@dataclass(frozen=True)
class ArmBodies:
    """Capsules (K) that approximate an arm, each fixed to the link of a row of the table (n: the tool).

    Their places at a pose follow from the chain; those marked FIXED keep their place in their link's frame.
    """

    link: IndexArray  # (K,)
    radius_mm: Array  # (K,)
    piece: IndexArray  # (K,) ALONG_D, ALONG_A, or FIXED in the link's frame
    start_mm: Array  # (K, 3) in the link's frame, of fixed ones
    end_mm: Array  # (K, 3)
    shortened_mm: Array  # (K,) by which the far end stops early, so that its round end does
    hides: BoolArray  # (K,) whether a face behind it is hidden: not of the jig's own body
    static: BoolArray  # (K,) of those fixed to the floor, which no joint moves
    pairs: IndexArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.intp))  # that may touch
    meshes: Mapping[int, LinkMesh] = field(default_factory=dict)  # by row of the table

    def __len__(self) -> int:
        return len(self.link)

    def at(self, chain: Chain) -> tuple[Array, Array]:
        """Ends of the capsules' axes, (N, K, 3) each, base frame."""
        previous, current = chain.base_T_frame[:, self.link], chain.base_T_frame[:, self.link + 1]
        start, end = previous[..., :3, 3], current[..., :3, 3]
        x = chain.turned_x[:, self.link]
        knee = end - np.einsum("nki,nki->nk", end - start, x)[..., None] * x
        fixed = (self.piece == FIXED)[:, None]
        placed = [np.einsum("nkij,kj->nki", current[..., :3, :3], p) + end for p in (self.start_mm, self.end_mm)]
        first = np.where(fixed, placed[0], np.where((self.piece == ALONG_D)[:, None], start, knee))
        last = np.where(fixed, placed[1], np.where((self.piece == ALONG_D)[:, None], knee, end))
        along = last - first
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        kept = np.clip(1.0 - self.shortened_mm[:, None] / np.maximum(length, 1e-9), 0.0, 1.0)
        return first, first + kept * along

    def thinner(self, share: float) -> ArmBodies:
        """Bodies with estimated radii multiplied by `share`; bodies with a mesh, and the jig, stay."""
        guessed = self.piece != FIXED
        return replace(
            self,
            radius_mm=np.where(guessed, share, 1.0) * self.radius_mm,
            shortened_mm=np.where(self.link < self.link.max(initial=-1), share, 1.0) * self.shortened_mm,
        )


@dataclass(frozen=True)
class _Body:
    """One capsule, with the fields of `ArmBodies`."""

    link: int
    radius_mm: float
    piece: int
    shortened_mm: float = 0.0
    start_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    end_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    hides: bool = True
    static: bool = False


_NONE = _Body(0, 0.0, FIXED)  # gives empty columns their kind


def arm_bodies(
    robot: Robot,
    jig: Jig | None,
    tool_T_jig: Array,
    meshes: Mapping[int, LinkMesh] | None = None,
    flange_T_scanner: Array | None = None,
) -> ArmBodies:
    """Bodies of the arm, with estimated radii where no mesh is known.

    Args:
        jig: None: a mirror or a ball, without a body.
        tool_T_jig: (4, 4) pose of the jig on the tool.
        meshes: by row of the table, counted from 0, each in its link's own frame.
        flange_T_scanner: (4, 4) where the arm carries the scanner, which then is a body and sees past the wrist.
    """
    meshes = meshes or {}
    reach = reach_mm(robot)
    n = robot.n_joints
    lengths_mm = np.abs(robot.table[:-1, [0, 2]]).sum()  # a beam is no thicker for its stroke
    thick = np.linspace(FIRST_THICKNESS, LAST_THICKNESS, n) * lengths_mm
    radii = np.maximum(thick, LEAST_MM)
    back_mm, jig_radius_mm = (0.0, 0.0) if jig is None else jig_size(jig)
    bodies: list[_Body] = []
    for i in range(n):
        if i in meshes:
            start, end, radius = meshes[i].bounding_capsule()
            bodies.append(_Body(i, radius, FIXED, start_mm=tuple(start), end_mm=tuple(end)))
            continue
        lengths = (robot.table[i, 2], robot.table[i, 0])
        slides = not robot.joints[i].is_revolute
        pieces = [k for k in (ALONG_D, ALONG_A) if abs(lengths[k]) > _SHORTEST * reach or (k == 0 and slides)]
        for piece in pieces:
            flat = i == n - 1 and piece == pieces[-1]  # the flange
            bodies.append(_Body(i, radii[i], piece, radii[i] * flat, static=i == 0 and piece == ALONG_D))
    flange, held = tip_T_last(robot)[:3, 3], tool_T_jig[:3, 3] + max(back_mm, 0.0) * tool_T_jig[:3, 2]
    if np.linalg.norm(held - flange) > TOOL_MM:  # straight to the jig, behind which it ends
        bodies.append(_Body(n, TOOL_MM, FIXED, TOOL_MM, tuple(flange), tuple(held)))
    if jig is not None:
        middle = tuple(tool_T_jig[:3, :3] @ [0.0, 0.0, 0.5 * back_mm] + tool_T_jig[:3, 3])
        radius = float(np.hypot(0.5 * back_mm, jig_radius_mm))
        bodies.append(_Body(n, radius, FIXED, start_mm=middle, end_mm=middle, hides=False))
    if flange_T_scanner is not None:
        bodies = [replace(body, hides=body.hides and body.link < n - 2) for body in bodies]
        eye = tuple(flange_T_scanner[:3, 3])
        bodies.append(_Body(n - 1, SCANNER_MM, FIXED, start_mm=eye, end_mm=eye, hides=False))
    columns = {
        each.name: np.array([getattr(body, each.name) for body in (*bodies, _NONE)])[:-1] for each in fields(_Body)
    }
    arm = ArmBodies(**columns, meshes=dict(meshes))
    return replace(arm, pairs=_pairs(robot, arm))


def jig_size(jig: Jig) -> tuple[float, float]:
    """Depth of the edges' ends behind the jig's apex (negative: before) and their distance from the jig's axis, mm."""
    edges, _ = jig_geometry(jig)
    back_mm = float(edges[:, 2].mean())
    return back_mm, float(np.linalg.norm(edges - [0.0, 0.0, back_mm], axis=1).max())


def _pairs(robot: Robot, bodies: ArmBodies) -> IndexArray:
    """Pairs (M, 2) of capsules to check for collision: on links not adjacent, and not touching at nearly all poses."""
    first, second = np.triu_indices(len(bodies), 1)
    apart = np.abs(bodies.link[first] - bodies.link[second]) > 1
    pairs = np.column_stack([first[apart], second[apart]])
    q = random_poses(robot, 200, rng=np.random.default_rng(0))
    meet = touching(bodies, *bodies.at(nominal_chain(robot, q)), pairs)
    return pairs[meet.mean(axis=0) < _ALWAYS]


def touching(bodies: ArmBodies, start_mm: Array, end_mm: Array, pairs: IndexArray) -> BoolArray:
    """Mask (N, M): whether pairs of bodies meet, for axes from start to end (N, K, 3)."""
    i, j = pairs.T
    apart = between_segments(start_mm[:, i], end_mm[:, i], start_mm[:, j], end_mm[:, j])
    return apart < bodies.radius_mm[i] + bodies.radius_mm[j]
