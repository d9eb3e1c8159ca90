"""Loads of joints from their measured torques (torque<j>_nm), in place of the masses of robot.toml.

A measured torque is the input of a slope, the compliance, and its noise would make that slope too small. So the load is
the mean of the true torque given the reading and the pose (regression calibration): the torque by weight, whose masses
and first moments the readings of all poses tell (`calib.kinematics.statics`), and of what a reading differs from it as
much as is no noise. The noise is that which dataset.toml declares, else the scatter of repeats, else what a weight at
the flange, another at each pose, does not explain of several joints at once: an unsaid load pulls at all of them, noise
at each by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.repeats import groups_by_condition
from calib.dataset.signals import measured_torque_nm
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.robot import MeasuredLoad, Robot
from calib.kinematics.statics import PER_LINK, masses_and_moments, statics_columns
from calib.rendering import numbers

FEWEST_POSES = 12  # from which the torques of weight can be told
_FOLLOWS = 0.3  # least correlation of torques with weight, below which they are something else
_PRIOR_KG, _PRIOR_KG_M = 10.0, 3.0  # of links whose masses are not known
_MASS_SHARE, _CENTRE_M = 0.3, 0.05  # prior sigmas of those that are
_PAYLOAD_SHARE, _PAYLOAD_M = 0.1, 0.1
_OFFSET_NM = 1e3
_FEWEST_REPEATS = 5  # degrees of freedom from which repeats tell the noise
_ROUNDS = 30
_SHOWN = 0.1  # of a reading's noise over all poses, below which a direction of the weights explains nothing
_LEAST_EXPLAINED = 0.01  # share of a torque's variance by weight, below which it is no load
_WELL_EXPLAINED = 0.98  # share of a torque's variance by weight, below which the rest deserves a warning
_NOISY = 0.05  # share of the largest torque's variation, above which noise deserves a warning
BETWEEN_JOINTS = "what no weight explains"


@dataclass(frozen=True)
class _Readings:
    """Measured torques of some joints at all poses, and which of the poses tell the weights."""

    robot: Robot
    poses: Poses
    chain: Chain
    torque_nm: dict[int, Array]  # (N,) by joint
    trained: Array  # indices of the poses that are no test poses, in the order of measuring

    def columns(self, joint: int) -> Array:
        return statics_columns(self.robot, self.chain, joint, self.poses.payload_kg)

    def weights_by_file(self, joint: int) -> tuple[Array, Array]:
        """Prior mean and sigma (4 (K + 1),) of the masses and first moments beyond a joint, by robot.toml."""
        rows = masses_and_moments(self.robot, joint).reshape(-1, PER_LINK)
        sigma = np.array([_PRIOR_KG, *[_PRIOR_KG_M] * 3]) * np.ones_like(rows)
        for row in range(len(rows) - 1):
            if self.robot.joints[joint + row].mass_kg is not None:
                mass = abs(rows[row, 0])
                sigma[row] = [_MASS_SHARE * mass + 0.3, *(_MASS_SHARE * np.abs(rows[row, 1:]) + _CENTRE_M * mass + 0.1)]
        sigma[-1] = [_PAYLOAD_SHARE, *[_PAYLOAD_M] * 3]
        return rows.reshape(-1), sigma.reshape(-1)


def with_measured_loads(dataset: Dataset) -> Dataset:
    """The dataset whose robot takes the loads of joints from their measured torques, with notes that say so.

    The dataset itself where no torque was measured. Torques that do not follow the weight of an arm are not used, nor
    are those of a joint that no weight pulls at.
    """
    poses, robot = dataset.poses, dataset.robot
    turning = robot.revolute_joints
    found = {j: torque for j in turning if (torque := measured_torque_nm(poses, j)) is not None}
    if not found:
        return dataset
    columns = numbers.listing([f"torque{j + 1}_nm" for j in found])
    trained = np.array([i for i in np.argsort(poses.order, kind="stable") if not poses.is_test[i]])
    if len(trained) < FEWEST_POSES:
        words = (
            f"{columns}: not used as loads, {len(trained)} poses that are no test poses are fewer than {FEWEST_POSES}"
        )
        return replace(dataset, warnings=(*dataset.warnings, words))
    chain = nominal_chain(robot, poses.q)
    readings = _Readings(robot, poses, chain, found, trained)
    correlation = _correlation_with_weight(readings)
    if abs(correlation) < _FOLLOWS:
        words = (
            f"{columns}: not used as loads, as they do not follow weight (correlation {correlation:.2f}); torques of "
            "the joints themselves in N m, of an arm at rest, are needed"
        )
        return replace(dataset, warnings=(*dataset.warnings, words))
    sign = 1.0 if correlation > 0.0 else -1.0
    declared_nm = dataset.signal_noise.torque_sigma_nm
    fits = [_weights(readings, j, sign) for j in found]
    noise_share = _noise_share(readings, fits)
    loads = tuple(_load(readings, one, declared_nm, noise_share) for one in fits)
    loads = tuple(load for load in loads if load.explained > _LEAST_EXPLAINED)
    if not loads:
        return dataset
    columns = numbers.listing([f"torque{load.joint + 1}_nm" for load in loads])
    largest_nm = max(float(np.std(fit.torque_nm[trained])) for fit in fits)
    doubtful = [load for load in loads if _is_doubtful(load, largest_nm)]
    return replace(
        dataset,
        robot=replace(robot, measured_loads=loads),
        warnings=(*dataset.warnings, *([_doubt(doubtful)] if doubtful else [])),
        notes=(*dataset.notes, _note(columns, loads, doubtful)),
    )


def _correlation_with_weight(readings: _Readings) -> float:
    """Correlation of all torques with those of the table's masses, or of 1 kg at each frame where it has none."""
    measured, expected = [], []
    for joint, torque_nm in readings.torque_nm.items():
        rows = masses_and_moments(readings.robot, joint).reshape(-1, PER_LINK)
        if not rows[:-1, 0].any():
            rows[:-1, 0] = 1.0
        by_weight = readings.columns(joint) @ rows.reshape(-1)
        measured.append(torque_nm[readings.trained] - torque_nm[readings.trained].mean())
        expected.append(by_weight[readings.trained] - by_weight[readings.trained].mean())
    y, x = np.concatenate(measured), np.concatenate(expected)
    return float(x @ y / max(np.linalg.norm(x) * np.linalg.norm(y), 1e-300))


