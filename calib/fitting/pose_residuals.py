"""Residuals of full poses: the jig's position and, where it was measured, its orientation.

    predicted   p = R_s P(x) + t_s              position, mm
                Q = R_s B(x) K                  orientation scanner_R_jig
    residual    C^(-1/2) (p - p_m, log(Q Q_m^T))

with the predicted position P and orientation B = base_R_tool of the tool, the scanner's frame (R_s, t_s) of each setup,
and the hand-eye rotation K = tool_R_jig, the jig's orientation on the tool. C (6, 6) is the covariance of a measured
pose: point and orientation come from the same three planes, so their errors are correlated. Frames and hand-eye
rotation are unknowns at every x: they are solved for by a few Gauss-Newton steps from the closed form, and their
columns are projected out of the Jacobian (variable projection, Golub and Pereyra 1973, in Kaufman's form), so that the
solver never sees them.

Errors that all points share, such as those of a camera's lens, are unknowns n with a standard normal prior that move
the poses by S n (`Points.shared`). Eliminated, they make the covariance of the whitened rows 1 + A A^T with A =
C^(-1/2) S, and rows are multiplied by its inverse root 1 + U ((1 + s^2)^(-1/2) - 1) U^T, with A = U s V^T.

A constant turn behind the last joint is part of K: orientations alone do not determine alpha, theta, beta of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset, Points
from calib.errors import FitError
from calib.fitting.observations import Observations, linearise_poses, predict_poses
from calib.fitting.observed_residuals import ObservedResiduals
from calib.fitting.residual import Linearisation
from calib.fitting.scanner_frame import fit_scanner_frame, orthonormal

_OPEN = 1e-9  # share of the largest singular value, below which the poses leave a motion open
_LEAST_BEND = 1e-3  # of the curvature by Gauss-Newton: bounds the steps, more where one leads uphill
_STEPS = 50
_NO_ORIENTATION = (
    "found no orientation at a training pose; give qw, qx, qy, qz in points.csv, or find the corners with their "
    "orientation, or fit positions"
)
_MIN_SHARE_LABELLED = 0.5  # of the training poses: where fewer faces are labelled, robot or poses are wrong


def require_orientations(dataset: Dataset, observed: Observations) -> None:
    """Raise FitError, with a remedy, where full poses cannot be fitted.

    Either no observed point has an orientation, or the faces of scanned jigs could be labelled at less than half of the
    points: labels that contradict the robot so often cannot be trusted elsewhere.
    """
    orientations, count = observed.points.orientations, len(observed.points)
    known = 0 if orientations is None else int(orientations.known.sum())
    if orientations is not None and orientations.labelling is not None and known < max(2, _MIN_SHARE_LABELLED * count):
        raise FitError(
            f"dataset {dataset.name}: the jig's faces can be told apart at {known} of {count} training poses, and full "
            f"poses need half of them: {orientations.unlabelled_reason or 'measure more poses'}, or fit positions"
        )
    if known == 0:
        raise FitError(f"dataset {dataset.name}: {_NO_ORIENTATION}")


@dataclass(frozen=True)
class FramesAndHandEye:
    """Unknowns of predicted poses beyond the arm's parameters: scanner frames and hand-eye rotation."""

    scanner_T_base: Mapping[str, Array]  # by setup, (4, 4)
    tool_R_jig: Array  # (3, 3)


@dataclass(frozen=True)
class Nuisance:
    """Unknowns of predicted poses beyond the arm's parameters at a fit, and whitened derivatives of the residual."""

    placed: FramesAndHandEye
    error: Array  # (M, 6) of the poses, see `PoseResiduals.errors`
    centre_mm: Mapping[str, Array]  # (3,) by setup, about which its frame turns, scanner frame
    by_parameters: Array  # (R, P), frames and hand-eye rotation at rest
    by_frames: Array  # (R, 6 S + 3) by shift, mm, and turn, rad, of each setup's frame in turn, and the hand-eye turn
    base_mm: Array  # (M, 3) predicted points, see `predict_poses`
    attitude: Array  # (M, 3, 3)


