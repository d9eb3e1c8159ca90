"""Deflections of a simulated arm under load: joints, play, links, base, tool, and a hose that pulls.

Moments and positions are those of the equilibrium, so that load and deflection agree
(`calib.simulation.truth.equilibrium.solve_equilibrium`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.mechanism import Arm, in_frame
from calib.simulation.truth.sampling import (
    JointError,
    Rng,
    SampledEffect,
    SimulatedCell,
    carried,
    gravity_torques,
    magnitudes,
    one_joint,
)


class JointCompliance(JointError):
    """Joints that yield under load: dq_j = c_j tau_j, the gravity torque at the resulting pose."""

    needs_equilibrium = True
    c_rad_per_nm: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return self.c_rad_per_nm * equilibrium.gravity_torques

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Compliances of similar joints, which vary by 35 %; those of the wrist are about four times larger."""
        n = cell.nominal.n_joints
        size = 1e-5 * np.where(np.arange(n) < n - 3, 1.0, 4.0) * np.exp(0.35 * rng.standard_normal(n))
        return carried(cell, rng, cls, size * cell.nominal.is_revolute)


class GravityBacklash(JointError):
    """Gravity holds a joint at one side of its play: dq_j = b_j / 2 sign(tau_j).

    Within `friction_nm` of balance the joint is inside the play, in proportion, so that an equilibrium always exists.
    """

    needs_equilibrium = True
    b_rad: Array  # (n,)
    friction_nm: float = 0.05

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        side = np.clip(equilibrium.gravity_torques / self.friction_nm, -1.0, 1.0)
        return 0.5 * self.b_rad * side

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Play in joints with a clear gravity load: a median torque above 0.3 Nm."""
        loaded = np.median(np.abs(gravity_torques(cell)), axis=0) > 0.3
        return carried(cell, rng, cls, 2e-4 * magnitudes(cell, rng) * loaded)


class LinkBending(SampledEffect):
    """Bending of each link as a cantilever from its joint's origin to the next one's, c = L / EI (Euler-Bernoulli).

    The bending moment runs linearly from M0 at the root to ML at the end for all that hangs beyond, and as
    (1 - s / L)^2 from M1 for the link's own weight, spread evenly. The integrals of it give the end's turn
    c ((M0 + ML) / 2 + M1 / 3) and its shift c L (M0 / 3 + ML / 6 + M1 / 4) x e along the link's direction e; of the
    moments only what is across e counts (a tube is stiff in torsion).
    """

    needs_equilibrium = True
    c_rad_per_nm: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        turn_rad, shift_mm = arm.link_turn_rad.copy(), arm.link_shift_mm.copy()
        for j in np.flatnonzero(self.c_rad_per_nm).tolist():
            root_mm, end_T = equilibrium.base_T_axis[j][:, :3, 3], equilibrium.base_T_straight[j]
            span_mm = end_T[:, :3, 3] - root_mm
            length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
            if np.any(length_mm < 1.0):
                continue
            along = span_mm / length_mm

            def across(moment: Array, along: Array = along) -> Array:
                return moment - np.sum(moment * along, axis=1, keepdims=True) * along

            at_root = across(equilibrium.moment_nm(root_mm, j + 1))
            at_end = across(equilibrium.moment_nm(end_T[:, :3, 3], j + 1))
            own = sum(weight.weight_n for weight in equilibrium.weights[: arm.robot.n_joints] if weight.carrier == j)
            own = np.cross(0.5e-3 * span_mm, own)
            c = self.c_rad_per_nm[j]
            turn = c * ((at_root + at_end) / 2.0 + own / 3.0)
            shift = c * length_mm * np.cross(at_root / 3.0 + at_end / 6.0 + own / 4.0, along)
            turn_rad[:, j] += in_frame(end_T, turn)
            shift_mm[:, j] += in_frame(end_T, shift)
        return replace(arm, link_turn_rad=turn_rad, link_shift_mm=shift_mm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Bending of links of at least 50 mm; c = L / EI grows towards the thin end of the arm."""
        ends = Arm.commanded_to(cell.nominal, cell.q)
        spans = [
            after[0, :3, 3] - before[0, :3, 3]
            for before, after in zip(ends.base_T_axis, ends.base_T_straight, strict=True)
        ]
        length_mm = np.linalg.norm(spans, axis=1)
        size = 2e-6 * magnitudes(cell, rng) * (length_mm / 400.0) * (length_mm > 50.0)
        return carried(cell, rng, cls, size * np.linspace(1.0, 3.0, len(size)))


