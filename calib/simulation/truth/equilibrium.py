"""Equilibrium of a simulated arm under all its effects, and the target as the scanner reports it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.brief import Brief
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.simulation.truth.mechanism import STANDARD, Arm, Conditions, TrueEffect


@dataclass(frozen=True, eq=False)
class Truth(Brief):
    """A simulated cell: the arm with its link errors and effects, and the scanner's frames."""

    robot: Robot  # the true link table; masses are those of the nominal arm
    scanners: Mapping[str, Array]
    """setup -> base_T_scanner (4, 4), flange_T_scanner where the arm carries it; the first for poses without a setup"""
    effects: tuple[TrueEffect, ...] = ()
    base_T_jig: Array | None = None  # (4, 4) of the jig in the world, for an arm that carries the scanner

    @classmethod
    def without_effects(cls, robot: Robot, base_T_scanner: ArrayLike) -> Truth:
        """A cell with one placement of the scanner and no effect."""
        return cls(robot, {"": np.asarray(base_T_scanner, dtype=float)})

    def with_effects(self, *effects: TrueEffect) -> Truth:
        """This cell with the given effects instead of its own."""
        return replace(self, effects=effects)

    @property
    def base_T_scanner(self) -> Array:
        """Scanner's frame (4, 4) of the first setup."""
        return next(iter(self.scanners.values()))

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Names of the effects with magnitudes above zero."""
        return tuple(effect.name for effect in self.effects if not effect.is_absent)


def solve_equilibrium(truth: Truth, q: ArrayLike, conditions: Conditions = STANDARD) -> Arm:
    """Equilibrium of the arm under load when q (N, n) is commanded.

    Fixed-point iteration to rounding: the deflections are those of the moments at the deflected pose.

    Raises:
        CalibError: the arm is so soft that it has no equilibrium nearby, or lacks masses or conditions.
    """
    rigid = Arm.commanded_to(truth.robot, q, conditions)
    effects = [effect for effect in truth.effects if not effect.is_absent]

    def deflected(equilibrium: Arm) -> Arm:
        arm = rigid
        for effect in effects:
            arm = effect.change_arm(arm, equilibrium)
        return arm

    if not any(effect.needs_equilibrium for effect in effects):
        return deflected(rigid)
    equilibrium = rigid
    for _ in range(300):
        arm = deflected(equilibrium)
        change = _difference(arm, equilibrium)
        equilibrium = arm
        if change < 1e-14:
            return equilibrium
        if not np.isfinite(change):
            break
    raise CalibError(
        f"robot {truth.robot.name}: with {', '.join(truth.effect_names)} this large the arm finds no equilibrium under "
        f"load (still moving by {change:.1e} rad); real joints have 1e-6 ... 1e-3 rad/Nm"
    )


def _difference(arm: Arm, other: Arm) -> float:
    """Largest difference between two states of an arm, rad; 1 m counts as 1 rad."""
    moved = (
        arm.q - other.q,
        arm.base_turn_rad - other.base_turn_rad,
        arm.link_turn_rad - other.link_turn_rad,
        1e-3 * (arm.link_shift_mm - other.link_shift_mm),
        1e-3 * (arm.target_shift_mm - other.target_shift_mm),
    )
    return max(float(np.max(np.abs(part), initial=0.0)) for part in moved)


def base_T_target(truth: Truth, q: ArrayLike, conditions: Conditions = STANDARD) -> Array:
    """True tool frame (N, 4, 4) when q (N, n) is commanded."""
    return solve_equilibrium(truth, q, conditions).base_T_frame[-1]


def scanner_T_target(truth: Truth, q: ArrayLike, conditions: Conditions = STANDARD) -> Array:
    """Tool frame (N, 4, 4), or frame of a jig fixed in the world, as the scanner reports it, without noise."""
    arm = solve_equilibrium(truth, q, conditions)
    target = arm.base_T_frame[-1]
    if truth.base_T_jig is not None:
        carried = np.tile(np.eye(4), (len(target), 1, 1))
        carried[:, :3, 3] = arm.target_shift_mm
        target = np.linalg.inv(carried @ arm.base_T_frame[-2]) @ truth.base_T_jig
    inverse = {setup: np.linalg.inv(place) for setup, place in truth.scanners.items()}
    if conditions.setup is None or len(inverse) == 1:
        seen = next(iter(inverse.values())) @ target
    else:
        seen = np.stack([inverse[str(setup)] for setup in conditions.setup]) @ target
    for effect in truth.effects:
        if not effect.is_absent:
            seen = effect.change_measurement(seen, conditions, jig_side(truth.robot))
    return seen


def jig_side(robot: Robot) -> float:
    """Sign of the tool frame's z axis along which the jig points: +1 or -1; +1 for a tool row of almost no length."""
    return -1.0 if robot.tool.d_mm < -10.0 else 1.0


def truth_document(truth: Truth, nominal: Robot) -> dict[str, Any]:
    """Entries of truth.json on the arm; angles in degrees as in all files of a dataset, effects in their own units."""
    table, error = truth.robot.table, truth.robot.table - nominal.table
    rows = [*(f"J{j + 1}" for j in range(nominal.n_joints)), "TCP"]

    def links(values: Array) -> dict[str, Mapping[str, float]]:
        keys = ("a_mm", "alpha_deg", "d_mm", "theta_deg", "beta_deg")
        scale = np.array([1.0, np.degrees(1.0), 1.0, np.degrees(1.0), np.degrees(1.0)])
        return {
            name: dict(zip(keys, (row * scale).tolist(), strict=True)) for name, row in zip(rows, values, strict=True)
        }

    document = {
        "format": 1,
        "robot": nominal.name,
        "effects": {effect.name: effect.parameters() for effect in truth.effects if not effect.is_absent},
        "links": links(table),
        "link_errors": links(error),
    }
    scanner = "base_T_scanner_mm"
    if truth.base_T_jig is not None:
        scanner = "flange_T_scanner_mm"
        document["base_T_jig_mm"] = truth.base_T_jig.tolist()
    document[scanner] = next(iter(truth.scanners.values())).tolist()
    if len(truth.scanners) > 1:
        document["setups"] = {setup: {scanner: place.tolist()} for setup, place in truth.scanners.items()}
    return document
