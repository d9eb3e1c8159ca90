"""Is it the arm or the camera? Probabilities that link errors, errors of lens and board, both or neither are at work.

About a fit of full poses, whitened errors y of the board's poses are linear in all that may be wrong:

    y = A x - G n - g s + F f + noise

with link errors x, the lens's error n (`ViewPose.by_lens`), the error s of the board's size (places grow by s), and
the unknown frames, board and tool f. The corners themselves tell of the lens too: with the poses of all views
eliminated they give n with information S, whatever the arm does. Each hypothesis leaves some of x, n and s at zero
and gives the others normal priors of a size that is averaged over; the likelihoods of all data, noise up to twice the
pixels' included, are compared at equal prior odds (MacKay 1992). A lens found from the same images is unknown under
every hypothesis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.effects.link_errors import LinkErrors
from calib.extras.camera.lens import FREE_NAMES, LENS_NAMES
from calib.extras.camera.observed import CameraViews, camera_of
from calib.extras.camera.view import ViewPose, lens_equations, pose_of_view
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals
from calib.fitting.scanner_frame import orthonormal

_OF_TOOL = 5  # link parameters of the tool's row, the last
HYPOTHESES = ("neither", "arm", "camera", "both")
_ARM_SHARES = np.geomspace(3e-3, 1.0, 9)  # of the tolerances of 1 mm and 0.5 deg
_SIDE_SHARES = np.geomspace(3e-3, 3.0, 9)  # of the sizes below
_NOISE = (1.0, 1.4, 2.0)  # over the pixels' own, as corners of one image may be off together
_SURELY = 0.9  # probability beyond doubt
_LIKELY, _SIGMAS = 0.75, 4.0  # probability of the camera's side, and sigmas of the board's size, that are so together
_BOARD_SHARE = 0.01  # of the board's size
_FEWEST, _MOVES = 5, 9  # poses before and after a move; of such moves that are tried
_LENS_SHARE = 0.01  # of the focal length, and of the image's width for the centre
_RADIAL, _TANGENTIAL = 0.05, 0.005


@dataclass(frozen=True)
class ArmOrCamera(Brief):
    """Probabilities of what is wrong, and the board's size over the declared one where the camera's side is free."""

    probabilities: Mapping[str, float]  # by HYPOTHESES, summing to 1
    board_size: float  # the true over the declared, with arm and camera's side free
    board_size_sigma: float

    @property
    def board_is_off(self) -> bool:
        """Whether the board's size is not the declared one, beyond doubt."""
        likely = self.probabilities["camera"] + self.probabilities["both"] > _LIKELY
        return likely and abs(self.board_size - 1.0) > _SIGMAS * self.board_size_sigma

    @property
    def camera_alone_errs(self) -> bool:
        """Whether lens or board err and the links do not, beyond doubt."""
        return self.probabilities["camera"] > _SURELY

    @property
    def likeliest(self) -> str:
        """The likeliest hypothesis."""
        return max(self.probabilities, key=lambda name: self.probabilities[name])


@lru_cache(maxsize=4)  # text, document and verdict of one fit ask for it in turn
def arm_or_camera(calibration: Calibration) -> ArmOrCamera | None:
    """Probabilities of arm, camera, both or neither; None where no images of a board were fitted as full poses.

    None too where links are held, or where that board or camera was moved on the way is likelier than all.
    """
    dataset, camera = calibration.fitted_dataset, camera_of(calibration.dataset)
    if camera is None or calibration.residual != "pose" or calibration.model.added_effects:
        return None
    if set(calibration.options.fixed) & set(calibration.model.robot.parameter_names[:-_OF_TOOL]):  # held by the user
        return None
    observed = Observations.of(dataset, ~dataset.poses.is_test & ~np.isin(dataset.poses.ids, calibration.outliers))
    observed = replace(observed, points=replace(observed.points.free_of(None), shared=None))
    points = observed.points
    views = [camera.of(dataset.poses.ids[pose]) for pose in points.pose]
    shown = [view for view in views if view is not None]
    if points.orientations is None or not points.orientations.known.all() or len(shown) < len(views):
        return None  # a point without corners, or the mean of several
    starts = frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)
    seen = [pose_of_view(camera.lens, view, start) for view, start in zip(shown, starts, strict=True)]
    return _compared(calibration, observed, camera, seen)


