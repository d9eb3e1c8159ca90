"""Encoders on the link's side (link_q<j>_deg): where the links stand, and what lies between them and their motors.

Such an encoder sees the joint behind gear and spring, so the kinematics take its angle in place of the motor's. What it
differs from the motor's by, less the constant between both zeros, shows the drive without any instrument: compliance,
transmission error, backlash. Laws of these are chosen one by one by the F test, and taken where the encoder was not
read, as at targets to be reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.signals import drive_inputs, link_angle_rad
from calib.kinematics.chain import nominal_chain
from calib.kinematics.drive import HARMONICS, knows_load, term_columns
from calib.kinematics.robot import DriveTerm, LinkEncoder, Robot
from calib.rendering import numbers
from calib.statistics import f_sf, rms

FEWEST_POSES = 12  # from which what lies between motor and link can be told
MAX_P = 0.003  # of a law beside the others, times the number of laws
_LARGEST_RAD = 0.05  # that a drive yields by
_RANK = 1e-6  # share of a law's columns below which they add nothing


def with_link_encoders(dataset: Dataset) -> Dataset:
    """The dataset whose robot takes the angles of encoders on the link's side, with notes that say what they show.

    The dataset itself where there are none. Columns that do not follow their joint are not used.
    """
    poses, robot = dataset.poses, dataset.robot
    trained = np.flatnonzero(~poses.is_test)
    encoders, warnings = [], []
    for joint in np.flatnonzero(robot.is_revolute).tolist():
        link_rad = link_angle_rad(poses, joint)
        if link_rad is None:
            continue
        column = f"link_q{joint + 1}_deg"
        turn = link_rad - poses.q[:, joint]
        offset = float(np.angle(np.mean(np.exp(1j * turn[trained]))))
        off = (turn - offset + np.pi) % (2.0 * np.pi) - np.pi
        largest = float(np.abs(off).max(initial=0.0))
        if largest > _LARGEST_RAD:
            warnings.append(
                f"{column}: not used, as it is off from the angle of joint {joint + 1} by up to "
                f"{np.degrees(largest):.3g} deg beside a constant, too much for a drive; check its sign and its joint"
            )
            continue
        constant = float(np.mean(off[trained]))
        encoders.append(_encoder(dataset, joint, off - constant, offset + constant, trained))
    if not encoders:
        return replace(dataset, warnings=(*dataset.warnings, *warnings)) if warnings else dataset
    return replace(
        dataset,
        robot=replace(robot, link_encoders=tuple(encoders)),
        warnings=(*dataset.warnings, *warnings),
        notes=(*dataset.notes, _note(encoders)),
    )


@dataclass(frozen=True)
class _Law:
    name: str
    columns: Array  # (T, K) less their mean
    mean: Array  # (K,)


def _encoder(dataset: Dataset, joint: int, turn: Array, offset_rad: float, trained: IndexArray) -> LinkEncoder:
    """What an encoder shows of its drive, from the turn (N,) of the link against the motor."""
    noise = dataset.signal_noise.link_sigma_rad
    y = turn[trained]
    laws = _laws(dataset.robot, dataset.poses, joint, trained) if len(trained) >= FEWEST_POSES else []
    chosen = _chosen(laws, y)
    square, dof = _left(chosen, y)
    values, sigmas = _fitted(chosen, y, square / dof)
    ends = np.cumsum([0, *(law.columns.shape[1] for law in chosen)])
    terms = [
        DriveTerm(
            law=law.name,
            values=tuple(values[a:b].tolist()),
            sigmas=tuple(sigmas[a:b].tolist()),
            mean_rad=float(law.mean @ values[a:b]),
            share=(_left([one for one in chosen if one is not law], y)[0] - square) / max(float(y @ y), 1e-300),
        )
        for law, a, b in zip(chosen, ends[:-1], ends[1:], strict=True)
    ]
    return LinkEncoder(
        joint=joint,
        offset_rad=offset_rad,
        terms=tuple(sorted(terms, key=lambda term: -term.share)),
        rms_rad=rms(y),
        left_rad=float(np.sqrt(square / dof)),
        sigma_rad=noise,
    )


def _laws(robot: Robot, poses: Poses, joint: int, trained: IndexArray) -> list[_Law]:
    """Laws that may lie between a motor and its link, at the poses that are fitted."""
    chain = nominal_chain(robot, poses.q)
    names = ["joint_compliance", "gravity_backlash"] if knows_load(robot, joint) else ["unknown_masses"]
    names += ["backlash"] if poses.approach is not None else []
    ratio = robot.joints[joint].gear_ratio
    waves = [*HARMONICS, *([ratio, 2.0 * ratio] if ratio else [])]
    names += ["joint_scale", *(f"harmonic {n:g}" for n in waves)]
    laws = []
    for name in names:
        columns = term_columns(robot, chain, joint, name, drive_inputs(poses, joint))[trained]
        mean = columns.mean(axis=0)
        if np.any(np.abs(columns - mean) > _RANK * np.abs(columns).max(initial=1e-300)):
            laws.append(_Law(name, columns - mean, mean))
    return laws


def _chosen(laws: Sequence[_Law], y: Array) -> list[_Law]:
    """Laws without which a turn (T,) is explained worse than by chance: the best first, then those that still count."""
    chosen: list[_Law] = []
    while True:
        others = [law for law in laws if law not in chosen]
        gains = [(_gain(chosen, law, y), k) for k, law in enumerate(others)]
        best = max(gains, default=(0.0, -1))
        if best[0] <= 0.0 or _p_value(chosen, others[best[1]], y) * len(laws) > MAX_P:
            break
        chosen.append(others[best[1]])
    for law in list(chosen):
        if _p_value([one for one in chosen if one is not law], law, y) * len(laws) > MAX_P:
            chosen.remove(law)
    return chosen


def _gain(beside: Sequence[_Law], law: _Law, y: Array) -> float:
    """Log likelihood that a law gains beside others, less half of log N for each of its values."""
    before, dof = _left(beside, y)
    after, dof_after = _left([*beside, law], y)
    if dof_after < 2.0:
        return 0.0
    return 0.5 * len(y) * float(np.log(max(before, 1e-300) / max(after, 1e-300))) - 0.5 * (dof - dof_after) * float(
        np.log(len(y))
    )


def _p_value(beside: Sequence[_Law], law: _Law, y: Array) -> float:
    """F test of a law beside others."""
    before, dof = _left(beside, y)
    after, dof_after = _left([*beside, law], y)
    if dof_after < 1.0 or dof <= dof_after:
        return 1.0
    return f_sf((before - after) / (dof - dof_after) / max(after / dof_after, 1e-300), dof - dof_after, dof_after)


def _left(laws: Sequence[_Law], y: Array) -> tuple[float, float]:
    """Squared turn that some laws leave, and its degrees of freedom (at least one)."""
    if not laws:
        return float(y @ y), max(len(y) - 1.0, 1.0)
    u, s, _ = _svd(laws)
    rest = y - u @ (u.T @ y)
    return float(rest @ rest), max(len(y) - 1.0 - len(s), 1.0)


def _fitted(laws: Sequence[_Law], y: Array, variance: float) -> tuple[Array, Array]:
    """Least-squares values of all laws, of least length where several are alike, and their sigmas."""
    if not laws:
        return np.zeros(0), np.zeros(0)
    u, s, vt = _svd(laws)
    scales = np.concatenate([np.linalg.norm(law.columns, axis=0) for law in laws])
    scales = np.maximum(scales, 1e-300)
    values = vt.T @ ((u.T @ y) / s) / scales
    return values, np.sqrt(variance * np.sum((vt.T / s) ** 2, axis=1)) / scales


def _svd(laws: Sequence[_Law]) -> tuple[Array, Array, Array]:
    columns = np.concatenate([law.columns for law in laws], axis=1)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, s, vt = np.linalg.svd(columns, full_matrices=False)
    kept = s > _RANK * s[0]
    return u[:, kept], s[kept], vt[kept]


def _note(encoders: Sequence[LinkEncoder]) -> str:
    """Sentence that says that the links' own angles are used."""
    joints = [str(encoder.joint + 1) for encoder in encoders]
    of = f"{'joint' if len(joints) == 1 else 'joints'} {numbers.listing(joints)}"
    return (
        f"the angle of {of} is that of the encoder on the link (link_q{joints[0]}_deg"
        f"{' ...' if len(joints) > 1 else ''}), less a constant; effects between motor and link are told from the "
        "difference of both"
    )
