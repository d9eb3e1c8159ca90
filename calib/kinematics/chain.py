"""The five-parameter chain and its analytic Jacobian, all poses at once.

Frame i: `Rz(theta_i + q_i) Trans(a_i, 0, d_i) Rx(alpha_i) Ry(beta_i)` (Jang 2025 eq 3; Park 2022 section 2; beta is
Hayati's parameter for consecutive parallel axes). The tool row closes the chain with the same form and no q.

A change of a parameter moves all that lies beyond it: by a shift along an axis for d and a, by a turn about one for
theta, alpha and beta. So the Jacobian of a point p (Jang eq 8) follows from the frames of the forward pass:

    dp/dtheta_i = z_(i-1) x (p - o_(i-1))     dp/dd_i = z_(i-1)      dp/da_i = x'_i
    dp/dalpha_i = x'_i x (p - o_i)            dp/dbeta_i = y_i x (p - o_i)

with `x` the cross product, x'_i the x axis after the turn by theta_i + q_i, o_i and y_i origin and y axis of frame i,
z_(i-1) and o_(i-1) the joint's axis and a point on it; all in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.frames import apply
from calib.kinematics.robot import Robot


@dataclass(frozen=True)
class Chain:
    """Frames of a forward pass over N poses of an arm with n joints.

    `base_T_frame` (N, n + 2, 4, 4): the frame that the first row starts from, frames 1..n, tool.
    `turned_x` (N, n + 1, 3): the x axes after theta + q.
    """

    base_T_frame: Array
    turned_x: Array

    @property
    def base_T_flange(self) -> Array:
        """Frame (N, 4, 4) of the last joint, to which the tool row and further targets refer."""
        return self.base_T_frame[:, -2]

    def base_T_link(self, joint: int | None) -> Array:
        """Frame (N, 4, 4) of the link that a given joint (counted from 1) moves; of the last link for None."""
        return self.base_T_frame[:, -2 if joint is None else joint]

    @property
    def target_mm(self) -> Array:
        """Tool point (N, 3) mm, base frame."""
        return self.base_T_frame[:, -1, :3, 3]


def forward(table: ArrayLike, q: ArrayLike, is_revolute: ArrayLike, base_T_first: ArrayLike | None = None) -> Chain:
    """Frames of all links of an arm at N joint vectors, base frame: products of the links' transforms (Jang eq 3).

    Args:
        table: (n + 1, 5), or (1 or N, n + 1, 5) where poses differ; rows a, alpha, d, theta, beta in mm and rad.
        q: (N, n) rad, mm for prismatic joints.
        is_revolute: (n,) bool.
        base_T_first: (4, 4) the frame that the first row starts from, `Robot.base_T_first`; None: the base frame.
    """
    table, q = np.asarray(table, dtype=float), np.asarray(q, dtype=float)
    table = table[None] if table.ndim == 2 else table
    n_poses, n_joints = q.shape
    # The poses' axis comes last, so that each operation runs over contiguous memory.
    a, alpha, d, theta, beta = np.ascontiguousarray(table.T)  # each (n + 1, 1 or N)
    driven = np.zeros((n_joints + 1, n_poses))  # the tool row has no q
    driven[:-1] = q.T
    turns = np.append(np.asarray(is_revolute, dtype=bool), False)[:, None]
    theta, d = theta + np.where(turns, driven, 0.0), d + np.where(turns, 0.0, driven)

    local = _link_transforms(a, alpha, d, theta, beta)  # (4, 4, n + 1, N)
    frames = np.empty((n_joints + 2, 4, 4, n_poses))
    frames[0] = np.asarray(np.eye(4) if base_T_first is None else base_T_first)[:, :, None]
    for i in range(n_joints + 1):
        np.einsum("ijn,jkn->ikn", frames[i], local[:, :, i], out=frames[i + 1])
    x, y = frames[:-1, :3, 0], frames[:-1, :3, 1]
    turned_x = np.cos(theta)[:, None] * x + np.sin(theta)[:, None] * y
    return Chain(np.moveaxis(frames, -1, 0), np.moveaxis(turned_x, -1, 0))


def _link_transforms(a: Array, alpha: Array, d: Array, theta: Array, beta: Array) -> Array:
    """Transforms (4, 4, ...) of links by Jang eq (3), from lengths in mm and angles in rad that broadcast."""
    ct, st = np.cos(theta), np.sin(theta)
    ca, sa = np.cos(alpha), np.sin(alpha)
    cb, sb = np.cos(beta), np.sin(beta)
    out = np.zeros((4, 4, *theta.shape))
    out[0, 0] = ct * cb - st * sa * sb
    out[0, 1] = -st * ca
    out[0, 2] = ct * sb + st * sa * cb
    out[0, 3] = a * ct
    out[1, 0] = st * cb + ct * sa * sb
    out[1, 1] = ct * ca
    out[1, 2] = st * sb - ct * sa * cb
    out[1, 3] = a * st
    out[2, 0] = -ca * sb
    out[2, 1] = sa
    out[2, 2] = ca * cb
    out[2, 3] = d
    out[3, 3] = 1.0
    return out


def point_jacobian(chain: Chain, points_mm: ArrayLike) -> Array:
    """Derivative, by the table's entries, of points fixed to the tool (Jang eq 8).

    Args:
        points_mm: (N, 3) in the base frame, one per pose.

    Returns:
        (N, 3, n + 1, 5): mm per mm for a and d, mm per rad for alpha, theta and beta.
    """
    points_mm = np.asarray(points_mm, dtype=float)
    previous, current = chain.base_T_frame[:, :-1], chain.base_T_frame[:, 1:]
    z, y, x = previous[..., :3, 2], current[..., :3, 1], chain.turned_x
    from_previous = points_mm[:, None] - previous[..., :3, 3]
    from_current = points_mm[:, None] - current[..., :3, 3]
    columns = [x, np.cross(x, from_current), z, np.cross(z, from_previous), np.cross(y, from_current)]
    return np.moveaxis(np.stack(columns, axis=-1), 1, 2)


def link_point_jacobian(chain: Chain, points_mm: ArrayLike, joint: int | None) -> Array:
    """Derivative, by the table's entries, of points fixed to the link that a joint moves.

    It is as `point_jacobian`, but zero for later rows of the table.
    """
    by_table = point_jacobian(chain, points_mm)
    by_table[:, :, -1 if joint is None else joint :] = 0.0
    return by_table


def seen_from_flange(chain: Chain, points_mm: ArrayLike) -> tuple[Array, Array, Array]:
    """Positions in the flange's frame of points fixed in the base frame (N, 3), with their derivatives.

    A small motion of the flange moves them, as seen from it, opposite to a point of the flange at the same position.

    Returns:
        Positions (N, 3), mm in the flange's frame, and their derivatives by the table's entries (N, 3, n + 1, 5) and
        by the points' base-frame coordinates (N, 3, 3).
    """
    points_mm = np.asarray(points_mm, dtype=float)
    flange_R_base = np.swapaxes(chain.base_T_flange[:, :3, :3], 1, 2)
    seen_mm = np.einsum("nij,nj->ni", flange_R_base, points_mm - chain.base_T_flange[:, :3, 3])
    by_table = np.einsum("nij,njrk->nirk", flange_R_base, link_point_jacobian(chain, points_mm, None))
    return seen_mm, -by_table, flange_R_base


def flange_turn_jacobian(chain: Chain) -> Array:
    """Derivative (N, 3, n + 1, 5), by the table's entries, of the world's small turn about the flange's axes."""
    by_table = turn_jacobian(chain)
    by_table[:, :, -1] = 0.0  # the tool's row does not turn the flange
    return -np.einsum("nji,njrk->nirk", chain.base_T_flange[:, :3, :3], by_table)