class NonlinearStiffness(JointError):
    """Springs that soften or stiffen: dq_j = c_j tau_j |tau_j|."""

    needs_equilibrium = True
    c_rad_per_nm2: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        torque = equilibrium.gravity_torques
        return self.c_rad_per_nm2 * torque * np.abs(torque)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Compliances that are largest in joints of small torque, so that all yield alike at their largest torques."""
        largest = np.abs(gravity_torques(cell)).max(axis=0)
        size = np.where(largest > 0.3, 1e-4 / np.maximum(largest, 0.3) ** 2, 0.0) * magnitudes(cell, rng)
        return carried(cell, rng, cls, size)


class LinkTorsion(SampledEffect):
    """Torsion of each link, a tube from its joint's origin to the next, by the moment of later weights about it."""

    needs_equilibrium = True
    c_rad_per_nm: Array  # (n,) L / GJ

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        turn_rad = arm.link_turn_rad.copy()
        for j in np.flatnonzero(self.c_rad_per_nm).tolist():
            root_mm, end_T = equilibrium.base_T_axis[j][:, :3, 3], equilibrium.base_T_straight[j]
            span_mm = end_T[:, :3, 3] - root_mm
            along = span_mm / np.linalg.norm(span_mm, axis=1, keepdims=True)
            twist = np.sum(equilibrium.moment_nm(root_mm, j + 1) * along, axis=1, keepdims=True) * along
            turn_rad[:, j] += self.c_rad_per_nm[j] * in_frame(end_T, twist)
        return replace(arm, link_turn_rad=turn_rad)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Torsion of one link that reaches out from its joint's axis; along the axis it would be joint compliance."""
        rows = cell.nominal.table[:-1]
        long = np.abs(rows[:, 0]) > np.maximum(50.0, 0.1 * np.abs(rows[:, 2]))
        if not long.any():
            raise CalibError(f"link_torsion: no link of {cell.nominal.name} reaches out from its joint's axis")

        return one_joint(cell, rng, lambda size: cls(np.abs(size) * long))


class BearingClearance(SampledEffect):
    """Bearings with play: each axis leans by a fixed angle, about the cross-axis moment of all weights beyond it."""

    needs_equilibrium = True
    lean_rad: Array  # (n,)
    friction_nm: float = 0.05  # within it of balance the lean is in proportion to the moment

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        tilt = arm.axis_tilt_rad.copy()
        rigid = Arm.commanded_to(arm.robot, arm.commanded, arm.conditions)
        for j in np.flatnonzero(self.lean_rad).tolist():
            axis_T = rigid.base_T_axis[j]
            moment = in_frame(axis_T, equilibrium.moment_nm(equilibrium.base_T_axis[j][:, :3, 3], j))
            moment[:, 2] = 0.0
            size = np.linalg.norm(moment, axis=1, keepdims=True)
            tilt[:, j] += self.lean_rad[j] * moment / np.maximum(size, self.friction_nm)
        return replace(arm, axis_tilt_rad=tilt)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Clearance of one joint's bearing."""
        return one_joint(cell, rng, lambda size: cls(np.abs(size)))


class Counterbalance(JointError):
    """A spring, or gas cylinder, from the link before joint 2 to the link behind: dq_2 = c times its torque.

    Its ends are points of the plane across the joint's axis; its force along the line between them is
    `force_n + rate_n_per_mm * length`, and its torque about the axis that of this force at the end on the link.
    """

    c_rad_per_nm: float
    anchor_mm: Array  # (2,) before the joint
    held_mm: Array  # (2,) on the link at q = 0
    force_n: float
    rate_n_per_mm: float
    joint: int = 1

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        q = arm.commanded[:, self.joint]
        c, s = np.cos(q), np.sin(q)
        x, y = self.held_mm
        held_mm = np.column_stack([c * x - s * y, s * x + c * y])
        span_mm = self.anchor_mm - held_mm
        length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
        pull_n = (self.force_n + self.rate_n_per_mm * length_mm) * span_mm / length_mm
        torque_nm = 1e-3 * (held_mm[:, 0] * pull_n[:, 1] - held_mm[:, 1] * pull_n[:, 0])
        turned = np.zeros_like(arm.q)
        turned[:, self.joint] = self.c_rad_per_nm * torque_nm
        return turned

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """A coil or a gas cylinder whose end on the link is nearer to the axis than the other."""
        turns, across = cell.nominal.is_revolute, abs(np.cos(cell.nominal.table[0, 1])) < 0.5
        if len(turns) < 2 or not (turns[0] and turns[1] and across):
            raise CalibError(f"counterbalance: joint 2 of {cell.nominal.name} does not turn across joint 1")
        at, held = rng.uniform(0.0, 2.0 * np.pi, 2)
        anchor_mm = rng.uniform(300.0, 600.0) * np.array([np.cos(at), np.sin(at)])
        held_mm = rng.uniform(0.2, 0.7) * np.linalg.norm(anchor_mm) * np.array([np.cos(held), np.sin(held)])
        force_n, rate_n_per_mm = (3000.0, 0.5) if rng.random() < 0.5 else (-1000.0, 10.0)
        return cls(1e-6, anchor_mm, held_mm, force_n, rate_n_per_mm)


