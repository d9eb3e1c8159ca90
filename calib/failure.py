"""Where a model fails: each pose's residual, and the joint motion that would explain it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from calib.calibration import Calibration
from calib.screening import Leftover, leftover_of
from calib.structure import inputs_of, joint_directions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Failure:
    """The residual of the training poses, seen from several sides. N used poses of an arm with n joints."""

    pose_ids: tuple[str, ...]
    error_mm: Array  # (N, 3) predicted minus measured, scanner frame, mean over a pose's points
    noise_mm: float  # what one coordinate may be off by noise alone
    apparent_joint_error: (
        Array  # (N, n) rad or mm: each joint's own motion that would best explain the residual
    )
    inputs: dict[str, Array]  # everything it may depend on, (N,)
    apparent_joint_noise: (
        Array  # (N, n) what noise alone does to `apparent_joint_error`; nan where it tells nothing
    )

    @property
    def error_length_mm(self) -> Array:
        """(N,) 3D error."""
        return np.asarray(np.linalg.norm(self.error_mm, axis=1))

    @property
    def length_noise_mm(self) -> float:
        """The 3D error that noise alone exceeds at one pose in twenty (chi of 3 degrees of freedom)."""
        return self.noise_mm * float(np.sqrt(chi2.ppf(0.95, 3)))

    def joint_noise(self, joint: int) -> float:
        """One sigma of a joint's apparent motion by noise alone, median over the poses; nan where no pose tells it."""
        noise = self.apparent_joint_noise[:, joint]
        return float(np.median(noise[np.isfinite(noise)])) if np.isfinite(noise).any() else float("nan")

    def to_frame(self) -> pd.DataFrame:
        """One row a pose: errors, apparent joint errors (degrees or mm), and every input."""
        columns: dict[str, object] = {"pose": self.pose_ids}
        columns |= {f"error_{axis}_mm": self.error_mm[:, k] for k, axis in enumerate("xyz")}
        columns["error_mm"] = np.linalg.norm(self.error_mm, axis=1)
        columns |= {
            f"apparent_{j + 1}": self.apparent_joint_error[:, j]
            for j in range(self.apparent_joint_error.shape[1])
        }
        return pd.DataFrame(columns | self.inputs)

    def worst(self, count: int = 5) -> tuple[str, ...]:
        """The poses that are off the most."""
        order = np.argsort(-np.linalg.norm(self.error_mm, axis=1))
        return tuple(self.pose_ids[i] for i in order[:count])


def failure_of(calibration: Calibration, leftover: Leftover | None = None) -> Failure:
    """Look at what a calibration left over.

    The apparent error of joint j at a pose is the least-squares motion of that joint alone: d_j . e / |d_j|^2, d_j how
    the measured point moves with the joint. Joints are taken one at a time, so they do not add up.
    """
    left = leftover or leftover_of(calibration)
    observed = left.residuals.observed
    poses, row = observed.used_poses
    raw = left.residuals.residual(left.x).reshape(-1, 3)
    count = np.bincount(row, minlength=len(poses))
    error = np.zeros((len(poses), 3))
    unwhiten = np.linalg.cholesky(observed.covariance_mm2)
    np.add.at(error, row, np.einsum("mij,mj->mi", unwhiten, raw))
    apparent = np.zeros((len(poses), calibration.dataset.robot.n_joints))
    noise = np.full_like(apparent, np.nan)
    for j, direction in enumerate(joint_directions(left)):
        along, size = np.zeros(len(poses)), np.zeros(len(poses))
        np.add.at(along, row, np.sum(direction * raw, axis=1))
        np.add.at(size, row, np.sum(direction**2, axis=1))
        # A joint whose axis passes the point close by explains nothing: its motion would be huge.
        usable = size > 1e-4 * max(float(size.max()), 1e-300)
        apparent[usable, j] = -along[usable] / size[usable]
        noise[usable & (size > 0.0), j] = 1.0 / np.sqrt(size[usable & (size > 0.0)])
    sigma = np.sqrt(np.trace(observed.covariance_mm2, axis1=1, axis2=2) / 3.0)
    return Failure(
        pose_ids=poses.ids,
        error_mm=error / np.maximum(count, 1)[:, None],
        noise_mm=float(np.sqrt(np.mean(sigma**2))),
        apparent_joint_error=apparent,
        inputs=inputs_of(calibration.dataset, left),
        apparent_joint_noise=noise,
    )


def running_median(x: ArrayLike, y: ArrayLike, width: int = 9) -> tuple[Array, Array]:
    """A smooth of y (N,) over x (N,): x sorted, and at each the median of the `width` points nearest in rank.

    At the ends the window shrinks symmetrically, so that a slope is not bent there.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    order = np.argsort(x, kind="stable")
    ordered = y[order]
    n = len(ordered)
    halves = [min(width // 2, i, n - 1 - i) for i in range(n)]
    return x[order], np.array([np.median(ordered[i - h : i + h + 1]) for i, h in enumerate(halves)])