@dataclass(frozen=True)
class PoseResiduals(ObservedResiduals):
    """Residuals of jig poses, predicted minus measured, whitened; frames and hand-eye rotation are eliminated."""

    def _measured(self, points: Points) -> Array:
        """Orientations scanner_R_jig (M, 3, 3) of the points; the identity where one is not known."""
        if points.orientations is None or not self.has_orientation.any():
            raise FitError(_NO_ORIENTATION)
        return np.where(self.has_orientation[:, None, None], points.orientations.scanner_R_jig, np.eye(3))

    @cached_property
    def has_orientation(self) -> BoolArray:
        """Mask (M,) of the points that have an orientation."""
        orientations = self.observed.points.orientations
        known = np.zeros(len(self.observed.points), dtype=bool)
        return known if orientations is None else orientations.known

    @cached_property
    def _as_measured(self) -> Points:
        """The points with the errors that all share: what the fit finds of them has its prior about zero."""
        return self.observed.points.free_of(None)

    @cached_property
    def _whiten(self) -> Array:
        """Whitening matrices W (M, 6, 6) with W C W^T = 1; zero rows where there is no orientation."""
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
        """Mask (6 M,) of the equations that exist: three per point, three more where its orientation is known."""
        return np.repeat(self.has_orientation, 6) | np.tile([True] * 3 + [False] * 3, len(self.has_orientation))

    @cached_property
    def degrees_spent(self) -> int:
        """Number of eliminated unknowns: the rank of the columns of frames and hand-eye rotation."""
        base_mm, attitude = predict_poses(self.model, np.zeros(len(self.parameters)), self.observed)
        return self._basis(self._solve_frames_and_hand_eye(base_mm, attitude)[2]).shape[1]

    def frames_and_hand_eye(self, x: Array) -> FramesAndHandEye:
        """Best scanner frames and hand-eye rotation at x (P,)."""
        return self._solve_frames_and_hand_eye(*predict_poses(self.model, x, self.observed))[0]

    def shared_errors(self, x: Array) -> Array | None:
        """Most likely errors (K,), each in its sigmas, that all points share, at x (P,); None where they share none."""
        if self._shared is None:
            return None
        assert self.observed.points.shared is not None
        _, error, _ = self._solve_frames_and_hand_eye(*predict_poses(self.model, x, self.observed))
        columns = (self._whiten @ self.observed.points.shared).reshape(len(self._rows), -1)[self._rows]
        whitened = np.einsum("mij,mj->mi", self._whiten, error).ravel()[self._rows]
        return np.linalg.solve(np.eye(columns.shape[1]) + columns.T @ columns, -columns.T @ whitened)

    def residual(self, x: Array) -> Array:
        _, error, _ = self._solve_frames_and_hand_eye(*predict_poses(self.model, x, self.observed))
        return self.whitened(error[:, :, None])[:, 0]

    def linearise(self, x: Array) -> Linearisation:
        at = self.nuisance(x)
        basis = orthonormal(at.by_frames)
        residual = self.whitened(at.error[:, :, None])[:, 0]
        return Linearisation(residual, at.by_parameters - basis @ (basis.T @ at.by_parameters))

    def nuisance(self, x: Array) -> Nuisance:
        """Frames and hand-eye rotation at x (P,), with whitened derivatives by parameters and by all of these."""
        base_mm, attitude, by_x = linearise_poses(self.model, x, self.observed)
        placed, error, columns = self._solve_frames_and_hand_eye(base_mm, attitude)
        turn = self._scanner_R_base(placed)
        by_x = np.concatenate([turn @ by_x[:, :3], _by_left_turn(error[:, 3:]) @ turn @ by_x[:, 3:]], axis=1)
        at_mm = error[:, :3] + self._as_measured.xyz_mm
        centres = {str(self.observed.setup[rows[0]]): at_mm[rows].mean(axis=0) for rows in self._setup_rows}
        return Nuisance(placed, error, centres, self.whitened(by_x), self.whitened(columns), base_mm, attitude)

    def frame_directions(self, x: Array) -> Array:
        """Orthonormal basis (R, `degrees_spent`) of the residual's changes by frames and hand-eye rotation."""
        return self._basis(self._solve_frames_and_hand_eye(*predict_poses(self.model, x, self.observed))[2])

    def errors(self, placed: FramesAndHandEye, base_mm: Array, attitude: Array) -> Array:
        """Errors (M, 6), predicted minus measured: mm, and rotation vector in rad (meaningless without orientation).

        The points are free of those shared errors that an earlier fit found.
        """
        return self._errors(placed, base_mm, attitude, self.observed.points)

    def _errors(self, placed: FramesAndHandEye, base_mm: Array, attitude: Array, points: Points) -> Array:
        """Errors (M, 6) as `errors` has them, against given points."""
        at_mm = np.empty_like(base_mm)
        for rows in self._setup_rows:
            scanner_T_base = placed.scanner_T_base[str(self.observed.setup[rows[0]])]
            at_mm[rows] = frames.apply(scanner_T_base, base_mm[rows])
        jig = self._scanner_R_base(placed) @ attitude @ placed.tool_R_jig
        turn = frames.rotvec_from_rotation(jig @ np.swapaxes(self._measured(points), 1, 2))
        return np.concatenate([at_mm - points.xyz_mm, turn], axis=1)

    def _scanner_R_base(self, placed: FramesAndHandEye) -> Array:
        """Rotation scanner_R_base (M, 3, 3) of each point's setup."""
        out = np.empty((len(self.observed.points), 3, 3))
        for rows in self._setup_rows:
            out[rows] = placed.scanner_T_base[str(self.observed.setup[rows[0]])][:3, :3]
        return out

    def _basis(self, columns: Array) -> Array:
        """Orthonormal basis (R, rank) of the residual's changes by frames and hand-eye rotation, from their columns."""
        return orthonormal(self.whitened(columns))

    def whitened(self, columns: Array) -> Array:
        """Whitened rows (R, K) of changes (M, 6, K), mm and rad, of predicted poses."""
        rows = (self._whiten @ columns).reshape(6 * len(columns), -1)[self._rows]
        if self._shared is None:
            return rows
        ways, size = self._shared
        return rows + ways @ ((1.0 / np.sqrt(1.0 + size**2) - 1.0)[:, None] * (ways.T @ rows))

    @cached_property
    def _shared(self) -> tuple[Array, Array] | None:
        """Orthonormal directions (R, K) of the shared errors among the whitened rows, and their sizes (K,)."""
        shared = self.observed.points.shared
        if shared is None or not shared.shape[2]:
            return None
        ways, size, _ = np.linalg.svd((self._whiten @ shared).reshape(6 * len(shared), -1)[self._rows], False)
        return ways, size

    def _solve_frames_and_hand_eye(self, base_mm: Array, attitude: Array) -> tuple[FramesAndHandEye, Array, Array]:
        """Best frames and hand-eye rotation for predicted poses, errors (M, 6), and derivatives.

        base_mm  # (M, 3); attitude  # (M, 3, 3)
        """
        placed, least = self._first_guess(base_mm, attitude), _LEAST_BEND
        error = self._errors(placed, base_mm, attitude, self._as_measured)
        right = self.whitened(error[:, :, None])[:, 0]
        for _ in range(_STEPS):
            columns = self._nuisance_columns(placed, error, attitude)
            whitened = self.whitened(columns)
            scale = np.maximum(np.linalg.norm(whitened, axis=0), 1e-300)
            curvature = self._curvature(placed, error, attitude, right) / np.outer(scale, scale)
            ways, bend, along = _bends(whitened / scale, right, curvature)
            while True:
                motion = -ways @ (along / np.maximum(np.abs(bend), least))
                if np.max(np.abs(motion), initial=0.0) < 1e-9 * (1.0 + float(np.linalg.norm(right))):
                    return placed, error, columns
                there = self.moved(placed, motion / scale, error)
                error_there = self._errors(there, base_mm, attitude, self._as_measured)
                right_there = self.whitened(error_there[:, :, None])[:, 0]
                if least >= 1.0 or np.linalg.norm(right_there) <= np.linalg.norm(right):
                    break
                least = min(10.0 * least, 1.0)
            placed, error, right = there, error_there, right_there
            least = max(0.1 * least, _LEAST_BEND)
        return placed, error, columns

    def _curvature(self, placed: FramesAndHandEye, error: Array, attitude: Array, residual: Array) -> Array:
        """Second derivatives (6 S + 3, 6 S + 3) of half the squared residual by all turns, beyond J^T J.

        A turn w moves a point p about its centre by w x p + w x (w x p) / 2, so that a gradient g of the point adds
        sym(g p^T) - (g . p) 1. The frame's and the hand-eye's turns of an orientation, one after the other, add half of
        their cross product.
        """
        out = np.zeros((6 * len(self._setup_rows) + 3, 6 * len(self._setup_rows) + 3))
        if self._shared is not None:
            ways, size = self._shared
            residual = residual + ways @ ((1.0 / np.sqrt(1.0 + size**2) - 1.0) * (ways.T @ residual))
        every = np.zeros(len(self._rows))
        every[self._rows] = residual
        gradient = (every.reshape(-1, 1, 6) @ self._whiten)[:, 0]
        bend, slope = _turn_curvature(error[:, 3:], gradient[:, 3:])
        crossed = bend - 0.5 * frames.skew(slope)
        by_hand_eye = self._scanner_R_base(placed) @ attitude
        out[-3:, -3:] = np.sum(np.swapaxes(by_hand_eye, 1, 2) @ bend @ by_hand_eye, axis=0)
        crossed = crossed @ by_hand_eye
        at_mm = error[:, :3] + self._as_measured.xyz_mm
        for k, rows in enumerate(self._setup_rows):
            both = gradient[rows, :3].T @ (at_mm[rows] - at_mm[rows].mean(axis=0))
            turns = slice(6 * k + 3, 6 * k + 6)
            out[turns, turns] = 0.5 * (both + both.T) - np.trace(both) * np.eye(3) + bend[rows].sum(axis=0)
            out[turns, -3:] = crossed[rows].sum(axis=0)
            out[-3:, turns] = out[turns, -3:].T
        return out

    def _first_guess(self, base_mm: Array, attitude: Array) -> FramesAndHandEye:
        """Start values: frames from the positions alone, then the mean hand-eye rotation over the orientations."""
        placed = {}
        for rows in self._setup_rows:
            placed[str(self.observed.setup[rows[0]])] = fit_scanner_frame(
                base_mm[rows], self._as_measured.xyz_mm[rows], self.observed.covariance_mm2[rows]
            )
        predicted = self._scanner_R_base(FramesAndHandEye(placed, np.eye(3))) @ attitude
        estimates = (np.swapaxes(predicted, 1, 2) @ self._measured(self._as_measured))[self.has_orientation]
        return FramesAndHandEye(placed, frames.mean_rotation(estimates))

    def _nuisance_columns(self, placed: FramesAndHandEye, error: Array, attitude: Array) -> Array:
        """Derivative (M, 6, 6 S + 3) of the errors by shift and turn of S frames, and by the hand-eye turn."""
        out = np.zeros((len(error), 6, 6 * len(self._setup_rows) + 3))
        by_turn = _by_left_turn(error[:, 3:])
        at_mm = error[:, :3] + self._as_measured.xyz_mm
        for k, rows in enumerate(self._setup_rows):
            out[rows, :3, 6 * k : 6 * k + 6] = frames.frame_motion(at_mm[rows], at_mm[rows].mean(axis=0))
            out[rows, 3:, 6 * k + 3 : 6 * k + 6] = by_turn[rows]
        out[:, 3:, -3:] = by_turn @ self._scanner_R_base(placed) @ attitude
        return out

    def moved(self, placed: FramesAndHandEye, motion: Array, error: Array) -> FramesAndHandEye:
        """Frames and hand-eye rotation after a motion (6 S + 3,), in the order of `Nuisance.by_frames`."""
        moved = {}
        at_mm = error[:, :3] + self._as_measured.xyz_mm
        for k, rows in enumerate(self._setup_rows):
            name = str(self.observed.setup[rows[0]])
            shift, turn = (motion[6 * k : 6 * k + 3], frames.rotation_from_rotvec(motion[6 * k + 3 : 6 * k + 6]))
            centre = at_mm[rows].mean(axis=0)
            about_centre = frames.make_transform(turn, centre - turn @ centre + shift)
            moved[name] = about_centre @ placed.scanner_T_base[name]
        return FramesAndHandEye(moved, frames.rotation_from_rotvec(motion[-3:]) @ placed.tool_R_jig)