class BaseCompliance(SampledEffect):
    """A floor that yields: the arm turns about its base's origin by c M, the overturning moment of all weights."""

    needs_equilibrium = True
    c_rad_per_nm: Array  # (3,) about x, y, z of the base frame

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        moment_nm = equilibrium.moment_nm(np.zeros((len(arm.q), 3)), 0)
        return replace(arm, base_turn_rad=arm.base_turn_rad + self.c_rad_per_nm * moment_nm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(1e-6 * np.array([*rng.uniform(0.6, 1.4, 2), 0.0]))


class ToolSag(SampledEffect):
    """A target on three springs along the tool frame's axes: shift = R diag(c) R^T g / |g|."""

    needs_equilibrium = True
    c_mm: Array  # (3,) under the tool's weight when that axis points down

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        base_R_tool = equilibrium.base_T_frame[-1][:, :3, :3]
        gravity = np.array(arm.robot.gravity_m_s2)
        down = np.einsum("nji,j->ni", base_R_tool, gravity / np.linalg.norm(gravity))  # tool axes
        shift_mm = np.einsum("nij,nj->ni", base_R_tool, self.c_mm * down)
        return replace(arm, target_shift_mm=arm.target_shift_mm + shift_mm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """A tool that is softer across than along its axis."""
        return cls(0.2 * rng.uniform(0.5, 1.5, 3) * np.array([1.0, 1.0, 0.3]))


class HosePull(JointError):
    """A hose as a spring from a fixed place to a point of the forearm; joints yield. Not in the catalogue."""

    in_catalogue = False
    needs_equilibrium = True
    stiffness_n_per_mm: float
    rest_length_mm: float
    anchor_mm: Array  # (3,) base frame
    held_mm: Array  # (3,) in the frame of the link that holds it
    link: int  # 0-based joint that moves that link
    c_rad_per_nm: Array  # (n,) how the joints yield

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        held_mm = equilibrium.place_mm(self.link, self.held_mm)
        reach_mm = self.anchor_mm - held_mm
        length_mm = np.linalg.norm(reach_mm, axis=1, keepdims=True)
        stretch_mm = np.maximum(length_mm - self.rest_length_mm, 0.0)
        force_n = self.stiffness_n_per_mm * stretch_mm * reach_mm / length_mm
        torque_nm = np.zeros_like(arm.q)
        for j in range(self.link + 1):
            axis_T = equilibrium.base_T_axis[j]
            torque_nm[:, j] = np.sum(axis_T[:, :3, 2] * np.cross(1e-3 * (held_mm - axis_T[:, :3, 3]), force_n), axis=1)
        return self.c_rad_per_nm * torque_nm

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Hose from above and behind the base to the side of the forearm, on joints of realistic compliance."""
        n = cell.nominal.n_joints
        reach_mm = float(
            np.linalg.norm(Arm.commanded_to(cell.nominal, cell.q).base_T_frame[-1][:, :3, 3], axis=1).max()
        )
        return cls(
            stiffness_n_per_mm=0.05,
            rest_length_mm=0.3 * reach_mm,
            anchor_mm=reach_mm * np.array([rng.uniform(-0.6, -0.2), rng.uniform(-0.5, 0.5), rng.uniform(0.6, 1.2)]),
            held_mm=rng.uniform(-80.0, 80.0, 3),
            link=n // 2 - (n % 2 == 0),
            c_rad_per_nm=1e-5 * magnitudes(cell, rng),
        )