def _compared(
    calibration: Calibration, observed: Observations, camera: CameraViews, seen: Sequence[ViewPose]
) -> ArmOrCamera | None:
    """Probabilities of the hypotheses; None where that board or camera was moved on the way is likelier than all."""
    model, x = calibration.model, calibration.fit.x
    residuals = PoseResiduals(model, with_nominal_scanner_frames(observed, model.placed_robot))
    nuisance = residuals.nuisance(x)
    y = nuisance.by_parameters @ x - residuals.residual(x)
    links = next(effect for effect in model.effects if isinstance(effect, LinkErrors))
    scale_of = {p.name: p.scale for p in links.parameters}
    of_arm: BoolArray = np.array([p.name in scale_of and not p.name.endswith("TCP") for p in model.parameters])
    scales = np.array([scale_of.get(p.name, 1.0) for p in model.parameters])
    always = np.concatenate([nuisance.by_frames, nuisance.by_parameters[:, ~of_arm]], axis=1)
    basis = orthonormal(always / np.maximum(np.linalg.norm(always, axis=0), 1e-300))
    of_images, by_images, by_lens = _lens_by_images(camera, seen)

    def apart(columns: Array, rows: Array | None = None) -> Array:
        below = np.zeros((len(of_images), columns.shape[1])) if rows is None else rows
        return np.concatenate([columns - basis @ (basis.T @ columns), below])

    places_mm = np.stack([one.camera_T_board[:3, 3] for one in seen])
    by_size = np.concatenate([_BOARD_SHARE * places_mm, np.zeros_like(places_mm)], axis=1)[:, :, None]
    arm = apart((nuisance.by_parameters * scales)[:, of_arm])
    lens, size = apart(-residuals.whitened(by_lens), by_images), apart(-residuals.whitened(by_size))
    data, dof = apart(y[:, None], of_images[:, None])[:, 0], len(y) + len(of_images) - basis.shape[1]

    def evidence(arms: Array, cameras: Array, moves: Sequence[Array] = (np.zeros((len(data), 0)),)) -> float:
        each = [
            one
            for a, c, move in product(arms, cameras, moves)
            for one in _log_evidences(data, np.concatenate([columns(a, c), move], axis=1), dof)
        ]
        return float(np.logaddexp.reduce(each) - np.log(len(each)))

    def columns(a: float, c: float) -> Array:
        """Of all unknowns in standard deviations of their priors; the board's size is the last."""
        found_lens = 1.0 if camera.lens_from == "images" else c
        return np.concatenate([a * arm, found_lens * lens, c * size], axis=1)

    none = np.zeros(1)
    logs = {
        name: evidence(
            _ARM_SHARES if name in ("arm", "both") else none, _SIDE_SHARES if name in ("camera", "both") else none
        )
        for name in HYPOTHESES
    }
    moves = [apart(part) for part in _moves(always, len(seen))]
    if moves and evidence(_ARM_SHARES, none, moves) > max(logs.values()):
        return None
    whole = np.logaddexp.reduce(list(logs.values()))
    off, sigma = _last_coefficient(data, columns(1.0, 1.0), dof)
    probabilities = {name: float(np.exp(value - whole)) for name, value in logs.items()}
    return ArmOrCamera(probabilities, 1.0 + _BOARD_SHARE * off, _BOARD_SHARE * sigma)


def _moves(always: Array, count: int) -> list[Array]:
    """Columns of a second place of board and camera from some pose on, for several such poses of `count`."""
    rows = np.arange(len(always)) // (len(always) // count)
    steps = np.unique(np.linspace(_FEWEST, count - _FEWEST, _MOVES).astype(int))
    return [always * (rows >= step)[:, None] for step in steps if _FEWEST <= step <= count - _FEWEST]


def _log_evidences(data: Array, columns: Array, dof: int) -> list[float]:
    """Log likelihoods of the data (R,) for each noise, with standard normal coefficients of columns (R, K)."""
    ways, size, _ = np.linalg.svd(columns, full_matrices=False)
    seen, grown, out = (ways.T @ data) ** 2, size**2, []
    for noise in _NOISE:
        square = noise**2
        left = float(data @ data) / square - float(np.sum(seen * grown / (square * (square + grown))))
        out.append(float(-0.5 * (left + dof * np.log(square) + np.sum(np.log1p(grown / square)))))
    return out


def _last_coefficient(data: Array, columns: Array, dof: int) -> tuple[float, float]:
    """Posterior mean and standard deviation of the last coefficient, the board's size."""
    information = columns.T @ columns + np.eye(columns.shape[1])
    mean = np.linalg.solve(information, columns.T @ data)
    noise = max(1.0, float(np.sum((data - columns @ mean) ** 2)) / max(dof, 1))
    return float(mean[-1]), float(np.sqrt(noise * np.linalg.inv(information)[-1, -1]))


def _lens_by_images(camera: CameraViews, seen: Sequence[ViewPose]) -> tuple[Array, Array, Array]:
    """What corners tell of the lens whatever the arm does, data (K,) and columns (K, K), and its part in M poses.

    By the usual sizes of a lens's errors; the part (M, 6, K) is of shifts and turns, mm and rad.
    """
    free = [LENS_NAMES.index(name) for name in FREE_NAMES]
    fx, fy = camera.lens.numbers[:2]
    pixels = [_LENS_SHARE * px for px in (fx, fy, camera.lens.width_px, camera.lens.width_px)]
    scales = np.array([*pixels, *(_TANGENTIAL if name[0] == "p" else _RADIAL for name in FREE_NAMES[4:])])
    information, right = lens_equations(seen, free)
    weight = scales / camera.sigma_px
    size, ways = np.linalg.eigh(information * np.outer(weight, weight))
    root = np.sqrt(np.maximum(size, 0.0))
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 1e-9 * root.max())
    by_lens = np.stack([one.by_lens[:, free] for one in seen]) * scales
    return inverse * (ways.T @ (right * weight / camera.sigma_px)), root[:, None] * ways.T, by_lens
