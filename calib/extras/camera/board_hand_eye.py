"""Hand-eye calibration of an arm as its table has it, from poses of a board that a camera sees.

The camera is on the flange and the board in the room, or the other way round: then the camera's poses in the board's
frame are those of a camera in the room seen from a board on the flange, and the same equations hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.kinematics.hand_eye import solve_hand_eye
from calib.statistics import rms_length


@dataclass(frozen=True)
class BoardHandEye:
    """Camera's and board's place for an arm without errors, and how far the measured poses are from them."""

    on_flange: bool  # whether the camera is on the flange
    parent_T_camera: Array  # (4, 4) parent: the flange where the camera is on it, else the base
    parent_T_board: Array  # (4, 4) parent: the base where the camera is on the flange, else the flange
    error_mm: Array  # (M, 3) of the board's middle, predicted minus measured, camera frame
    error_rad: Array  # (M, 3) of its attitude, rotation vectors
    scale: float  # of the measured lengths at which they agree best with the arm's; 1 where they agree
    scale_sigma: float
    is_determined: bool

    @property
    def rms_mm(self) -> float:
        """Root mean square of the errors of the board's middle, 3D, mm."""
        return rms_length(self.error_mm)


def board_hand_eye(base_T_flange: Array, camera_T_board: Array, *, on_flange: bool) -> BoardHandEye:
    """Hand-eye calibration from M poses of the flange and of the board in the camera's frame, (M, 4, 4) mm each."""
    seen = camera_T_board if on_flange else frames.invert(camera_T_board)
    names = np.full(len(seen), "")
    found = solve_hand_eye(base_T_flange, seen[:, :3, 3], names, np.full(len(seen), "jig"), seen[:, :3, :3])
    flange_T_one = found.flange_T_scanner[""]
    turns = base_T_flange[:, :3, :3] @ flange_T_one[:3, :3] @ seen[:, :3, :3]
    base_T_other = frames.make_transform(frames.mean_rotation(turns), found.position_mm["jig"])
    if on_flange:
        predicted = frames.invert(base_T_flange @ flange_T_one) @ base_T_other
        camera, board = flange_T_one, base_T_other
    else:
        predicted = frames.invert(base_T_other) @ base_T_flange @ flange_T_one
        camera, board = base_T_other, flange_T_one
    error_rad = frames.rotvec_from_rotation(predicted[:, :3, :3] @ np.swapaxes(camera_T_board[:, :3, :3], 1, 2))
    error_mm = predicted[:, :3, 3] - camera_T_board[:, :3, 3]
    scale, sigma = _scale(base_T_flange, flange_T_one[:3, :3], seen[:, :3, 3])
    determined = not found.undetermined_rotation and not len(found.undetermined_shifts)
    return BoardHandEye(on_flange, camera, board, error_mm, error_rad, scale, sigma, determined)


def _scale(base_T_flange: Array, turn: Array, seen_mm: Array) -> tuple[float, float]:
    """Factor of the measured lengths that fits R (X s m + t) + b = p best, with its sigma, the rotation X known."""
    count = len(seen_mm)
    rotation = base_T_flange[:, :3, :3]
    columns = np.zeros((count, 3, 7))
    columns[:, :, 0] = np.einsum("mij,jk,mk->mi", rotation, turn, seen_mm)
    columns[:, :, 1:4] = rotation
    columns[:, :, 4:] = -np.eye(3)
    flat, right = columns.reshape(-1, 7), -base_T_flange[:, :3, 3].ravel()
    size = np.linalg.norm(flat, axis=0)
    solution, _, rank, _ = np.linalg.lstsq(flat / size, right, rcond=1e-9)
    if rank < 7 or len(right) <= 7:
        return 1.0, float("inf")
    left = right - flat / size @ solution
    covariance = np.linalg.inv((flat / size).T @ (flat / size)) * float(left @ left) / (len(right) - 7)
    return float(solution[0] / size[0]), float(np.sqrt(covariance[0, 0]) / size[0])