@dataclass(frozen=True)
class _WeightFit:
    """Weights that explain the torques of a joint, and what they leave."""

    joint: int
    sign: float
    torque_nm: Array  # (N,) of the load
    weights: Array  # (W,)
    spread: Array  # (K, W) independent changes of them by one standard deviation each
    beside_nm: tuple[float, float]  # offset and friction
    left_nm: Array  # (T,) at the poses that tell the weights
    left_variance: float


def _weights(readings: _Readings, joint: int, sign: float) -> _WeightFit:
    """Weights, offset and friction that explain the torques of a joint."""
    poses, rows = readings.poses, readings.trained
    torque_nm = sign * readings.torque_nm[joint]
    mean, sigma = readings.weights_by_file(joint)
    columns = readings.columns(joint)
    approach = np.zeros(len(poses)) if poses.approach is None else poses.approach[:, joint]
    scaled = np.column_stack([columns * sigma, np.full(len(poses), _OFFSET_NM), approach * _OFFSET_NM])[rows]
    beyond = (torque_nm - columns @ mean)[rows]
    amounts, variance, spread = _ridge(scaled, beyond)
    beside_nm = (float(_OFFSET_NM * amounts[-2]), float(_OFFSET_NM * amounts[-1]))
    return _WeightFit(
        joint=joint,
        sign=sign,
        torque_nm=torque_nm,
        weights=mean + sigma * amounts[:-2],
        spread=spread[:, :-2] * sigma,
        beside_nm=beside_nm,
        left_nm=beyond - scaled @ amounts,
        left_variance=variance,
    )


def _load(readings: _Readings, fit: _WeightFit, declared_nm: float | None, noise_share: float) -> MeasuredLoad:
    """Load of a joint: the weights that explain its torques, their noise, and how far readings are trusted beyond."""
    rows = readings.trained
    variance, known_from = _noise(readings.poses, rows, fit, declared_nm, noise_share)
    total = max(float(np.var(fit.torque_nm[rows])), 1e-300)
    return MeasuredLoad(
        joint=fit.joint,
        weights=tuple(fit.weights.tolist()),
        sign=fit.sign,
        offset_nm=fit.beside_nm[0],
        friction_nm=fit.beside_nm[1],
        sigma_nm=float(np.sqrt(variance)),
        sigma_from=known_from,
        trust=float(np.clip(1.0 - variance / max(fit.left_variance, 1e-300), 0.0, 1.0)),
        explained=float(np.clip(1.0 - float(fit.left_nm @ fit.left_nm) / len(rows) / total, 0.0, 1.0)),
        spread=tuple(map(tuple, fit.spread.tolist())),
        slope_lost=min(variance / total, 1.0),
    )


def _ridge(scaled: Array, y: Array) -> tuple[Array, float, Array]:
    """Coefficients (K,) of columns scaled by their prior sigmas, the variance of what they leave, and their spread.

    The variance, which weighs the prior, is estimated with them. The spread (L, K) are independent changes of the
    coefficients by one standard deviation, those that change what is explained.
    """
    u, s, vt = np.linalg.svd(scaled, full_matrices=False)
    along, outside = u.T @ y, float(y @ y) - float(np.sum((u.T @ y) ** 2))
    variance = 0.01 * max(float(np.var(y)), 1e-300)
    for _ in range(_ROUNDS):
        kept = s**2 / (s**2 + variance)
        dof = max(len(y) - float(kept.sum()), 1.0)
        variance = max((max(outside, 0.0) + float(np.sum(((1.0 - kept) * along) ** 2))) / dof, 1e-12)
    shown = s > _SHOWN * np.sqrt(variance)
    spread = np.sqrt(variance / (s[shown] ** 2 + variance))[:, None] * vt[shown]
    return vt.T @ (s / (s**2 + variance) * along), variance, spread


