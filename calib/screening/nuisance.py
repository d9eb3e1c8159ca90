"""Uncertainty of the residual from quantities that a model's effects use but do not fit: masses, centres of mass.

An effect of load that is in the model predicts by the masses of robot.toml. Where these are off, it leaves a pattern
that other effects can follow. Each uncertain quantity is one column: the change of the prediction by one prior sigma of
it. The residual is then judged as if the noise had these directions too: its covariance is 1 + N N^T, with the noise's
variance as unit and N (R, K) what projection leaves of the columns. They are never a cause of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, Vector
from calib.calibration.calibrate import UNTOLD_TOOL_KG
from calib.dataset.dataset import Poses
from calib.effects.effect import Effect, apply_values, corrects_robot
from calib.effects.gravity import tells_tool_mass
from calib.effects.state import RobotState
from calib.fitting.model import point_by_state
from calib.fitting.position_residuals import PositionResiduals
from calib.kinematics.robot import Joint, MeasuredLoad, Robot
from calib.kinematics.statics import uncertain_loads

MASS_SHARE = 0.3  # prior sigma of a link's and of a payload's mass over itself
UNLISTED_KG = 0.3  # prior sigma of what a tool whose mass is told weighs besides, such as cables
CENTRE_MM = 30.0  # prior sigma per coordinate of a centre of mass
REPORTED_EVIDENCE = 3.0  # log evidence from which they are reported to explain a part of the residual
_FEWEST_FREE = 10  # degrees of freedom outside the columns, from which these alone give the noise


@dataclass(frozen=True)
class Nuisance:
    """Directions of the residual that are uncertain through masses and centres of mass, orthonormal, with prior sigmas.

    `log_evidence` compares a residual with these directions in its noise against one without.
    """

    directions: Array  # (R, K) projected
    sizes: Array  # (K,) prior sigmas along them, the noise's being 1
    log_evidence: float

    @classmethod
    def of(cls, columns: Array, residual: Array, dof: int) -> Nuisance | None:
        """Uncertain directions of a projected residual (R,), from its changes (R, K) by uncertain masses; or None."""
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        visible = s > 1e-9 * np.sqrt(len(residual))
        u, s = u[:, visible], s[visible]
        if not len(s):
            return None
        along = u.T @ residual
        total = float(residual @ residual)
        free = dof - len(s)
        noise2 = (total - float(along @ along)) / free if free >= _FEWEST_FREE else total / dof
        sizes = s / np.sqrt(max(noise2, 1e-300))
        shrunk = total - float(np.sum(along**2 * (1.0 - 1.0 / (1.0 + sizes**2))))
        gain = -0.5 * float(np.sum(np.log1p(sizes**2))) - 0.5 * dof * float(np.log(shrunk / total))
        return cls(u, sizes, gain)

    def whitened(self, columns: Array) -> Array:
        """Projected columns (R, K), or a residual (R,), whitened for noise and uncertain directions together."""
        return columns - self.directions @ _scaled(self.removed, self.directions.T @ columns)

    @property
    def removed(self) -> Array:
        """Share (K,) of a column along each direction that whitening takes away."""
        return 1.0 - 1.0 / np.sqrt(1.0 + self.sizes**2)

    def coloured(self, columns: Array) -> Array:
        """Inverse of `whitened`: whitened columns, or a residual, back in units of the noise alone."""
        more = np.sqrt(1.0 + self.sizes**2) - 1.0
        return columns + self.directions @ _scaled(more, self.directions.T @ columns)


def _scaled(factors: Array, rows: Array) -> Array:
    return factors[:, None] * rows if rows.ndim > 1 else factors * rows


def load_columns(residuals: PositionResiduals, x: Array, base_to_residual: Array) -> Array:
    """Change (R, K) of the whitened residual by one prior sigma of each mass and centre of mass; K may be 0."""
    model, observed = residuals.model, residuals.observed
    robot = model.loads_of
    none = np.zeros((observed.points.coordinates * len(observed.points), 0))
    if robot is None or not model.added_effects:
        return none
    poses, row = observed.used_poses
    loaded = RobotState.nominal(robot, poses)
    heavier_loads = tuple(map(_more, robot.measured_loads))
    heavier = replace(robot, joints=tuple(map(_heavier, robot.joints)), measured_loads=heavier_loads)
    heavy = loaded.with_masses_of(heavier, poses)
    changes = [loaded.with_masses_of(*changed) for changed in _uncertain(robot, poses)]
    added = [
        (effect, values)
        for effect, values in zip(model.effects, model.values_by_effect(x), strict=True)
        if not corrects_robot(effect)
    ]
    out = np.zeros((len(observed.points), 3, len(changes)))
    for target in map(str, np.unique(observed.points.target)):
        start = RobotState.nominal(model.robot, poses, observed.seen(target))
        of_load = [one for one in added if np.any(_moved([one], start, heavy) - _moved([one], start, loaded))]
        if not of_load:
            return none
        by_state = point_by_state(model.state(x, poses, observed.seen(target)), target)[1]
        before = _moved(of_load, start, loaded)
        of_target = observed.points.target == target
        for k, changed in enumerate(changes):
            difference = _moved(of_load, start, changed) - before
            touched = np.flatnonzero(difference.any(axis=0))
            column = np.sum(by_state[..., touched] * difference[:, None, touched], axis=-1)
            out[of_target, :, k] = column[row[of_target]]
    return np.asarray((base_to_residual @ out).reshape(-1, len(changes)))


def _moved(effects: Sequence[tuple[Effect, Array]], start: RobotState, loaded: RobotState) -> Array:
    """State vector (1 or N, S) after applying effects with given values, with loads computed at another state."""
    state = start.with_loads_at(loaded)
    for effect, values in effects:
        state = apply_values(effect, state, values)
    return state.vector


def _uncertain(robot: Robot, poses: Poses) -> Iterator[tuple[Robot, Poses]]:
    """Variants of robot and poses, each with one mass, centre of mass or measured load changed by its prior sigma."""
    yield from ((variant, poses) for variant in uncertain_loads(robot))
    for k, joint in enumerate(robot.joints):
        if joint.mass_kg:
            yield _with_joint(robot, k, _heavier(joint)), poses
            for com_mm in _shifted(joint.com_mm or (0.0, 0.0, 0.0)):
                yield _with_joint(robot, k, replace(joint, com_mm=com_mm)), poses
    tool = robot.tool
    tool_point_mm = (tool.a_mm * float(np.cos(tool.theta_rad)), tool.a_mm * float(np.sin(tool.theta_rad)), tool.d_mm)
    unlisted_kg = UNLISTED_KG if tells_tool_mass(robot, poses.payload_kg) else UNTOLD_TOOL_KG
    mass_kg = (1.0 + MASS_SHARE) * (tool.mass_kg or 0.0) + unlisted_kg
    hangs_at_mm = tool.com_mm if tool.mass_kg else tool_point_mm
    yield replace(robot, tool=replace(tool, mass_kg=mass_kg, com_mm=hangs_at_mm)), poses
    if poses.payload_kg is not None and np.any(poses.payload_kg):
        yield robot, replace(poses, payload_kg=(1.0 + MASS_SHARE) * poses.payload_kg)
        for com_mm in _shifted(tool.payload_com_mm or tool_point_mm):
            yield replace(robot, tool=replace(tool, payload_com_mm=com_mm)), poses


def _more(load: MeasuredLoad) -> MeasuredLoad:
    return replace(load, weights=tuple((1.0 + MASS_SHARE) * weight for weight in load.weights))


def _heavier(joint: Joint) -> Joint:
    return replace(joint, mass_kg=(1.0 + MASS_SHARE) * joint.mass_kg) if joint.mass_kg else joint


def _with_joint(robot: Robot, k: int, joint: Joint) -> Robot:
    return replace(robot, joints=(*robot.joints[:k], joint, *robot.joints[k + 1 :]))


def _shifted(place_mm: Vector) -> Iterator[Vector]:
    """Three variants of a centre of mass: shifted by `CENTRE_MM` along x, y and z of its frame in turn."""
    x, y, z = place_mm
    yield from ((x + CENTRE_MM, y, z), (x, y + CENTRE_MM, z), (x, y, z + CENTRE_MM))
