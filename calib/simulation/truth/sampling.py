"""Effects that a simulation draws by their names, the joints that carry one, and how much of it is visible.

A fault is seldom spread evenly: about half of the time one to three joints carry all of it. The visible part of an
effect is the residual of its displacements after the best geometric fit: linear least squares on a Jacobian that is
differenced from the true chain, at the nominal arm, where redundant parameters are exactly redundant. It shares nothing
with the Jacobians that a fit uses.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import ClassVar, dataclass_transform

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.simulation.truth.equilibrium import Truth, scanner_T_target
from calib.simulation.truth.mechanism import STANDARD, Arm, Conditions, TrueEffect
from calib.statistics import rms, rms_length

_ABSORBED = 1e-4
"""An effect whose visible share is less counts as absorbed: the rest is of second order."""


@dataclass(frozen=True, eq=False)
class SimulatedCell:
    """A true arm without effects, at the poses of its simulated measurement."""

    nominal: Robot
    truth: Truth
    q: Array  # (N, n)
    conditions: Conditions = STANDARD

    @property
    def _nominal(self) -> Truth:
        """The nominal arm without effects, in the same cell."""
        return replace(self.truth, robot=self.nominal, effects=())

    @cached_property
    def plain_mm(self) -> Array:
        """Points (N, 3) reported by the scanner without effects."""
        return scanner_T_target(self.truth, self.q, self.conditions)[:, :3, 3]

    def moved_mm(self, effect: TrueEffect) -> Array:
        """Displacements (N, 3) of the reported points by the effect alone."""
        return scanner_T_target(self.truth.with_effects(effect), self.q, self.conditions)[:, :3, 3] - self.plain_mm

    def moved_rms_mm(self, effect: TrueEffect) -> float:
        """Rms length of `moved_mm`."""
        return rms_length(self.moved_mm(effect))

    def visible_mm(self, effect: TrueEffect) -> Array:
        """Displacements (N, 3), mm, by the effect that link parameters and scanner frames cannot imitate."""
        moved = self.moved_mm(effect).ravel()
        return np.asarray(moved - self._geometry @ (self._geometry.T @ moved)).reshape(-1, 3)

    def visible_rms_mm(self, effect: TrueEffect) -> float:
        """Rms of `visible_mm` over all coordinates."""
        return rms(self.visible_mm(effect))

    def scaled_to_visible(self, effect: TrueEffect, rms_mm: float) -> TrueEffect:
        """The effect scaled so that a geometric fit leaves a residual of `rms_mm` per coordinate.

        Raises:
            CalibError: link parameters absorb all of it, at any magnitude.
        """
        if rms_mm > 0 and self.visible_rms_mm(effect) < _ABSORBED * self.moved_rms_mm(effect):
            raise CalibError(
                f"{effect.name}: a geometric fit can imitate all of it at these poses, no size makes it visible; "
                "ask for it without a visible size"
            )
        return self._scaled(effect, rms_mm, self.visible_rms_mm)

    def scaled_to_moved(self, effect: TrueEffect, rms_mm: float) -> TrueEffect:
        """The effect scaled so that it moves the measured point by `rms_mm` (RMS over the poses)."""
        return self._scaled(effect, rms_mm, self.moved_rms_mm)

    def _scaled(self, effect: TrueEffect, goal_mm: float, size_mm: Callable[[TrueEffect], float]) -> TrueEffect:
        """The effect scaled to the magnitude at which a given measure of its size equals `goal_mm`."""
        if goal_mm <= 0:
            return effect.scaled(0.0)
        for _ in range(20):  # displacements are nearly proportional to the magnitude
            now_mm = size_mm(effect)
            if not now_mm > 0:
                raise CalibError(f"{effect.name} does nothing to robot {self.nominal.name} at these poses")
            if abs(now_mm / goal_mm - 1.0) < 1e-9:
                break
            effect = effect.scaled(goal_mm / now_mm)
        return effect

    @cached_property
    def _geometry(self) -> Array:
        """Orthonormal basis (3N, R) of the displacements by link parameters and scanner frames, to first order."""
        columns = [*self._link_columns(), *self._frame_columns()]
        jacobian = np.stack([column.ravel() for column in columns], axis=1)
        size = np.linalg.norm(jacobian, axis=0)
        moves = size > 1e-6 * size.max()  # a column below that is rounding
        jacobian = jacobian[:, moves] / size[moves]
        left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
        return left[:, singular > 1e-7 * singular[0]]

    def _link_columns(self) -> list[Array]:
        """Displacements (N, 3) by each link parameter, scanner frame: central differences, steps 1 mm and 1e-4 rad."""
        columns = []
        table = self.nominal.table
        for index in np.ndindex(table.shape):
            step = np.zeros_like(table)
            step[index] = 1.0 if index[1] in (0, 2) else 1e-4
            ends = [
                scanner_T_target(
                    replace(self._nominal, robot=self.nominal.with_table(table + side * step)), self.q, self.conditions
                )
                for side in (1.0, -1.0)
            ]
            columns.append((ends[0] - ends[1])[:, :3, 3] / (2.0 * step[index]))
        return columns

    def _frame_columns(self) -> list[Array]:
        """Displacements (N, 3) by unit shifts and turns of each scanner frame, and by shifts of a fixed jig."""
        columns = []
        nominal_mm = scanner_T_target(self._nominal, self.q, self.conditions)[:, :3, 3]
        if self.truth.base_T_jig is not None:
            for axis in np.eye(4)[:3]:
                moved = replace(self._nominal, base_T_jig=self.truth.base_T_jig + np.outer(axis, np.eye(4)[3]))
                columns.append(scanner_T_target(moved, self.q, self.conditions)[:, :3, 3] - nominal_mm)
        setup = self.conditions.setup
        for name in self.truth.scanners:
            here = np.ones(len(self.q)) if setup is None or len(self.truth.scanners) == 1 else setup == name
            for axis in np.eye(3):
                columns.append(here[:, None] * axis)
                columns.append(here[:, None] * np.cross(axis, nominal_mm))
        return columns


def gravity_torques(cell: SimulatedCell) -> Array:
    """Gravity's torques (N, n) at the commanded poses of the true arm."""
    return Arm.commanded_to(cell.truth.robot, cell.q, cell.conditions).gravity_torques


