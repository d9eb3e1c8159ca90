"""Robot: the five-parameter table, limits, masses and the points on its tool.

Frame i is `Rz(theta + q) Trans(a, 0, d) Rx(alpha) Ry(beta)` (Jang 2025 eq 3, Park 2022 section 2); a prismatic joint
adds q to d instead. A tool row of the same form, without q, ends the chain. In files angles are degrees (robot.toml,
read and written by `calib.dataset.files.robot_toml`); here they are radians. The table stands between two known frames:
that from which the first row starts (`Robot.base`), and the controller's flange (`Robot.flange`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray, Vector
from calib.brief import Brief
from calib.frames import make_transform, rotation_from_rpy, rpy_from_rotation

PARAMETER_KINDS = ("a", "alpha", "d", "theta", "beta")
"""Columns of a robot's table, in order. a and d are lengths in mm, the others angles in rad."""

LENGTH_KINDS = frozenset({"a", "d"})


@dataclass(frozen=True)
class Link(Brief):
    """One row of the robot's table: the transform to the next frame (Jang eq 3) at joint position 0."""

    a_mm: float = 0.0
    alpha_rad: float = 0.0
    d_mm: float = 0.0
    theta_rad: float = 0.0
    beta_rad: float = 0.0

    @property
    def row(self) -> tuple[float, float, float, float, float]:
        """Entries a, alpha, d, theta, beta in mm and rad."""
        return (self.a_mm, self.alpha_rad, self.d_mm, self.theta_rad, self.beta_rad)


@dataclass(frozen=True)
class FixedFrame:
    """A frame at a known place in another one; never fitted."""

    xyz_mm: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector = (0.0, 0.0, 0.0)  # about the other frame's own x, then y, then z axis

    @classmethod
    def of(cls, transform: Array) -> FixedFrame:
        """The frame of a transform (4, 4) from it to the other one."""
        (x, y, z), (roll, pitch, yaw) = transform[:3, 3].tolist(), rpy_from_rotation(transform[:3, :3]).tolist()
        return cls((x, y, z), (roll, pitch, yaw))

    @property
    def transform(self) -> Array:
        """Transform (4, 4) from this frame to the other one."""
        return make_transform(rotation_from_rpy(self.rpy_rad), self.xyz_mm)


@dataclass(frozen=True)
class Joint(Link):
    """A joint and the link that it moves. Limits are rad, or mm for a prismatic joint.

    `com_mm` is the link's centre of mass in its own frame (after alpha and beta).
    """

    name: str = ""
    type: str = "revolute"
    min: float | None = None
    max: float | None = None
    mass_kg: float | None = None
    com_mm: Vector | None = None
    gear_ratio: float | None = None
    mesh: str | None = None
    zero: float = 0.0  # rad or mm, where all commanded values are 0
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_revolute(self) -> bool:
        """Whether the joint turns; else it slides."""
        return self.type == "revolute"


@dataclass(frozen=True)
class Tool(Link):
    """Transform from the last joint's frame to the measured point. Centres of mass are in the last joint's frame."""

    mass_kg: float | None = None
    com_mm: Vector | None = None
    payload_com_mm: Vector | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


TOOL_POINT = "jig"
"""Name of the tool's measured point among the targets: the end of the tool's row, unless a target has this name."""
TARGET_TOLERANCE_MM = 0.5
"""Default tolerance of a target's coordinate, the prior's sigma, where robot.toml has none."""


@dataclass(frozen=True)
class Target:
    """A further measured point on the tool or on an earlier link, in the frame of that link.

    A fit keeps it within about its tolerance.
    """

    name: str
    xyz_mm: Vector
    tolerance_mm: float = TARGET_TOLERANCE_MM
    joint: int | None = None  # the joint that moves its link, counted from 1; None: the last
    in_world: bool = False  # fixed in the world, its coordinates in the base frame: for a scanner on the flange


@dataclass(frozen=True)
class MeasuredLoad:
    """The load of a revolute joint as its measured torques tell it (`calib.dataset.measured_torques`)."""

    joint: int  # from 0
    weights: tuple[float, ...]  # masses, kg, and first moments, kg m, that explain the torques: `statics_columns`
    sign: float  # 1: the file has the torque of the load; -1: that of the drive, which holds it
    offset_nm: float  # of the sensor
    friction_nm: float  # of a joint that came from its positive side
    sigma_nm: float  # noise of one reading
    sigma_from: str  # "dataset.toml", "repeats" or "successive poses"
    trust: float  # share of what differs from the weight's torque that is load, not noise
    explained: float  # share of the torque's variance that weight explains
    spread: tuple[tuple[float, ...], ...]  # independent changes of the weights by one standard deviation each
    slope_lost: float  # share by which a slope over readings with this noise would come out too small


@dataclass(frozen=True)
class DriveTerm:
    """A law by which a link stands off from its motor (`calib.kinematics.drive`), with fitted values."""

    law: str  # "joint_compliance", "harmonic 2" ...
    values: tuple[float, ...]
    sigmas: tuple[float, ...]
    mean_rad: float  # over the poses of the fit, which the offset holds
    share: float  # of the squared difference between link and motor, that is left without it


@dataclass(frozen=True)
class LinkEncoder:
    """An encoder on a link's side, and what it tells of the drive (`calib.dataset.link_encoders`)."""

    joint: int  # from 0
    offset_rad: float  # between the zeros of link and motor
    terms: tuple[DriveTerm, ...]  # what lies between motor and link, for poses at which it was not read
    rms_rad: float  # of the difference between link and motor, less the offset
    left_rad: float  # standard deviation of what the terms leave
    sigma_rad: float | None  # noise of the difference, where it is declared


