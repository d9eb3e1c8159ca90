"""Is it the arm or the camera? Probabilities that link errors, errors of lens and board, both or neither are at work.

About a fit of full poses, whitened errors y of the board's poses are linear in all that may be wrong:

    y = A x - G n - g s + F f + noise

with link errors x, the lens's error n (`ViewPose.by_lens`), the error s of the board's size (places grow by s), and
the unknown frames, board and tool f. Each hypothesis leaves some of x, n and s at zero and gives the others normal
priors of a size that is averaged over; the likelihoods of all data, noise up to twice the pixels' included, are
compared at equal prior odds (MacKay 1992). A lens found from the same images is as unknown as they leave it under
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
from calib.extras.camera.lens import FREE_NAMES, Lens
from calib.extras.camera.observed import camera_of
from calib.extras.camera.view import pose_of_view
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
    points = observed.points.free_of(None)
    views = [camera.of(dataset.poses.ids[pose]) for pose in points.pose]
    shown = [view for view in views if view is not None]
    if points.orientations is None or not points.orientations.known.all() or len(shown) < len(views):
        return None  # a point without corners, or the mean of several
    by_lens = points.shared
    if by_lens is None:
        starts = frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)
        seen = [pose_of_view(camera.lens, view, start) for view, start in zip(shown, starts, strict=True)]
        by_lens = np.stack([one.by_lens for one in seen])[:, :, : len(FREE_NAMES)] * _lens_scales(camera.lens)
    observed = replace(observed, points=replace(points, shared=None))
    return _compared(calibration, observed, by_lens, lens_is_found=points.shared is not None)


def _lens_scales(lens: Lens) -> Array:
    """Usual sizes (9,) of the errors of a lens's numbers."""
    fx, fy = lens.numbers[:2]
    pixels = [_LENS_SHARE * px for px in (fx, fy, lens.width_px, lens.width_px)]
    return np.array([*pixels, *(_TANGENTIAL if name[0] == "p" else _RADIAL for name in FREE_NAMES[4:])])


def _compared(
    calibration: Calibration, observed: Observations, by_lens: Array, *, lens_is_found: bool
) -> ArmOrCamera | None:
    """Probabilities of the hypotheses; None where that board or camera was moved on the way is likelier than all.

    by_lens: changes (M, 6, L) of the poses by the usual errors of the lens, mm and rad, or by one sigma of its own.
    """
    model, x = calibration.model, calibration.fit.x
    residuals = PoseResiduals(model, with_nominal_scanner_frames(observed, model.placed_robot))
    nuisance = residuals.nuisance(x)
    links = next(effect for effect in model.effects if isinstance(effect, LinkErrors))
    scale_of = {p.name: p.scale for p in links.parameters}
    of_arm: BoolArray = np.array([p.name in scale_of and not p.name.endswith("TCP") for p in model.parameters])
    scales = np.array([scale_of.get(p.name, 1.0) for p in model.parameters])
    always = np.concatenate([nuisance.by_frames, nuisance.by_parameters[:, ~of_arm]], axis=1)
    basis = orthonormal(always / np.maximum(np.linalg.norm(always, axis=0), 1e-300))

    def apart(columns: Array) -> Array:
        return columns - basis @ (basis.T @ columns)

    places_mm = observed.points.xyz_mm
    by_size = np.concatenate([_BOARD_SHARE * places_mm, np.zeros_like(places_mm)], axis=1)[:, :, None]
    arm = apart((nuisance.by_parameters * scales)[:, of_arm])
    lens, size = apart(-residuals.whitened(by_lens)), apart(-residuals.whitened(by_size))
    data = apart(nuisance.by_parameters @ x - residuals.residual(x))
    dof = len(data) - basis.shape[1]

    def columns(a: float, c: float) -> Array:
        """Unknowns in standard deviations of their priors; the size of the board is the last."""
        return np.concatenate([a * arm, (1.0 if lens_is_found else c) * lens, c * size], axis=1)

    def evidence(arms: Array, sides: Array, moves: Sequence[Array] = (np.zeros((len(data), 0)),)) -> float:
        sets = (np.concatenate([columns(a, c), move], axis=1) for a, c, move in product(arms, sides, moves))
        each = [one for columns in sets for one in _log_evidences(data, columns, dof)]
        return float(np.logaddexp.reduce(each) - np.log(len(each)))

    none = np.zeros(1)
    shares = product((none, _SIDE_SHARES), (none, _ARM_SHARES))
    logs = [evidence(arms, sides) for sides, arms in shares]
    moves = [apart(part) for part in _moves(always, len(observed.points))]
    if moves and evidence(_ARM_SHARES, none, moves) > max(logs):
        return None
    probabilities = np.exp(logs - np.logaddexp.reduce(logs))
    off, sigma = _last_coefficient(data, columns(1.0, 1.0), dof)
    of_each = dict(zip(HYPOTHESES, probabilities.tolist(), strict=True))
    return ArmOrCamera(of_each, 1.0 + _BOARD_SHARE * off, _BOARD_SHARE * sigma)


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
