"""Random arms with hidden effects, by number, from calib/simulation/truth; and the bound of their held-out error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from simulated import heavy_arm, scara, ur10e

from calib.array_types import Array
from calib.effects.catalogue import CATALOGUE
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD
from calib.errors import CalibError
from calib.kinematics.chain import target_jacobian
from calib.kinematics.robot import Robot
from calib.simulation.measured_dataset import Simulation
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.arm_sampling import Tolerances
from tests.support.arms import random_arm

TESTABLE = tuple(kind.name for kind in CATALOGUE if kind.testable)
HIDDEN_SHARE = (0.4, 0.45, 0.15)  # of the arms have no, one, two effects


@dataclass(frozen=True)
class DrawnArm:
    """A simulated cell and what is known of it."""

    kind: str
    effects: tuple[str, ...]  # that are there
    noise_mm: float
    simulation: Simulation

    @cached_property
    def bound_mm(self) -> float:
        """The Cramer-Rao bound of the held-out 3D RMS error of a fit of link errors alone, at the true arm.

        The measured points' own noise counts in it: sqrt(3 s^2 + mean trace of the predictions' covariance), the
        scanner's frames unknown, the parameters held as softly as the fit holds them.
        """
        dataset, robot = self.simulation.dataset, self.simulation.truth.robot
        assert dataset.points is not None
        pose = dataset.points.pose
        by_parameters = target_jacobian(robot, dataset.poses.q)[pose]  # (N, 3, P)
        places, setup = np.unique(dataset.poses.setup[pose], return_inverse=True)
        base_mm = _base_points(robot, dataset.poses.q)[pose] / 1e3
        by_frames = np.zeros((len(pose), 3, 6 * len(places)))
        for k, point in enumerate(base_mm):
            x, y, z = point
            turn = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
            by_frames[k, :, 6 * setup[k] : 6 * setup[k] + 6] = np.hstack([np.eye(3), turn])
        test = dataset.poses.is_test[pose]
        scale = np.tile([TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_RAD], robot.n_joints + 1)
        jacobian = np.concatenate([by_parameters, by_frames], axis=2)
        rows = jacobian[~test].reshape(-1, jacobian.shape[2]) / self.noise_mm
        known = np.concatenate([1 / scale**2, np.full(by_frames.shape[2], 1e-12)])
        covariance = np.linalg.inv(rows.T @ rows + np.diag(known))
        predicted = np.einsum("nip,pq,niq->n", jacobian[test], covariance, jacobian[test])
        return float(np.sqrt(3 * self.noise_mm**2 + predicted.mean()))


def _base_points(robot: Robot, q: Array) -> Array:
    from calib.kinematics.chain import target_points

    return np.asarray(target_points(robot, q))


def _robot(rng: np.random.Generator) -> tuple[str, Robot]:
    kind = int(rng.integers(8))
    if kind < 5:
        return heavy_arm(kind, rng)
    if kind == 5:
        return "ur10e", ur10e()
    if kind == 6:
        return "scara", scara()
    joints = int(rng.integers(4, 8))
    return f"slide {joints}", random_arm(rng, joints, prismatic=int(rng.integers(joints)))


def draw(number: int, seed: int) -> DrawnArm:
    """The arm of this number. What its robot cannot have is drawn anew, at the most until nothing is hidden."""
    for attempt in range(8):
        rng = np.random.default_rng([seed, 3, number, attempt])
        kind, robot = _robot(rng)
        count = int(rng.choice(3, p=HIDDEN_SHARE)) if attempt < 7 else 0
        effects = [(str(name), float(rng.uniform(2, 8))) for name in rng.choice(TESTABLE, count, replace=False)]
        noise_mm = float(np.exp(rng.uniform(np.log(0.02), np.log(0.15))))
        size = float(rng.choice([0.5, 1.0, 3.0]))
        try:
            simulation = simulate_dataset(
                robot,
                rng=rng,
                effects=effects,
                conditions=bool(rng.integers(2)) or None,
                poses=int(rng.integers(50, 110)),
                noise_mm=noise_mm,
                setups=int(rng.choice([1, 1, 1, 2])),
                tolerances=Tolerances(0.3 * size, 0.1 * size),
            )
        except CalibError:
            continue
        dataset = replace(simulation.dataset, scanner=replace(simulation.dataset.scanner, point_sigma_mm=noise_mm))
        return DrawnArm(kind, simulation.truth.effect_names, noise_mm, replace(simulation, dataset=dataset))
    raise AssertionError(f"arm {number}: nothing could be simulated")
