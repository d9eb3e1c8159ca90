"""Poses of the flange against points that its tool visited: the tool point, the base's frame and the rows that err.

Without points, at one tip that was visited in several attitudes, it is the pivoting of a tool: all points are one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.consistency.agreement import points_of_poses
from calib.consistency.joint_convention import FEWEST_POSES, best_agreement
from calib.dataset.dataset import Dataset
from calib.frames import apply, frame_motion, invert
from calib.kinematics.chain import nominal_chain
from calib.kinematics.tool_point import tool_point_of
from calib.statistics import rms_length

_QUANTILE = 1.716  # sigmas of an axis, within which three fifths of the lengths of three normal numbers lie
_FAR = 6.0  # sigmas of an axis, from which a row is none of noise
_LEAST_GOOD = 0.5  # of the rows; fewer that agree show no bad ones
_POORLY, _POORLY_MM = 3.0, 0.1  # times a point's noise, from which a direction is poorly known; what is well known
_ONE_PLACE_MM = 1e-6


@dataclass(frozen=True)
class FlangeFit(Brief):
    """Tool point, from the flange, and frame of the base, as poses of the flange and points together tell them."""

    tool_point_mm: Array  # (3,) in the flange's frame
    tool_covariance_mm2: Array  # (3, 3)
    instrument_T_base: Array | None  # (4, 4) of the first setup; None where all points are one
    base_sigma: Array  # (6,) of its place, mm, and its small turn, rad, along and about the instrument's axes
    off_mm: Array  # (M,) distances of the tips from where they were measured

    @property
    def tool_sigma_mm(self) -> Array:
        """Standard deviations (3,) along the flange's axes, mm."""
        return np.sqrt(np.diag(self.tool_covariance_mm2))

    @property
    def worst(self) -> tuple[float, Array]:
        """Largest standard deviation of the tool point, mm, and its direction (3,) in the flange's frame."""
        values, directions = np.linalg.eigh(self.tool_covariance_mm2)
        along = directions[:, -1]
        return float(np.sqrt(values[-1])), along * np.sign(along[np.argmax(np.abs(along))])


def bad_rows(dataset: Dataset) -> dict[str, float]:
    """Poses whose points are too far from the others' agreement for noise, with the distance, mm."""
    poses, points_mm = points_of_poses(dataset)
    if len(poses) <= FEWEST_POSES:
        return {}
    off_mm = best_agreement(dataset.robot, dataset.poses.q[poses], points_mm).off_mm
    sigma_mm = float(np.sort(off_mm)[int(0.6 * len(off_mm))]) / _QUANTILE
    bad = np.flatnonzero(off_mm > _FAR * sigma_mm)
    if len(off_mm) - len(bad) < max(FEWEST_POSES, _LEAST_GOOD * len(off_mm)):
        return {}
    return {dataset.poses.ids[poses[k]]: float(off_mm[k]) for k in bad}


def flange_fit(calibration: Calibration) -> FlangeFit | None:
    """What a fit to poses of the flange tells of tool and base; None for an arm with links, or for full poses."""
    dataset, robot = calibration.fitted_dataset, calibration.robot
    if not robot.is_cartesian or robot.carries_scanner or calibration.residual != "position":
        return None
    poses, points_mm = points_of_poses(dataset)
    base_T_flange = nominal_chain(robot, dataset.poses.q[poses]).base_T_flange
    tips_mm = apply(base_T_flange, tool_point_of(robot))
    _, setup = np.unique(dataset.poses.setup[poses], return_inverse=True)
    is_one = rms_length(points_mm - points_mm[0]) < _ONE_PLACE_MM
    width = 3 if is_one else 6
    columns = np.zeros((len(poses), 3, 3 + width * (setup.max() + 1)))
    columns[..., :3] = base_T_flange[:, :3, :3]
    for k in range(setup.max() + 1):
        rows = setup == k
        columns[rows, :, 3 + width * k : 3 + width * (k + 1)] = frame_motion(tips_mm[rows], np.zeros(3))[..., :width]
    jacobian = columns.reshape(-1, columns.shape[-1])
    frames_ = calibration.after.scanner_T_base
    frame_of = {int(k): frames_[name] for k, name in zip(setup, dataset.poses.setup[poses].tolist(), strict=True)}
    off = (
        np.stack([apply(invert(frame_of[int(k)]), point) for k, point in zip(setup, points_mm, strict=True)]) - tips_mm
    )
    dof = max(off.size - np.linalg.matrix_rank(jacobian), 1)
    size = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-12, hermitian=True)
    covariance = float(np.sum(off**2)) / dof * inverse / np.outer(size, size)
    turn = frame_of[0][:3, :3]
    of_base = covariance[3 : 3 + width, 3 : 3 + width]
    in_instrument = [turn @ of_base[k : k + 3, k : k + 3] @ turn.T for k in range(0, width, 3)]
    return FlangeFit(
        tool_point_of(robot),
        covariance[:3, :3],
        None if is_one else frame_of[0],
        np.sqrt(np.concatenate([np.diag(block) for block in in_instrument])),
        np.linalg.norm(off, axis=1),
    )


def tool_sentence(found: FlangeFit) -> str:
    """Sentence on the tool point with its sigmas, and on how far the tips are from the points or from each other."""
    each = zip(found.tool_point_mm, found.tool_sigma_mm, strict=True)
    place = ", ".join(f"{value:.2f} ± {sigma:.2g}" for value, sigma in each)
    scatter = f"{np.min(found.off_mm):.2g} to {np.max(found.off_mm):.2g} mm"
    where = "the points" if found.instrument_T_base is not None else "their common place"
    return f"the tool point is at {place} mm from the flange; its tips are {scatter} from {where}"


def poorly_known_sentence(found: FlangeFit) -> str:
    """Sentence on a direction in which the poses hardly determine the tool point; "" where there is none."""
    sigma_mm, along = found.worst
    if sigma_mm < max(_POORLY * float(np.sqrt(np.mean(found.off_mm**2) / 3.0)), _POORLY_MM):
        return ""
    x, y, z = np.round(along, 2) + 0.0
    return (
        f"the tool point is known to {sigma_mm:.2g} mm along ({x:g}, {y:g}, {z:g}) of the flange: the poses hardly "
        "turn; add poses that turn the flange about axes across it"
    )
