"""Hand-eye calibration of an arm as its table has it, from poses of a board of which a third may err.

With poses A of the flange, X and Y the places of what is on the flange and of what is in the room, and S the board's
pose in the camera's frame, or the camera's in the board's where the camera stands in the room, A X S = Y. Fits to four
poses each, in closed form (Shah 2013), are compared by the errors within which three fifths of all poses lie (least
quantile of squares, Rousseeuw 1984). From the best, X and Y follow by least squares of the poses that are no farther
off than the noise of most, in place and in attitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.statistics import rms_length

MOUNTS = ("flange", "room")
"""Where a camera may be."""
_OF, _TRIES = 4, 150  # poses of a first fit; fits
MOST = 0.6  # of the poses, whose errors decide
_FEWEST_DECIDE = 6  # poses, of which a fit to four says something
_ROUNDS = 6
_LEAST_MM, _LEAST_RAD = 1e-3, 1e-5
_OPEN = 1e-6  # share of the largest singular value, below which the poses do not determine a motion
_MM_PER_RADIAN = 500.0
FAR = 8.0  # sigmas of an axis, from which an error is none of noise


@dataclass(frozen=True)
class BoardHandEye:
    """Camera's and board's place for an arm without errors, and how far the measured poses are from them."""

    on_flange: bool  # whether the camera is on the flange
    parent_T_camera: Array  # (4, 4) parent: the flange where the camera is on it, else the base
    parent_T_board: Array  # (4, 4) parent: the base where the camera is on the flange, else the flange
    error_mm: Array  # (M, 3) of the board's middle, predicted minus measured, camera frame
    error_rad: Array  # (M, 3) of its attitude, rotation vectors
    good: BoolArray  # (M,) poses that agree with most
    scale: float  # of the measured lengths at which they agree best with the arm's; 1 where they agree
    scale_sigma: float
    scaled_mm: float  # root mean square of the good poses' errors with that scale, 3D

    @property
    def rms_mm(self) -> float:
        """Root mean square of the errors of the board's middle at the good poses, 3D, mm."""
        return rms_length(self.error_mm[self.good])

    @property
    def rms_rad(self) -> float:
        """Root mean square of the errors of the board's attitude at the good poses, rad."""
        return rms_length(self.error_rad[self.good])

    @property
    def misfit_mm(self) -> float:
        """Errors of place, with the best scale, and of attitude as one number, by which mounts compare."""
        return _as_one(self.scaled_mm, self.rms_rad)

    def misfit_of_most(self, most: float) -> float:
        """Errors of place and attitude of most poses as one number, mm."""
        return _as_one(*_sigmas(self.error_mm, self.error_rad, most=most))

    def predicted(self, base_T_flange: Array) -> Array:
        """Poses (N, 4, 4) of the board in the camera's frame, by poses of the flange."""
        return _predicted(base_T_flange, self.parent_T_camera, self.parent_T_board, self.on_flange)

    def agrees(self, base_T_flange: Array, camera_T_board: Array) -> BoolArray:
        """(N,) whether poses of the board agree with poses of the flange as the good ones do."""
        off = _errors(self.predicted(base_T_flange), camera_T_board)
        return _near(off, _sigmas(self.error_mm[self.good], self.error_rad[self.good]))


def board_hand_eye(base_T_flange: Array, camera_T_board: Array, *, on_flange: bool) -> BoardHandEye:
    """Hand-eye calibration from M poses of the flange and of the board in the camera's frame, (M, 4, 4) mm each."""
    from scipy.optimize import least_squares  # slow to load

    def predicted(unknown: Array) -> Array:
        return _predicted(base_T_flange, _transform(unknown[:6]), _transform(unknown[6:12]), on_flange)

    def weighed(unknown: Array, good: BoolArray, sigmas: Array) -> Array:
        error_mm, error_rad = _errors(predicted(unknown), camera_T_board)
        return np.concatenate([error_mm[good] / sigmas[0], error_rad[good] / sigmas[1]]).ravel()

    unknown, _ = _start(base_T_flange, camera_T_board, on_flange)
    good = np.zeros(len(base_T_flange), dtype=bool)
    for _ in range(_ROUNDS):
        off = _errors(predicted(unknown), camera_T_board)
        sigmas, before = _sigmas(*off), good
        good = _near(off, sigmas)
        if np.array_equal(before, good):
            break
        unknown = least_squares(weighed, unknown, x_scale="jac", args=(good, sigmas)).x
    error_mm, error_rad = _errors(predicted(unknown), camera_T_board)
    camera, board = _transform(unknown[:6]), _transform(unknown[6:12])
    moved = (frames.invert(base_T_flange) if on_flange else base_T_flange)[good]
    scale = _scale(moved, camera_T_board[good, :3, 3] @ camera[:3, :3].T)
    return BoardHandEye(on_flange, camera, board, error_mm, error_rad, good, *scale)


def _scale(moved: Array, seen_mm: Array) -> tuple[float, float, float]:
    """Scale s of lengths with its sigma, infinite where the poses leave it open, and the root mean square with it, mm.

    With the camera's attitude as it was found, R_A t_X + t_A = s seen + t_Y is linear in s and in both places.
    moved: A, poses (N, 4, 4) of what moves against what does not. seen_mm: the board's (N, 3), along the parent's axes.
    """
    ones = np.broadcast_to(np.eye(3), (len(moved), 3, 3))
    columns = np.concatenate([moved[:, :3, :3], -ones, -seen_mm[:, :, None]], axis=2).reshape(-1, 7)
    size, shifts = np.linalg.norm(columns, axis=0), -moved[:, :3, 3].ravel()
    found, _, rank, _ = np.linalg.lstsq(columns / size, shifts, rcond=_OPEN)
    left = (columns / size) @ found - shifts
    sigma = float("inf")
    if rank == len(size) < len(left):
        variance = float(left @ left) / (len(left) - len(size))
        sigma = float(np.sqrt(variance * np.linalg.inv(columns.T @ columns)[-1, -1]))
    return float(found[-1] / size[-1]), sigma, rms_length(left.reshape(-1, 3))