Rng = np.random.Generator
PerJoint = Callable[[Array], "SampledEffect"]


@dataclass_transform(frozen_default=True, eq_default=False)
class SampledEffect(TrueEffect):
    """An effect that can be simulated by its name: `draw` chooses the joints that carry it, and in which proportion.

    Subclasses are frozen dataclasses by themselves, named as their class is: JointStep is joint_step, as the
    catalogue's class (`calib.effects.catalogue`); the code is independent of it, and no law is linearised. Their first
    field is in proportion to the effect unless `magnitude_fields` says otherwise. Those in a module of
    `calib.simulation.truth` are registered when they are defined.
    """

    in_catalogue: ClassVar[bool] = True  # False: a cause that a diagnosis cannot name and has to leave unexplained
    needs_conditions: ClassVar[bool] = False  # payload, temperature, time and approach at every pose
    needs_facing_jig: ClassVar[bool] = False  # the jig turned at a scanner that does not move with the arm
    unrecorded: ClassVar[tuple[str, ...]] = ()  # conditions that its dataset does not have, so that it shows

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclass(frozen=True, eq=False)(cls)
        if "name" not in vars(cls):
            cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        if not hasattr(cls, "magnitude_fields") and (own := fields(cls)):
            cls.magnitude_fields = (own[0].name,)
        if cls.__module__.startswith(_TRUTH) and not hasattr(cls.draw, "__isabstractmethod__"):
            if cls.name in _REGISTERED:
                raise TypeError(f"effect {cls.__qualname__} has the name {cls.name!r} of another")
            _REGISTERED[cls.name] = cls

    @classmethod
    @abstractmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """The effect in random proportions on a cell's arm; its magnitude is set afterwards.

        Raises CalibError where the arm lacks what the effect needs.
        """


_TRUTH = "calib.simulation.truth."
_REGISTERED: dict[str, type[SampledEffect]] = {}  # by name; filled as the modules of the truth are imported


def registered_effects() -> dict[str, type[SampledEffect]]:
    """Classes of the effects that are defined so far, by name, in alphabetical order.

    `calib.simulation.truth.arm_sampling.SIMULATED` is all of them.
    """
    return dict(sorted(_REGISTERED.items()))


class JointError(SampledEffect):
    """An effect on what each joint reaches: `error` is added to the joints' values."""

    @abstractmethod
    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        """Error (N, n) of the joints, rad, by the torques and positions of `equilibrium`."""

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        """The arm with its joints moved."""
        return replace(arm, q=arm.q + self.error(arm, equilibrium))


def magnitudes(cell: SimulatedCell, rng: Rng, *, signed: bool = False) -> Array:
    """Random relative magnitudes (n,): 0.5 to 1.5 for each revolute joint, 0 for others."""
    n = cell.nominal.n_joints
    sign = rng.choice([-1.0, 1.0], n) if signed else 1.0
    return rng.uniform(0.5, 1.5, n) * sign * cell.nominal.is_revolute


def carried(cell: SimulatedCell, rng: Rng, make: PerJoint, size: Array) -> SampledEffect:
    """Effect that `make` makes of magnitudes (n,): `size` for all joints or 1 to 3 visible ones, 0 for the others.

    A joint is visible when a geometric fit leaves 5 % or more of what it leaves of the most visible joint.
    """
    visible_mm = np.array(
        [
            cell.visible_rms_mm(make(size * row)) if value else 0.0
            for row, value in zip(np.eye(len(size)), size, strict=True)
        ]
    )
    if not visible_mm.max() > 0:
        raise CalibError(f"{make(size).name} does nothing to robot {cell.nominal.name} at these poses")
    visible = np.flatnonzero(visible_mm > 0.05 * visible_mm.max())
    if rng.random() < 0.5:
        return make(size)
    kept = rng.choice(visible, min(int(rng.integers(1, 4)), len(visible)), replace=False)
    return make(np.where(np.isin(np.arange(len(size)), kept), size, 0.0))


def one_joint(cell: SimulatedCell, rng: Rng, make: PerJoint) -> SampledEffect:
    """Effect that `make` makes of magnitudes (n,): 1e-4 of either sign for one visible joint, 0 for others."""
    size = 1e-4 * cell.nominal.is_revolute
    visible_mm = np.array([cell.visible_rms_mm(make(size * row)) for row in np.eye(len(size))])
    joint = rng.choice(np.flatnonzero(visible_mm > 0.2 * visible_mm.max()))
    return make(np.eye(len(size))[joint] * 1e-4 * rng.choice([-1.0, 1.0]))