def _turn_curvature(error: Array, gradient: Array) -> tuple[Array, Array]:
    """Second derivatives (M, 3, 3), by a left turn, of costs with gradients (M, 3) by rotation vectors (M, 3); slopes.

    With e the vector, g the gradient and J = `_by_left_turn`, the slope is J^T g = g + e x g / 2 + c e x (e x g), and
    its derivative by e, times J, made symmetric, stands beside J^T J.
    """
    by_turn, (c, rise) = _by_left_turn(error), _turn_factors(error)
    along = np.sum(error * gradient, axis=1)
    twice = error * along[:, None] - gradient * np.sum(error**2, axis=1)[:, None]  # e x (e x g)
    outer = error[:, :, None] * gradient[:, None, :]
    by_error = along[:, None, None] * np.eye(3) + outer - 2.0 * np.swapaxes(outer, 1, 2)
    by_error = c[:, None, None] * by_error + rise[:, None, None] * twice[:, :, None] * error[:, None, :]
    second = (by_error - 0.5 * frames.skew(gradient)) @ by_turn
    slope = gradient + 0.5 * np.cross(error, gradient) + c[:, None] * twice
    return 0.5 * (second + np.swapaxes(second, 1, 2)), slope


def _turn_factors(error: Array) -> tuple[Array, Array]:
    """Factors c and (dc/dt) / t, (M,) each, of `_by_left_turn` for rotation vectors (M, 3) of angle t."""
    angle = np.linalg.norm(error, axis=1)
    safe = np.where(angle > 1e-3, angle, 1.0)
    half = 0.5 * safe
    c = np.where(angle > 1e-3, (1.0 - half / np.tan(half)) / safe**2, 1.0 / 12.0)
    rise = 0.5 * (half / np.sin(half) ** 2 - 1.0 / np.tan(half)) / safe**3 - 2.0 * c / safe**2
    return c, np.where(angle > 0.02, rise, 1.0 / 360.0)