@dataclass(frozen=True)
class Robot(Brief):
    """A serial arm of any number of revolute or prismatic joints.

    `extra`, here and in its parts, holds keys of robot.toml that this package does not know; they are written back.
    """

    name: str
    joints: tuple[Joint, ...]
    tool: Tool = field(default_factory=Tool)
    gravity_m_s2: Vector = (0.0, 0.0, -9.81)
    targets: tuple[Target, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    coupling: tuple[tuple[float, ...], ...] = ()
    """(n, n) joint values by commanded ones, which are those of the user's files; (): one each. mm per rad, mm or 1."""
    base: FixedFrame = field(default_factory=FixedFrame)
    """Frame that the first row starts from, in the base frame."""
    flange: FixedFrame = field(default_factory=FixedFrame)
    """Frame that the controller calls its flange, in that of the last joint (`calib.kinematics.flange`)."""
    carries_scanner: bool = False
    """Whether the scanner is on the flange and measures targets in the world; else it measures the tool."""
    is_cartesian: bool = False
    """Whether the joints stand for poses of the flange that a controller told (`calib.kinematics.cartesian`)."""
    measured_loads: tuple[MeasuredLoad, ...] = ()
    """Loads of joints whose torques were measured with a dataset; no part of robot.toml."""
    link_encoders: tuple[LinkEncoder, ...] = ()
    """Encoders on the link's side that a dataset has readings of; no part of robot.toml."""

    def measured_load(self, joint: int) -> MeasuredLoad | None:
        """Load of a joint (counted from 0) by its measured torques; None where these were not measured."""
        return next((load for load in self.measured_loads if load.joint == joint), None)

    @property
    def n_joints(self) -> int:
        return len(self.joints)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Suffixes of the parameters' names, one per row of the table: "1", ..., "n", "TCP"."""
        return (*(str(i + 1) for i in range(self.n_joints)), "TCP")

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the table's entries, row by row: a1 alpha1 d1 theta1 beta1 ... betaTCP."""
        return tuple(kind + frame for frame in self.frame_names for kind in PARAMETER_KINDS)

    @property
    def parameter_units(self) -> tuple[str, ...]:
        """Units of the table's entries, row by row: "mm" or "rad"."""
        return tuple("mm" if kind in LENGTH_KINDS else "rad" for _ in self.frame_names for kind in PARAMETER_KINDS)

    @property
    def is_revolute(self) -> BoolArray:
        """Mask (n,) of the revolute joints."""
        return np.array([joint.is_revolute for joint in self.joints], dtype=bool)

    @property
    def revolute_joints(self) -> list[int]:
        """Indices of the revolute joints, from 0."""
        return [j for j, joint in enumerate(self.joints) if joint.is_revolute]

    @property
    def base_T_first(self) -> Array:
        """Transform (4, 4) from the frame that the first row starts from to the base frame."""
        return self.base.transform

    @property
    def own_tool_point(self) -> Target | None:
        """Target on the last link that is the tool's measured point; None where the tool row ends at that point."""
        return next((t for t in self.targets if t.name == TOOL_POINT and not t.in_world), None)

    def target(self, name: str) -> Target:
        """Further target with a given name."""
        return next(target for target in self.targets if target.name == name)

    def joints_of(self, commanded: ArrayLike) -> Array:
        """Joint values (..., n), rad and mm, for commanded values (..., n): coupling @ commanded + zeros."""
        commanded = np.asarray(commanded, dtype=float)
        return (commanded @ np.array(self.coupling).T if self.coupling else commanded) + self.zeros

    def commands_of(self, q: ArrayLike) -> Array:
        """Commanded values (..., n), rad and mm, that give joint values (..., n): the inverse of `joints_of`."""
        q = np.asarray(q, dtype=float) - self.zeros
        return q @ np.linalg.inv(np.array(self.coupling)).T if self.coupling else q

    @property
    def zeros(self) -> Array:
        """Joint values (n,), rad and mm, where all commanded values are 0."""
        return np.array([joint.zero for joint in self.joints])

    def with_commands(self, coupling: ArrayLike, zeros: ArrayLike) -> Robot:
        """Robot whose joint values are coupling @ commanded + zeros, in place of what they are now."""
        plain = np.array_equal(coupling, np.eye(self.n_joints))
        rows = () if plain else tuple(tuple(map(float, row)) for row in np.asarray(coupling))
        joints = tuple(
            replace(joint, zero=float(zero)) for joint, zero in zip(self.joints, np.asarray(zeros), strict=True)
        )
        return replace(self, joints=joints, coupling=rows)

    @property
    def table(self) -> Array:
        """Table (n + 1, 5) with rows a, alpha, d, theta, beta in mm and rad; the last row is the tool."""
        return np.array([*(joint.row for joint in self.joints), self.tool.row], dtype=float)

    def with_table(self, table: ArrayLike) -> Robot:
        """Robot with another table (n + 1, 5)."""
        table = np.asarray(table, dtype=float)
        if table.shape != (self.n_joints + 1, len(PARAMETER_KINDS)):
            raise ValueError(f"a table for {self.n_joints} joints is {self.n_joints + 1} x 5, got {table.shape}")
        rows = [dict(zip(_ROW_FIELDS, map(float, row), strict=True)) for row in table]
        joints = tuple(replace(joint, **row) for joint, row in zip(self.joints, rows[:-1], strict=True))  # type: ignore[arg-type]
        return replace(self, joints=joints, tool=replace(self.tool, **rows[-1]))  # type: ignore[arg-type]

    def _brief(self) -> str:
        kinds = "".join("R" if joint.is_revolute else "P" for joint in self.joints)
        return f"{self.name}: {self.n_joints} joints {kinds}"


_ROW_FIELDS = ("a_mm", "alpha_rad", "d_mm", "theta_rad", "beta_rad")