def misfit_mm(base_T_flange: Array, camera_T_board: Array, *, on_flange: bool, most: float = MOST) -> float:
    """Errors of place and attitude of most of M poses as one number, by which ways of reading the data compare."""
    return _as_one(*_start(base_T_flange, camera_T_board, on_flange, most)[1])


def least_misfit_mm(base_T_flange: Array, camera_T_board: Array, mounts: Sequence[str] = MOUNTS) -> float:
    """The same with the camera where it is less, of some of MOUNTS."""
    return min(misfit_mm(base_T_flange, camera_T_board, on_flange=mount == MOUNTS[0]) for mount in mounts)


def _as_one(off_mm: float, off_rad: float) -> float:
    return float(np.sqrt(off_mm * off_rad * _MM_PER_RADIAN))


def _transform(motion: Array) -> Array:
    return frames.make_transform(frames.rotation_from_rotvec(motion[:3]), motion[3:])


def _predicted(base_T_flange: Array, parent_T_camera: Array, parent_T_board: Array, on_flange: bool) -> Array:
    if on_flange:
        return frames.invert(base_T_flange @ parent_T_camera) @ parent_T_board
    return frames.invert(parent_T_camera) @ base_T_flange @ parent_T_board


def _errors(predicted: Array, measured: Array) -> tuple[Array, Array]:
    """Errors of places and attitudes (..., 3), mm and rad, predicted minus measured."""
    turns = predicted[..., :3, :3] @ np.swapaxes(measured[..., :3, :3], -1, -2)
    return predicted[..., :3, 3] - measured[..., :3, 3], frames.rotvec_from_rotation(turns)


def _sigmas(*errors: Array, most: float = MOST) -> Array:
    """Sigmas (2, ...) of an axis of errors (..., M, 3), mm and rad, by the share that most of them are."""
    from scipy.special import gammaincinv  # slow to load

    count = errors[0].shape[-2]
    most = max(most, min(1.0, _FEWEST_DECIDE / count))
    usual = np.sqrt(2.0 * gammaincinv(1.5, min(most, 1.0 - 0.5 / count)))  # of the length of three normal numbers
    middle = [np.quantile(np.linalg.norm(error, axis=-1), most, axis=-1) / usual for error in errors]
    return np.stack([np.maximum(middle[0], _LEAST_MM), np.maximum(middle[1], _LEAST_RAD)])


def _near(off: tuple[Array, Array], sigmas: Array) -> BoolArray:
    """(M,) whether errors of place and attitude are no farther off than noise of given sigmas."""
    far = [np.linalg.norm(error, axis=1) > FAR * sigma for error, sigma in zip(off, sigmas, strict=True)]
    return ~(far[0] | far[1])


def _start(base_T_flange: Array, camera_T_board: Array, on_flange: bool, most: float = MOST) -> tuple[Array, Array]:
    """Camera's and board's place (12,), rotation vectors and mm, that fit most poses, with these poses' sigmas."""
    seen = camera_T_board if on_flange else frames.invert(camera_T_board)
    rng = np.random.default_rng(0)
    count = len(seen)
    some = np.array([rng.choice(count, min(_OF, count), replace=False) for _ in range(_TRIES)])
    rows = [some, np.arange(count)[None]]
    found = [_closed_form(base_T_flange[part], seen[part]) for part in rows]
    there, here = (np.concatenate(each) for each in zip(*found, strict=True))
    camera, board = (there, here) if on_flange else (here, there)
    predicted = _predicted(base_T_flange, camera[:, None], board[:, None], on_flange)
    sigmas = _sigmas(*_errors(predicted, camera_T_board), most=most)
    best = int(np.argmin(sigmas[0] * sigmas[1]))
    each = (camera[best], board[best])
    unknown = [part for at in each for part in (frames.rotvec_from_rotation(at[:3, :3]), at[:3, 3])]
    return np.concatenate(unknown), sigmas[:, best]


def _closed_form(flange: Array, seen: Array) -> tuple[Array, Array]:
    """X and Y (K, 4, 4) of K sets of n poses (K, n, 4, 4) with A X S = Y: rotations first, then places."""
    sets = len(flange)
    turns, seen_turns = flange[..., :3, :3], seen[..., :3, :3]
    matrix = np.einsum("knij,knba->kiajb", turns, seen_turns).reshape(sets, 9, 9)
    either = np.linalg.svd(matrix)[2][:, 0].reshape(-1, 3, 3)  # X or its negative
    there = frames.nearest_rotation(either * np.sign(np.linalg.det(either))[:, None, None])
    here = frames.nearest_rotation(np.sum(turns @ there[:, None] @ seen_turns, axis=1))
    shifted = np.einsum("knij,kjl,knl->kni", turns, there, seen[..., :3, 3]) + flange[..., :3, 3]
    columns = np.concatenate([turns, np.broadcast_to(-np.eye(3), turns.shape)], axis=-1).reshape(sets, -1, 6)
    places = -np.linalg.pinv(columns, rcond=_OPEN) @ shifted.reshape(sets, -1, 1)
    return frames.make_transform(there, places[:, :3, 0]), frames.make_transform(here, places[:, 3:, 0])