def _noise(
    poses: Poses, rows: Array, fit: _WeightFit, declared_nm: float | None, noise_share: float
) -> tuple[float, str]:
    """Variance of a reading's noise, and where it is known from."""
    if declared_nm is not None:
        return declared_nm**2, "dataset.toml"
    torque_nm, group = fit.torque_nm[rows], groups_by_condition(poses)[rows]
    count = np.bincount(group)
    dof = int(np.sum(count[count > 0] - 1))
    if dof >= _FEWEST_REPEATS:
        mean = np.bincount(group, weights=torque_nm) / np.maximum(count, 1)
        return float(np.sum((torque_nm - mean[group]) ** 2)) / dof, "repeats"
    return noise_share * fit.left_variance, BETWEEN_JOINTS


def _noise_share(readings: _Readings, fits: Sequence[_WeightFit]) -> float:
    """Share of what weights leave of several joints' torques that no further weight at the flange, by pose, explains.

    1 where noise alone would be explained as well, and for a single joint.
    """
    rows, joints = readings.trained, len(fits)
    if joints < 2:
        return 1.0
    sizes = np.sqrt([max(fit.left_variance, 1e-300) for fit in fits])
    left = np.stack([fit.left_nm for fit in fits], axis=1) / sizes  # (T, J)
    held = np.stack([_by_payload(readings, fit.joint)[rows] for fit in fits], axis=1) / sizes
    along = np.sum(left * held, axis=1) / np.maximum(np.linalg.norm(held, axis=1), 1e-300)
    share = 1.0 - float(np.sum(along**2)) / max(float(np.sum(left**2)), 1e-300)
    by_chance = 1.0 - 1.0 / joints
    return 1.0 if share > by_chance * (1.0 - 3.0 / np.sqrt(len(rows))) else share / by_chance


def _by_payload(readings: _Readings, joint: int) -> Array:
    """Torque (N,) about a joint by a payload of 1 kg."""
    one_kg = np.ones(len(readings.poses))
    columns = statics_columns(readings.robot, readings.chain, joint, one_kg)[:, -PER_LINK:]
    return columns @ masses_and_moments(readings.robot, joint)[-PER_LINK:]


def _is_doubtful(load: MeasuredLoad, largest_nm: float) -> bool:
    """Whether much of a torque is taken for noise without proof. largest_nm: sigma of the largest of the arm."""
    large = load.explained < _WELL_EXPLAINED and load.sigma_nm > _NOISY * largest_nm
    return large and load.sigma_from == BETWEEN_JOINTS and load.trust < 0.5


def _doubt(loads: Sequence[MeasuredLoad]) -> str:
    """Warning that much of some joints' torques is no weight, and may be noise or load."""
    of_weight = [f"{100.0 * load.explained:.3g} % of torque{load.joint + 1}_nm" for load in loads]
    noise = [f"{load.sigma_nm:.2g} Nm" for load in loads]
    return (
        f"weight explains {numbers.listing(of_weight)}, and of the rest {numbers.listing(noise)} are taken for noise; "
        "if they are load (cables, contact, a payload that poses.csv does not tell), give payload_kg in poses.csv, or "
        "torque_sigma_nm in [signals] of dataset.toml, by which the readings count"
    )


def _note(columns: str, loads: Sequence[MeasuredLoad], doubtful: Sequence[MeasuredLoad]) -> str:
    """Sentence on the torques that are used, the noise of those that `_doubt` leaves, and what is done about it."""
    several = len(loads) > 1
    joints = numbers.listing([str(load.joint + 1) for load in loads])
    of = "drive's, which holds the load" if loads[0].sign < 0.0 else "load's own"
    of_noise = f"noise by {numbers.listing(list(dict.fromkeys(load.sigma_from for load in loads)))}"
    each = [
        f"joint {load.joint + 1}: weight explains {100.0 * load.explained:.3g} %, noise {load.sigma_nm:.2g} Nm, "
        f"{100.0 * load.trust:.0f} % of the rest is taken as load"
        for load in loads
        if load not in doubtful
    ]
    worst = 100.0 * max(load.slope_lost for load in loads)
    return (
        f"{columns}: the measured torque is the load of {'joints' if several else 'joint'} {joints}, in place of the "
        f"masses in robot.toml; by its sign it is the {of} ({'; '.join([*each, of_noise])}). "
        f"Slopes over it are corrected for that noise, which would make them up to {worst:.2g} % too small"
    )
