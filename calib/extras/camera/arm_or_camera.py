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

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Points
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
_CAMERA_SHARES = np.geomspace(3e-3, 3.0, 9)  # of the sizes below
_NOISE = (1.0, 1.4, 2.0)  # over the pixels' own, as corners of one image may be off together
_SURELY = 0.9  # probability beyond doubt
_LIKELY, _SIGMAS = 0.75, 4.0  # probability of the camera's side, and sigmas of the board's size, that are so together
_BOARD_SHARE = 0.01  # of the board's size
_FEWEST, _MOVES = 5, 9  # poses before and after a move; of such moves that are tried
_FOCAL_SHARE, _CENTRE_SHARE = 0.01, 0.01  # of the focal length; of the image's width
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
    """Probabilities of arm, camera, both or neither; None where no images of a board were fitted as full poses."""
    dataset, points = calibration.dataset, calibration.fitted_dataset.points
    camera = camera_of(dataset)
    if camera is None or calibration.residual != "pose" or points is None or calibration.model.added_effects:
        return None
    if set(calibration.options.fixed) & set(calibration.model.robot.parameter_names[:-_OF_TOOL]):  # held by the user
        return None
    poses = calibration.fitted_dataset.poses
    kept = ~poses.is_test & ~np.isin(poses.ids, calibration.outliers)
    observed = Observations.of(calibration.fitted_dataset, kept)
    observed = replace(observed, points=replace(observed.points.free_of(None), shared=None))
    seen = observed.points
    side = _side_of_views(camera, calibration, seen)
    return None if side is None else _compared(calibration, observed, side)


@dataclass(frozen=True)
class _CameraSide:
    """What may be wrong of lens and board: changes of M measured poses by their usual errors, and what images tell."""

    by_lens: Array  # (M, 6, L) mm and rad
    by_size: Array  # (M, 6, 1)
    of_images: Array  # (K,) data on the lens whatever the arm does
    image_rows: Array  # (K, L) their changes by the lens
    lens_is_unknown: bool  # found from the same images


def _side_of_views(views: CameraViews, calibration: Calibration, points: Points) -> _CameraSide | None:
    """Camera's side of images; None where a fitted point has no corners, or is a mean of several."""
    seen = _seen(views, calibration, points)
    if seen is None:
        return None
    free = [LENS_NAMES.index(name) for name in FREE_NAMES]
    scales = _lens_scales(views)[free]
    by_lens = np.stack([one.by_lens[:, free] for one in seen]) * scales
    places_mm = np.stack([one.camera_T_board[:3, 3] for one in seen])
    by_size = np.concatenate([_BOARD_SHARE * places_mm, np.zeros_like(places_mm)], axis=1)[:, :, None]
    return _CameraSide(by_lens, by_size, *_lens_by_images(views, seen, free, scales), views.lens_from == "images")


def _seen(views: CameraViews, calibration: Calibration, points: Points) -> list[ViewPose] | None:
    """View of each fitted point, with the board's pose; None where one has no corners, or is a mean of several."""
    if points.orientations is None or not points.orientations.known.all():
        return None
    found = []
    starts = frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)
    for pose, start in zip(points.pose, starts, strict=True):
        view = views.of(calibration.fitted_dataset.poses.ids[pose])
        if view is None:
            return None
        found.append(pose_of_view(views.lens, view, start))
    return found