def turn_jacobian(chain: Chain) -> Array:
    """Derivative (N, 3, n + 1, 5), rad, by the table's entries, of the tool's small turn about the base's axes.

    Lengths do not turn it. An angle turns it about its own axis: theta about z_(i-1), alpha about x'_i, beta about
    y_i.
    """
    z, y = chain.base_T_frame[:, :-1, :3, 2], chain.base_T_frame[:, 1:, :3, 1]
    none = np.zeros_like(z)  # of a and d
    return np.moveaxis(np.stack([none, chain.turned_x, none, z, y], axis=-1), 1, 2)


def joint_jacobian(chain: Chain, is_revolute: ArrayLike, points_mm: ArrayLike | None = None) -> tuple[Array, Array]:
    """Derivatives (N, 3, n), by the joints, of points of the tool, mm, and of its turn, rad, base frame.

    Per rad of a revolute joint (its theta), per mm of a prismatic one (its d), which does not turn the tool.
    points_mm  # (N, 3); None: the end of the tool's row
    """
    turns = np.asarray(is_revolute, dtype=bool)
    by_table = point_jacobian(chain, chain.target_mm if points_mm is None else points_mm)[:, :, :-1]
    axes = np.moveaxis(chain.base_T_frame[:, :-2, :3, 2], 1, 2)  # z_(i-1) of each joint
    return np.where(turns, by_table[..., 3], by_table[..., 2]), np.where(turns, axes, 0.0)


def nominal_chain(robot: Robot, q: ArrayLike) -> Chain:
    """Forward pass of a robot's nominal table at joint vectors q (N, n)."""
    return forward(robot.table, q, robot.is_revolute, robot.base_T_first)


def target_points(robot: Robot, q: ArrayLike) -> Array:
    """Measured point of the tool (N, 3), mm in the base frame, at joint vectors q (N, n)."""
    return tool_points(robot, nominal_chain(robot, q))


def tool_points(robot: Robot, chain: Chain) -> Array:
    """Measured point of the tool (N, 3), mm in the base frame, at the poses of a forward pass."""
    own = robot.own_tool_point
    return chain.target_mm if own is None else apply(chain.base_T_flange, np.array(own.xyz_mm))


def target_jacobian(robot: Robot, q: ArrayLike) -> Array:
    """Jacobian of the tool point (Jang eq 8): (N, 3, P) by the robot's parameters, ordered as `parameter_names`."""
    chain = nominal_chain(robot, q)
    return point_jacobian(chain, chain.target_mm).reshape(len(chain.target_mm), 3, -1)
