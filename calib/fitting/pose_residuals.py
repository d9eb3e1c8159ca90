"""Residuals of full poses: the jig's position and, where it was measured, its orientation.

    predicted   p = R_s P(x) + t_s              position, mm
                Q = R_s B(x) K                  orientation scanner_R_jig
    residual    C^(-1/2) (p - p_m, log(Q Q_m^T))

with the predicted position P and orientation B = base_R_tool of the tool, the scanner's frame (R_s, t_s) of each setup,
and the jig's orientation on the tool K = tool_R_jig, its seat. C (6, 6) is the covariance of a measured pose: point and
orientation come from the same three planes, so their errors are correlated. Frames and seat are unknowns at every x:
they are solved for by a few Gauss-Newton steps from the closed form, and their columns are projected out of the
Jacobian (variable projection, Golub and Pereyra 1973, in Kaufman's form), so that the solver never sees them.

A constant turn behind the last joint is part of K: orientations alone do not determine alpha, theta, beta of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Dataset
from calib.effects.effect import Parameter
from calib.errors import FitError
from calib.fitting.model import Model
from calib.fitting.observations import Observations, linearise_poses, predict_poses
from calib.fitting.residual import Linearisation
from calib.fitting.scanner_frame import fit_scanner_frame, orthonormal

_STEPS = 50
_NO_ORIENTATION = (
    "found no orientation at a training pose; give qw, qx, qy, qz in points.csv, or find the corners with their "
    "orientation, or fit positions"
)
_MIN_SHARE_LABELLED = 0.5  # of the training poses: where fewer faces are labelled, robot or poses are wrong


def require_orientations(dataset: Dataset, observed: Observations) -> None:
    """Raise FitError where full poses cannot be fitted, with what would help.

    That is where no observed point has an orientation, or where the faces of scanned jigs could be labelled at less
    than half of them: labels that contradict the robot so often cannot be trusted elsewhere.
    """
    orientations, count = observed.points.orientations, len(observed.points)
    known = 0 if orientations is None else int(orientations.known.sum())
    if orientations is not None and orientations.labelled_by and known < max(2, _MIN_SHARE_LABELLED * count):
        raise FitError(
            f"dataset {dataset.name}: the jig's faces can be told apart at {known} of {count} training poses, and full "
            f"poses need half of them: {orientations.unlabelled_reason or 'measure more poses'}, or fit positions"
        )
    if known == 0:
        raise FitError(f"dataset {dataset.name}: {_NO_ORIENTATION}")


@dataclass(frozen=True)
class FramesAndSeat:
    """The unknowns of a pose's prediction beside the arm's."""

    scanner_T_base: Mapping[str, Array]  # by setup, (4, 4)
    tool_R_jig: Array  # (3, 3)


@dataclass(frozen=True)
class PoseResiduals(Brief):
    """Predicted minus measured poses; the frames of all setups and the jig's seat are solved for at every x."""

    model: Model
    observed: Observations

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.model.parameters

    @property
    def noise_floor(self) -> float:
        return self.observed.noise_floor

    @cached_property
    def _setups(self) -> list[IndexArray]:
        setup = self.observed.setup
        return [np.flatnonzero(setup == name) for name in np.unique(setup)]

    @cached_property
    def has_orientation(self) -> BoolArray:
        """(M,) which points have an orientation."""
        orientations = self.observed.points.orientations
        known = np.zeros(len(self.observed.points), dtype=bool)
        return known if orientations is None else orientations.known

    @cached_property
    def _measured(self) -> Array:
        """(M, 3, 3) scanner_R_jig; the identity where it is not known."""
        orientations = self.observed.points.orientations
        if orientations is None or not self.has_orientation.any():
            raise FitError(_NO_ORIENTATION)
        return np.where(self.has_orientation[:, None, None], orientations.scanner_R_jig, np.eye(3))

    @cached_property
    def _whiten(self) -> Array:
        """(M, 6, 6) W with W C W^T = 1; zero rows where there is no orientation."""
        observed = self.observed
        turns = observed.turn_covariance_rad2
        if turns is None:
            raise FitError(
                "the orientations have no covariance; give rxx_rad2 ... rzz_rad2 in points.csv, or "
                "orientation_sigma_deg under [scanner] in dataset.toml"
            )
        covariance = np.zeros((len(observed.points), 6, 6))
        covariance[:, :3, :3] = observed.covariance_mm2
        covariance[:, 3:, 3:] = np.where(self.has_orientation[:, None, None], turns, np.eye(3))
        orientations = observed.points.orientations
        if orientations is not None and orientations.cross_mm_rad is not None:
            cross = np.where(self.has_orientation[:, None, None], orientations.cross_mm_rad, 0.0)
            covariance[:, :3, 3:], covariance[:, 3:, :3] = cross, np.swapaxes(cross, 1, 2)
        try:
            whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        except np.linalg.LinAlgError:
            raise FitError(
                "the covariance of a measured pose is not positive definite; give each in mm^2, rad^2 and mm rad"
            ) from None
        whiten[~self.has_orientation, 3:] = 0.0
        return np.asarray(whiten)

    @cached_property
    def _rows(self) -> BoolArray:
        """(6 M,) the equations that exist: three a point, three more where its orientation is known."""
        return np.repeat(self.has_orientation, 6) | np.tile([True] * 3 + [False] * 3, len(self.has_orientation))

    @cached_property
    def degrees_spent(self) -> int:
        """The rank of the frames' and the seat's columns."""
        base_mm, attitude = predict_poses(self.model, np.zeros(len(self.parameters)), self.observed)
        return self._basis(*self._solve_frames_and_seat(base_mm, attitude)[1:]).shape[1]

    def frames_and_seat(self, x: Array) -> FramesAndSeat:
        """The best scanner frames and the jig's seat at x (P,)."""
        return self._solve_frames_and_seat(*predict_poses(self.model, x, self.observed))[0]

    def residual(self, x: Array) -> Array:
        _, error, _ = self._solve_frames_and_seat(*predict_poses(self.model, x, self.observed))
        return np.einsum("mij,mj->mi", self._whiten, error).ravel()[self._rows]

    def linearise(self, x: Array) -> Linearisation:
        base_mm, attitude, by_x = linearise_poses(self.model, x, self.observed)
        placed, error, columns = self._solve_frames_and_seat(base_mm, attitude)
        turn = self._scanner_R_base(placed)
        by_x = np.concatenate([turn @ by_x[:, :3], _by_left_turn(error[:, 3:]) @ turn @ by_x[:, 3:]], axis=1)
        jacobian = (self._whiten @ by_x).reshape(6 * len(error), -1)[self._rows]
        basis = self._basis(error, columns)
        residual = np.einsum("mij,mj->mi", self._whiten, error).ravel()[self._rows]
        return Linearisation(residual, jacobian - basis @ (basis.T @ jacobian))

    def frame_directions(self, x: Array) -> Array:
        """Orthonormal basis (R, `degrees_spent`) of the changes of the residual by motions of frames and seat."""
        _, error, columns = self._solve_frames_and_seat(*predict_poses(self.model, x, self.observed))
        return self._basis(error, columns)

    def errors(self, placed: FramesAndSeat, base_mm: Array, attitude: Array) -> Array:
        """(M, 6) predicted minus measured: mm, and the rotation vector in rad (meaningless without orientation)."""
        at_mm = np.empty_like(base_mm)
        for rows in self._setups:
            scanner_T_base = placed.scanner_T_base[str(self.observed.setup[rows[0]])]
            at_mm[rows] = frames.apply(scanner_T_base, base_mm[rows])
        jig = self._scanner_R_base(placed) @ attitude @ placed.tool_R_jig
        turn = frames.rotvec_from_rotation(jig @ np.swapaxes(self._measured, 1, 2))
        return np.concatenate([at_mm - self.observed.points.xyz_mm, turn], axis=1)

    def _scanner_R_base(self, placed: FramesAndSeat) -> Array:
        """(M, 3, 3)"""
        out = np.empty((len(self.observed.points), 3, 3))
        for rows in self._setups:
            out[rows] = placed.scanner_T_base[str(self.observed.setup[rows[0]])][:3, :3]
        return out

    def _basis(self, error: Array, columns: Array) -> Array:
        """Orthonormal basis (R, rank) of the changes of the residual by motions of frames and seat."""
        return orthonormal((self._whiten @ columns).reshape(6 * len(error), -1)[self._rows])

    def _solve_frames_and_seat(self, base_mm: Array, attitude: Array) -> tuple[FramesAndSeat, Array, Array]:
        """The best frames and seat for these predictions, the errors (M, 6) left, and the columns (M, 6, 6 S + 3).

        base_mm  # (M, 3); attitude  # (M, 3, 3)
        """
        placed = self._first_guess(base_mm, attitude)
        for _ in range(_STEPS):
            error = self.errors(placed, base_mm, attitude)
            columns = self._nuisance_columns(placed, error, attitude)
            whitened = (self._whiten @ columns).reshape(6 * len(error), -1)[self._rows]
            scale = np.maximum(np.linalg.norm(whitened, axis=0), 1e-300)
            right = np.einsum("mij,mj->mi", self._whiten, error).ravel()[self._rows]
            motion = -np.linalg.lstsq(whitened / scale, right, rcond=1e-9)[0] / scale
            if np.max(np.abs(motion * scale)) < 1e-9 * (1.0 + float(np.linalg.norm(right))):
                break
            placed = self._moved(placed, motion, error)
        return placed, error, columns

    def _first_guess(self, base_mm: Array, attitude: Array) -> FramesAndSeat:
        """Frames from the positions alone, then the seat as the mean over the measured orientations."""
        placed = {}
        for rows in self._setups:
            placed[str(self.observed.setup[rows[0]])] = fit_scanner_frame(
                base_mm[rows], self.observed.points.xyz_mm[rows], self.observed.covariance_mm2[rows]
            )
        predicted = self._scanner_R_base(FramesAndSeat(placed, np.eye(3))) @ attitude
        seats = (np.swapaxes(predicted, 1, 2) @ self._measured)[self.has_orientation]
        return FramesAndSeat(placed, frames.mean_rotation(seats))

    def _nuisance_columns(self, placed: FramesAndSeat, error: Array, attitude: Array) -> Array:
        """(M, 6, 6 S + 3): of each of S setups a shift and a turn about its points' centre; then the seat's turn."""
        out = np.zeros((len(error), 6, 6 * len(self._setups) + 3))
        by_turn = _by_left_turn(error[:, 3:])
        at_mm = error[:, :3] + self.observed.points.xyz_mm
        for k, rows in enumerate(self._setups):
            arm = at_mm[rows] - at_mm[rows].mean(axis=0)
            out[rows, :3, 6 * k : 6 * k + 3] = np.eye(3)
            out[rows, :3, 6 * k + 3 : 6 * k + 6] = -frames.skew(arm)
            out[rows, 3:, 6 * k + 3 : 6 * k + 6] = by_turn[rows]
        out[:, 3:, -3:] = by_turn @ self._scanner_R_base(placed) @ attitude
        return out

    def _moved(self, placed: FramesAndSeat, motion: Array, error: Array) -> FramesAndSeat:
        moved = {}
        at_mm = error[:, :3] + self.observed.points.xyz_mm
        for k, rows in enumerate(self._setups):
            name = str(self.observed.setup[rows[0]])
            shift, turn = (
                motion[6 * k : 6 * k + 3],
                frames.rotation_from_rotvec(motion[6 * k + 3 : 6 * k + 6]),
            )
            centre = at_mm[rows].mean(axis=0)
            about_centre = frames.make_transform(turn, centre - turn @ centre + shift)
            moved[name] = about_centre @ placed.scanner_T_base[name]
        return FramesAndSeat(moved, frames.rotation_from_rotvec(motion[-3:]) @ placed.tool_R_jig)


def _by_left_turn(error: Array) -> Array:
    """(M, 3, 3) derivative of a rotation vector (M, 3) by a small turn from the left: SO(3)'s inverse left Jacobian.

    1 - [e] / 2 + c [e]^2 with c = (1 - (t / 2) cot(t / 2)) / t^2, t = |e|; c is 1/12 at 0.
    """
    angle = np.linalg.norm(error, axis=1)
    safe = np.where(angle > 1e-4, angle, 1.0)
    c = np.where(angle > 1e-4, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2, 1.0 / 12.0)
    cross = frames.skew(error)
    return np.asarray(np.eye(3) - 0.5 * cross + c[:, None, None] * (cross @ cross))