def _compared(calibration: Calibration, observed: Observations, side: _CameraSide) -> ArmOrCamera | None:
    """Probabilities of the hypotheses; None where that board or camera was moved on the way is likelier than all."""
    model, x = calibration.model, calibration.fit.x
    residuals = PoseResiduals(model, with_nominal_scanner_frames(observed, model.placed_robot))
    nuisance = residuals.nuisance(x)
    y = nuisance.by_parameters @ x - residuals.residual(x)
    links = next(effect for effect in model.effects if isinstance(effect, LinkErrors))
    scale_of = {p.name: p.scale for p in links.parameters}
    of_arm: BoolArray = np.array([p.name in scale_of and not p.name.endswith("TCP") for p in model.parameters])
    scales = np.array([scale_of.get(p.name, 1.0) for p in model.parameters])
    arm = (nuisance.by_parameters * scales)[:, of_arm]
    always = np.concatenate([nuisance.by_frames, nuisance.by_parameters[:, ~of_arm]], axis=1)
    size = np.maximum(np.linalg.norm(always, axis=0), 1e-300)
    basis = orthonormal(always / size)

    def apart(columns: Array) -> Array:
        return columns - basis @ (basis.T @ columns)

    count = len(side.of_images)
    data = np.concatenate([apart(y[:, None])[:, 0], side.of_images])
    padded = {
        "arm": np.concatenate([apart(arm), np.zeros((count, arm.shape[1]))]),
        "lens": np.concatenate([apart(-residuals.whitened(side.by_lens)), side.image_rows]),
        "size": np.concatenate([apart(-residuals.whitened(side.by_size)), np.zeros((count, 1))]),
    }
    dof = len(data) - basis.shape[1]
    logs = {}
    for name in HYPOTHESES:
        arms = _ARM_SHARES if name in ("arm", "both") else (0.0,)
        cameras = _CAMERA_SHARES if name in ("camera", "both") else (0.0,)
        each = [
            one
            for a in arms
            for c in cameras
            for one in _log_evidences(data, _columns(padded, a, c, side.lens_is_unknown), dof)
        ]
        logs[name] = float(np.logaddexp.reduce(each) - np.log(len(each)))
    moved = [np.concatenate([apart(part), np.zeros((count, part.shape[1]))]) for part in _moves(always, observed)]
    each = [
        one
        for a in _ARM_SHARES
        for part in moved
        for one in _log_evidences(data, np.concatenate([a * padded["arm"], part], axis=1), dof)
    ]
    if each and float(np.logaddexp.reduce(each) - np.log(len(each))) > max(logs.values()):
        return None
    whole = np.logaddexp.reduce(list(logs.values()))
    probabilities = {name: float(np.exp(value - whole)) for name, value in logs.items()}
    size_value, size_sigma = _board_size(data, _columns(padded, 1.0, 1.0, side.lens_is_unknown), dof)
    return ArmOrCamera(probabilities, 1.0 + _BOARD_SHARE * size_value, _BOARD_SHARE * size_sigma)


def _moves(always: Array, observed: Observations) -> list[Array]:
    """Columns of a second place of board and camera from some pose on, for several such poses."""
    rows = np.arange(len(always)) // (len(always) // len(observed.points))
    steps = np.unique(np.linspace(_FEWEST, len(observed.points) - _FEWEST, _MOVES).astype(int))
    return [always * (rows >= step)[:, None] for step in steps if _FEWEST <= step <= len(observed.points) - _FEWEST]


def _columns(padded: Mapping[str, Array], arm: float, camera: float, lens_is_unknown: bool) -> Array:
    """Columns of all unknowns for given sizes, in standard deviations of their priors; the board's size is the last."""
    lens = 1.0 if lens_is_unknown else camera
    return np.concatenate([arm * padded["arm"], lens * padded["lens"], camera * padded["size"]], axis=1)


def _log_evidences(data: Array, columns: Array, dof: int) -> list[float]:
    """Log likelihoods of the data (R,) for each noise, with standard normal coefficients of columns (R, K)."""
    ways, size, _ = np.linalg.svd(columns, full_matrices=False)
    seen, grown, out = (ways.T @ data) ** 2, size**2, []
    for noise in _NOISE:
        square = noise**2
        left = float(data @ data) / square - float(np.sum(seen * grown / (square * (square + grown))))
        out.append(float(-0.5 * (left + dof * np.log(square) + np.sum(np.log1p(grown / square)))))
    return out


def _board_size(data: Array, columns: Array, dof: int) -> tuple[float, float]:
    """Posterior mean and standard deviation of the last coefficient."""
    information = columns.T @ columns + np.eye(columns.shape[1])
    mean = np.linalg.solve(information, columns.T @ data)
    left = data - columns @ mean
    noise = max(1.0, float(left @ left) / max(dof, 1))
    return float(mean[-1]), float(np.sqrt(noise * np.linalg.inv(information)[-1, -1]))


def _lens_scales(views: CameraViews) -> Array:
    """Usual sizes (12,) of a lens's errors."""
    width = float(views.lens.width_px)
    fx, fy = views.lens.numbers[:2]
    pixels = [_FOCAL_SHARE * fx, _FOCAL_SHARE * fy, _CENTRE_SHARE * width, _CENTRE_SHARE * width]
    return np.array([*pixels, *(_TANGENTIAL if name[0] == "p" else _RADIAL for name in LENS_NAMES[4:])])


def _lens_by_images(views: CameraViews, seen: list[ViewPose], free: list[int], scales: Array) -> tuple[Array, Array]:
    """What the corners tell of the lens whatever the arm does: data (K,) and columns (K, K), in units of `scales`."""
    information, right = lens_equations(seen, free)
    weight = scales / views.sigma_px
    right = right * weight / views.sigma_px
    size, ways = np.linalg.eigh(information * np.outer(weight, weight))
    root = np.sqrt(np.maximum(size, 0.0))
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 1e-9 * root.max())
    return inverse * (ways.T @ right), root[:, None] * ways.T
