"""What each effect of the catalogue does to a standard arm, computed with the project's own screening.

The standard arm is the built-in RB5, 160 simulated poses all over its joints' ranges, with a payload, a temperature, a
time and a side of approach at each. Its link errors and the scanner's place are fitted first. An effect's signature is
what a member of usual size does to the measured points, before and after the directions of that fit are projected out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from effect_channels import LEVER, NOISE_MM, Channel, Input, in_shown_unit, label_of, roughness

from calib import calibrate
from calib.array_types import Array
from calib.calibration.pose_errors import inputs_at
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import CATALOGUE
from calib.effects.effect import CatalogueEffect, Effect, Family
from calib.effects.state import RobotState
from calib.screening.member_columns import VisibleColumns, member_columns, visible_columns
from calib.screening.projected_residual import ProjectedResidual, joint_directions, project_residual
from calib.simulation.simulate import simulate_dataset

POSES = 160
SHAPE = np.array([1.0, 0.6, -0.8, 0.5, -0.7, 0.4])  # of an effect's parameters, in usual sizes: none alone
GOOD_ENOUGH = 0.08  # roughness beyond the best, up to which an input that stands earlier is taken
CONFUSED = 0.3  # share that another effect could make, from which it is told
Kind = type[CatalogueEffect]


@dataclass(frozen=True)
class Standard:
    """The standard arm, its fit, and every family of the catalogue as the fit's residual would show it."""

    projected: ProjectedResidual
    families: Mapping[str, Family]
    visible: Mapping[str, VisibleColumns]

    @classmethod
    def made(cls) -> Standard:
        rng = np.random.default_rng(12)
        robot = builtin_robot("rb5")
        dataset = simulate_dataset(robot, rng=rng, poses=POSES, noise_mm=NOISE_MM, conditions=True).dataset
        dataset = replace(dataset, poses=replace(dataset.poses, role=np.where(
            dataset.poses.role == "reference", "reference", "train")))  # fmt: skip
        projected = project_residual(calibrate(dataset))
        families = {kind.name: _family(kind, dataset) for kind in CATALOGUE}
        visible = {name: visible_columns(projected, family) for name, family in families.items()}
        return cls(projected, families, visible)

    @property
    def state(self) -> RobotState:
        return self.projected.state

    @property
    def noise_mm(self) -> float:
        return NOISE_MM

    @cached_property
    def scanner_T_base(self) -> Array:
        """(M, 4, 4) of each measured point."""
        seen = self.state.seen
        assert seen is not None
        return seen.scanner_T_base[self.projected.residuals.observed.used_poses[1]]

    @cached_property
    def directions(self) -> list[Array]:
        """For each joint (M, 3), as `joint_directions`."""
        return joint_directions(self.projected)

    @cached_property
    def tested(self) -> dict[str, Array]:
        """The inputs (N,) that a diagnosis holds a residual against."""
        return inputs_at(self.state.robot, self.state.poses, self.state)

    @cached_property
    def inputs(self) -> dict[str, tuple[str, Array]]:
        """By name: its label on an axis, and its value at each pose (N,). Those that a user has come first."""
        state, poses = self.state, self.state.poses
        robot = state.robot
        out = {name: (label_of(name), in_shown_unit(name, u)) for name, u in self.tested.items()}
        n = robot.n_joints
        for j in range(n):
            for k in (j - 1, j + 1):
                for sign, word in ((1.0, "+"), (-1.0, "-")):
                    if 0 <= k < n:
                        u = np.degrees(poses.q[:, j] + sign * poses.q[:, k])
                        name = f"q{j + 1} {word} q{k + 1}"
                        out[name] = (f"{name}, deg, within a turn", np.remainder(u + 180.0, 360.0) - 180.0)
            out[f"way{j + 1}"] = (
                f"way of joint {j + 1} from the pose before, deg",
                np.degrees(poses.motion[:, j]),
            )
        flange_R_base = np.swapaxes(state.chain.base_T_flange[:, :3, :3], 1, 2)
        down = flange_R_base @ np.array([0.0, 0.0, -1.0])
        moment = state.gravity.moment_about(np.zeros((len(poses), 3)), 0)
        for axis, name in enumerate("xyz"):
            out[f"gravity {name}"] = (f"gravity along the tool's {name}, share", down[:, axis])
            if name != "z":
                out[f"moment {name}"] = (f"moment at the base about {name}, Nm", moment[:, axis])
        seen = state.seen
        if seen is not None:
            ray = seen.scanner_mm / np.linalg.norm(seen.scanner_mm, axis=1)[:, None]
            axis_seen = seen.scanner_T_base[:, :3, :3] @ state.chain.base_T_flange[:, :3, 2][..., None]
            cosine = np.abs(np.einsum("ni,ni->n", ray, axis_seen[..., 0]))
            out["incidence"] = (
                "angle between ray and jig axis, deg",
                np.degrees(np.arccos(np.clip(cosine, 0, 1))),
            )
        return out

    def signature(self, name: str) -> Signature:
        """Of a family's member that shows most."""
        family, shown = self.families[name], self.visible[name]
        best = int(np.argmax([np.linalg.norm(group) for group in shown.groups]))
        if family.sparse:  # of its places one in the middle, on the joint that shows most
            joint = getattr(family.members[best], "joint", None)
            places = [k for k, one in enumerate(family.members) if getattr(one, "joint", None) == joint]
            best = places[len(places) // 2]
        member = family.members[best]
        coefficients = SHAPE[np.arange(len(member.parameters)) % len(SHAPE)]
        scales = np.array([p.scale for p in member.parameters])
        raw = member_columns(self.projected, member) @ (coefficients * scales)
        left = self.projected.project(raw)
        if not np.any(shown.groups[best]):
            left = np.zeros_like(left)
        before_mm, after_mm = (NOISE_MM * v.reshape(-1, 3) for v in (raw, left))
        return Signature(name, member, coefficients * scales, before_mm, after_mm, *self._where(member, raw),
                         self._alike(name, left))  # fmt: skip

    def _alike(self, name: str, left: Array) -> tuple[tuple[str, float], ...]:
        """The families that could make most of what is left of a signature, and the share that they could."""
        if not np.any(left):
            return ()
        out = []
        for other, columns in self.visible.items():
            if other != name and columns.narrowest > 0:
                share = float(columns.shares(left[:, None])[0])
                if share > CONFUSED:
                    out.append((other, share))
        return tuple(sorted(out, key=lambda one: -one[1]))

    def _where(self, member: Effect, raw: Array) -> tuple[Channel, Input]:
        """The channel and the input in which it is the smoothest curve, by the roughness from point to point."""
        joint = getattr(member, "joint", None)
        tried: list[tuple[float, int, Channel, str]] = []
        order = getattr(member, "order", None)
        inputs = dict(self.inputs)
        if joint is not None and order is not None and order > 3:
            phase = np.remainder(np.degrees(order * self.state.poses.q[:, joint]), 360.0)
            inputs["phase"] = (f"{order:g} times q{joint + 1}, deg, within a turn", phase)
        size = _size_of(member, self.state)
        if size is not None:
            inputs["size"] = ("turn that the effect makes, mrad", size)
        for channel in self._channels():
            y = channel.of(raw)
            share = float(y @ y) / max(channel.most(raw), 1e-300)
            for rank, (name, (_, u)) in enumerate(inputs.items()):
                tried.append((1.0 - share * (1.0 - roughness(u, y)), rank, channel, name))
        best = min(tried, key=lambda one: one[0])
        near = [one for one in tried if one[2] is best[2] and one[0] < best[0] + GOOD_ENOUGH]
        _, _, channel, name = min(near, key=lambda one: one[1])
        return channel, Input(*inputs[name], is_tested=name in self.tested)

    def _channels(self) -> Iterator[Channel]:
        row = self.projected.residuals.observed.used_poses[1]
        sizes = [float(np.linalg.norm(direction)) for direction in self.directions]
        for j, direction in enumerate(self.directions):
            if sizes[j] > LEVER * max(sizes):
                yield Channel(f"apparent turn of joint {j + 1}, mrad", direction, joint=j)
        for axis, name in enumerate("xyz"):
            unit = np.broadcast_to(np.eye(3)[axis], self.directions[0].shape)
            yield Channel(f"along the scanner's {name}, mm", unit)
        tool = (self.scanner_T_base[:, :3, :3] @ self.state.chain.base_T_flange[:, :3, :3][row]).swapaxes(1, 2)
        for axis, name in enumerate("xyz"):
            yield Channel(f"along the flange's {name}, mm", tool[:, axis])


@dataclass(frozen=True)
class Signature:
    """One member of usual size: what it does to the points of the standard arm."""

    family: str
    member: Effect
    values: Array  # (K,) of its parameters
    before_mm: Array  # (M, 3) scanner frame: the effect alone
    after_mm: Array  # (M, 3) what link errors and the scanner's place leave of it
    channel: Channel
    input: Input
    alike: tuple[tuple[str, float], ...]

    @property
    def rms_mm(self) -> tuple[float, float]:
        """3D, before and after."""
        before, after = (float(np.sqrt(np.mean(np.sum(v**2, axis=1)))) for v in (self.before_mm, self.after_mm))
        return before, after

    @property
    def left(self) -> float:
        """The share of the size that is left."""
        before, after = self.rms_mm
        return after / before if before > 0.0 else 0.0


def _family(kind: Kind, dataset: Dataset) -> Family:
    """The family for the standard arm; where a column hinders it, without that column."""
    family = kind.family(dataset)
    if not family.members:
        unheated = replace(dataset, poses=replace(dataset.poses, temperature_c=None))
        family = kind.family(unheated)
    if not family.members:
        raise ValueError(f"effect {kind.name} has no member for the standard arm: {family.why_not}")
    return family


def _size_of(member: Effect, state: RobotState) -> Array | None:
    """(N,) the turn, mrad, that a member of one parameter makes of frames, where it is about one axis; else None."""
    if len(member.parameters) != 1:
        return None
    p = member.parameters[0]
    change = member.apply(state, **{p.name: p.scale}).table - state.table
    if len(change) == 1:
        return None
    u, s, vt = np.linalg.svd(change.reshape(len(change), -1), full_matrices=False)
    is_length = np.tile([True, False, True, False, False], change.shape[1])
    if s[0] <= 0.0 or s[1] > 0.02 * s[0] or np.any(np.abs(vt[0][is_length]) > 1e-6):
        return None
    return np.asarray(1e3 * u[:, 0] * s[0])