def _bends(columns: Array, right: Array, curvature: Array) -> tuple[Array, Array, Array]:
    """Directions (K, L) of least squares in which the cost bends alone, its bends (L,), and its slopes (L,) in these.

    The residual is (R,), its columns (R, K), and (K, K) the second derivatives beside J^T J: with large residuals steps
    by J^T J alone converge slowly. A bend is 1 where nothing stands beside it. Directions that the columns leave open
    are left out.
    """
    u, size, v = np.linalg.svd(columns, full_matrices=False)
    known = size > _OPEN * size[0]
    ways = v[known].T / size[known]
    bend, turned = np.linalg.eigh(np.eye(int(known.sum())) + ways.T @ curvature @ ways)
    return ways @ turned, bend, turned.T @ (u[:, known].T @ right)


def _by_left_turn(error: Array) -> Array:
    """Derivative (M, 3, 3) of a rotation vector (M, 3) by a small turn from the left (inverse left Jacobian of SO(3)).

    1 - [e] / 2 + c [e]^2 with c = (1 - (t / 2) cot(t / 2)) / t^2, t = |e|; c is 1/12 at 0.
    """
    c, _ = _turn_factors(error)
    cross = frames.skew(error)
    return np.eye(3) - 0.5 * cross + c[:, None, None] * (cross @ cross)
