"""Where the instrument is, with its covariance: on the flange of an arm that carries it, or in the room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD
from calib.fitting.observations import Observations, predict_poses, with_nominal_scanner_frames
from calib.fitting.pose_residuals import Nuisance, PoseResiduals
from calib.fitting.scanner_frame import orthonormal
from calib.fitting.table_evidence import TIP
from calib.kinematics.cartesian import joints_of_poses
from calib.kinematics.chain import nominal_chain
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.robot import Robot
from calib.statistics import covariance_root

_UNKNOWN = 0.5  # of a parameter's prior variance: what keeps more is not known from the points
_STEP = 1e-2  # of the tolerances
_VARIED = 0.5  # of the tolerances, by which links change with a standard deviation of each coordinate of the flange
_OPEN = 1e-12  # share of an information, below which the points leave an unknown open
_VAGUE, _SEARCH = 0.01, 150  # of a prior on the logarithms of an arm's sizes; steps of their search
_LEAST_SHARE = 0.05  # of the tolerances, to which what the points do not tell of the links is known at best


@dataclass(frozen=True)
class Mount(Brief):
    """Frame of a scanner on the controller's flange, for one mounting."""

    setup: str
    flange_T_scanner: Array  # (4, 4)
    covariance: Array  # (6, 6) of place (mm) and small turn (rad), along and about the axes of the true arm's flange
    covariance_with_table: Array  # (6, 6) the same on the flange of the fitted arm

    @property
    def xyz_mm(self) -> Array:
        """Place (3,) of the scanner's origin in the flange's frame, mm."""
        return self.flange_T_scanner[:3, 3]

    @property
    def rpy_rad(self) -> Array:
        """Roll, pitch and yaw (3,) of the scanner in the flange's frame, rad."""
        return frames.rpy_from_rotation(self.flange_T_scanner[:3, :3])


@dataclass(frozen=True)
class CameraPlace(Brief):
    """Frame of an instrument that sees full poses, such as a camera, on the flange or in the room, for one setup."""

    setup: str
    parent: str  # "flange", the controller's, where the arm carries it, else "base"
    parent_T_camera: Array  # (4, 4) mm
    covariance: Array  # (6, 6) of place (mm) and small turn (rad), along and about the parent's axes
    covariance_with_table: Array  # (6, 6) the same with the fitted table's own error left out
    board_parent: str  # "base" where the arm carries the camera, else "flange"
    board_parent_T_board: Array  # (4, 4) mm, of the board's middle

    @property
    def xyz_mm(self) -> Array:
        """Place (3,) of the camera's origin, mm, in the parent's frame."""
        return self.parent_T_camera[:3, 3]

    @property
    def rpy_rad(self) -> Array:
        """Roll, pitch and yaw (3,) of the camera in the parent's frame, rad."""
        return frames.rpy_from_rotation(self.parent_T_camera[:3, :3])

    @property
    def sigma_mm(self) -> Array:
        """Standard deviations (3,) of the place along the parent's axes, mm."""
        return np.sqrt(np.diag(self.covariance)[:3])

    def from_tip(self, robot: Robot) -> CameraPlace:
        """The same place in the frame behind the tool row of robot.toml, for a camera on the flange."""
        tip_T_flange = frames.invert(flange_T_tip(robot))
        turn = np.kron(np.eye(2), tip_T_flange[:3, :3])  # a small turn of the camera moves no point of its own origin
        return replace(
            self,
            parent="tip",
            parent_T_camera=tip_T_flange @ self.parent_T_camera,
            covariance=turn @ self.covariance @ turn.T,
            covariance_with_table=turn @ self.covariance_with_table @ turn.T,
        )


def mounts(calibration: Calibration) -> tuple[Mount, ...]:
    """Mount of the scanner in each setup; empty where the scanner stands in the room.

    A shift of the last joint's frame looks like one of the mount, so that the mount on the true flange is known no
    better than the table's last rows; on the flange of the fitted arm it is known as well as the points tell.
    """
    if not calibration.model.robot.carries_scanner:
        return ()
    if calibration.residual == "pose":
        return tuple(
            Mount(place.setup, place.parent_T_camera, place.covariance, place.covariance_with_table)
            for place in camera_places(calibration)
        )
    root, told = _parameter_roots(calibration)
    flange_T_last = frames.invert(calibration.model.robot.flange.transform)
    found = []
    for setup, scanner_T_last in calibration.after.scanner_T_base.items():
        knowledge = JointKnowledge.of(calibration, setup)
        flange_T_scanner = flange_T_last @ frames.invert(scanner_T_last)
        to_mount = _to_mount(flange_T_scanner, knowledge.centre_mm)
        by_table, own = to_mount @ knowledge.follows @ root, to_mount @ knowledge.frame_root
        by_told = by_table[:, told]
        found.append(
            Mount(setup, flange_T_scanner, by_table @ by_table.T + own @ own.T, by_told @ by_told.T + own @ own.T)
        )
    return tuple(found)


def camera_places(calibration: Calibration) -> tuple[CameraPlace, ...]:
    """Place of the instrument in each setup, from a fit of full poses; empty for other residuals.

    It follows from positions and attitudes together, with all their covariances. Of an arm whose links are held, which
    err as such do, it is the likeliest with these errors, not the one that leaves the least.
    """
    if calibration.residual != "pose":
        return ()
    fit, model = calibration.fit, calibration.model
    kept = np.array([pose not in calibration.outliers for pose in calibration.fitted_dataset.poses.ids])
    observed = Observations.of(calibration.fitted_dataset, kept & ~calibration.fitted_dataset.poses.is_test)
    residuals = PoseResiduals(model, with_nominal_scanner_frames(observed, model.placed_robot))
    nuisance = residuals.nuisance(fit.x)
    root, told = _parameter_roots(calibration)
    noise = fit.reduced_chi if np.isfinite(fit.reduced_chi) else 1.0
    by_arm, x, motion = np.zeros((nuisance.by_frames.shape[1], 0)), fit.x, np.zeros(nuisance.by_frames.shape[1])
    if not calibration.fits_links and residuals.has_orientation.all():
        by_arm, noise, change = _held_arm(calibration, observed, residuals, nuisance)
        x, motion = x + change[: len(x)], change[len(x) :]
    placed = residuals.moved(nuisance.placed, motion, nuisance.error)
    base_mm, attitude = predict_poses(model, x, residuals.observed)
    size = np.maximum(np.linalg.norm(nuisance.by_frames, axis=0), 1e-300)
    pseudo = np.linalg.pinv(nuisance.by_frames / size, rcond=1e-9) / size[:, None]
    follows, own = -pseudo @ nuisance.by_parameters, noise * pseudo
    if by_arm.shape[1] and not model.robot.is_cartesian:
        follows, own = 0.0 * follows, 0.0 * own  # they are in `by_arm`
    poses, row = observed.used_poses
    base_T_last = model.state(fit.x, poses).base_T_flange[row]
    last_T_flange, carries = model.robot.flange.transform, model.robot.carries_scanner
    found = []
    for k, (setup, scanner_T_base) in enumerate(placed.scanner_T_base.items()):
        parent_T_camera = frames.invert(scanner_T_base)
        parent_T_camera = frames.invert(last_T_flange) @ parent_T_camera if carries else parent_T_camera
        to_mount = _to_mount(parent_T_camera, nuisance.centre_mm[setup])
        part = slice(6 * k, 6 * k + 6)
        by_table = to_mount @ follows[part] @ root
        by_noise = to_mount @ np.concatenate([own[part], by_arm[part]], axis=1)
        by_told = by_table[:, told]
        first = int(np.flatnonzero(observed.setup == setup)[0])
        board = frames.make_transform(attitude[first] @ placed.tool_R_jig, base_mm[first])
        found.append(
            CameraPlace(
                setup,
                "flange" if carries else "base",
                parent_T_camera,
                by_table @ by_table.T + by_noise @ by_noise.T,
                by_told @ by_told.T + by_noise @ by_noise.T,
                "base" if carries else "flange",
                base_T_last[first] @ board if carries else frames.invert(base_T_last[first] @ last_T_flange) @ board,
            )
        )
    return tuple(found)


def _held_arm(
    calibration: Calibration, observed: Observations, residuals: PoseResiduals, nuisance: Nuisance
) -> tuple[Array, float, Array]:
    """Errors (6 S + 3, K) of frames by an arm that is held, one sigma of each, the noise beside them, and a change.

    All poses share the errors of links, within the tolerances. Their sizes, of lengths and of angles, are by which the
    residual is larger in the directions that they move it in than in others. With these errors in the covariance of the
    residual the likeliest unknowns are others: the change (P + 6 S + 3,) of parameters and frames leads there. Poses of
    a flange tell too little of an arm for that: their change is none.
    """
    from scipy.optimize import minimize  # slow to load

    columns, is_length = arm_columns(calibration, observed, residuals, nuisance)
    model, x, count = calibration.model, calibration.fit.x, nuisance.by_parameters.shape[1]
    every = np.concatenate([nuisance.by_parameters, nuisance.by_frames], axis=1)
    basis = orthonormal(every / np.maximum(np.linalg.norm(every, axis=0), 1e-300))
    residual = residuals.residual(x)
    left, apart = residual - basis @ (basis.T @ residual), columns - basis @ (basis.T @ columns)
    ways = orthonormal(apart)
    inside = ways @ (ways.T @ left)
    free = len(left) - basis.shape[1] - ways.shape[1]
    if free < 1 or not ways.shape[1]:
        none = np.zeros(every.shape[1])
        return np.zeros((len(none) - count, 0)), calibration.fit.reduced_chi, none
    noise = float(np.sum((left - inside) ** 2)) / free
    excess = inside**2 - noise * np.sum(ways**2, axis=1)
    of_place = np.tile(np.repeat([True, False], 3), len(left) // 6)

    def moved(rows: BoolArray, which: BoolArray) -> float:
        return float(np.sum(apart[np.ix_(rows, which)] ** 2))

    angles = max(float(np.sum(excess[~of_place])), 0.0) / max(moved(~of_place, ~is_length), 1e-300)
    rest = float(np.sum(excess[of_place])) - angles * moved(of_place, ~is_length)
    lengths = max(rest, 0.0) / max(moved(of_place, is_length), 1e-300)
    tolerances, columns = columns, columns * np.sqrt(np.where(is_length, lengths, angles))
    known = np.concatenate([1.0 / model.scales**2, np.zeros(every.shape[1] - count)])
    if model.robot.is_cartesian:
        spread, _ = _inverse(every.T @ every + np.diag(known))
        return -(spread @ (every.T @ columns))[count:], float(np.sqrt(noise)), np.zeros(len(known))

    def solved(logs: Array) -> tuple[float, Array, Array]:
        """Minus the log likelihood of variances of noise, lengths and angles, the change and its covariance."""
        square = np.exp(logs)
        sizes = np.sqrt(np.where(is_length, *square[1:]))
        ways, size, _ = np.linalg.svd(tolerances * sizes, full_matrices=False)
        shrunk = 1.0 / np.sqrt(square[0] + size**2) - 1.0 / np.sqrt(square[0])
        both = np.column_stack([every, residual])
        white = both / np.sqrt(square[0]) + ways @ (shrunk[:, None] * (ways.T @ both))
        unknown, right = white[:, :-1], white[:, -1]
        spread, logs_of = _inverse(unknown.T @ unknown + np.diag(known))
        gradient = unknown.T @ right + known * np.concatenate([x - model.means, np.zeros(len(known) - count)])
        parts = len(residual) * logs[0] + np.sum(np.log1p(size**2 / square[0])) + logs_of
        left = right @ right - gradient @ spread @ gradient + _VAGUE * np.sum(logs[1:] ** 2)
        return 0.5 * float(parts + left), -spread @ gradient, spread

    def height(logs: Array) -> float:
        return solved(logs)[0]

    start = np.array([np.log(max(noise, 1e-6)), -2.0, -2.0])
    best = np.asarray(minimize(height, start, method="Nelder-Mead", options={"maxiter": _SEARCH}).x)
    _, change, spread = solved(best)
    return covariance_root(spread)[count:], float(np.exp(0.5 * best[0])), change


def _inverse(information: Array) -> tuple[Array, float]:
    """Inverse of an information matrix in any units, without what it leaves open, and the log of the determinant."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    bend, ways = np.linalg.eigh(information / np.outer(scale, scale))
    told = bend > _OPEN
    inverse = (ways[:, told] / bend[told]) @ ways[:, told].T / np.outer(scale, scale)
    return inverse, float(np.sum(np.log(bend[told])) + 2.0 * np.sum(np.log(scale)))


def arm_columns(
    calibration: Calibration, observed: Observations, residuals: PoseResiduals, nuisance: Nuisance
) -> tuple[Array, BoolArray]:
    """Changes (R, K) of the residual by the errors of an arm that is held, by its tolerances, and which are lengths."""
    model, x = calibration.model, calibration.fit.x
    robot = model.robot
    if robot.is_cartesian:
        flange = nominal_chain(robot, observed.poses.q).base_T_flange
        columns = []
        for turn, along in _errors_of_links(flange):
            q = joints_of_poses(_moved(flange, _STEP * turn, _STEP * along))
            there = predict_poses(model, x, replace(observed, poses=replace(observed.poses, q=q)))
            change = (residuals.errors(nuisance.placed, *there) - nuisance.error) / _STEP
            columns.append(residuals.whitened(change[:, :, None])[:, 0])
        return np.column_stack(columns), np.arange(len(columns)) % 2 == 1
    names = [name for name in robot.parameter_names if not name.endswith(TIP)]
    free = replace(model, fixed=model.fixed - set(names))
    value = dict(zip((p.name for p in model.parameters), x.tolist(), strict=True))
    at = np.array([value.get(p.name, 0.0) for p in free.parameters])
    by_all = replace(residuals, model=free).nuisance(at).by_parameters
    rows = [k for k, p in enumerate(free.parameters) if p.name in set(names)]
    units = np.array([free.parameters[k].unit == "mm" for k in rows])
    return by_all[:, rows] * free.scales[rows], units


def _errors_of_links(base_T_flange: Array) -> Iterator[tuple[Array, Array]]:
    """Turn (N, 3), rad, and shift (N, 3), mm, of N poses of a flange by the links of an arm that is not known.

    The first link errs by a constant turn, or shift, in the base, the last by one in the flange, each of a tolerance;
    those between by turns and shifts that change linearly with the pose. Turns and shifts follow one another.
    """
    rotation, place = base_T_flange[:, :3, :3], base_T_flange[:, :3, 3]
    way = frames.rotvec_from_rotation(rotation @ frames.mean_rotation(rotation).T)
    pose = np.concatenate([place, way], axis=1)
    varied = _VARIED * (pose - pose.mean(axis=0)) / np.maximum(pose.std(axis=0), 1e-12)
    fixed, always = np.broadcast_to(np.eye(3), rotation.shape), np.ones(len(place))
    links = [
        (fixed, place, always),
        (rotation, 0.0 * place, always),
        *((fixed, 0.0 * place, part) for part in varied.T),
    ]
    for axes, lever_mm, size in links:
        for axis in np.moveaxis(size[:, None, None] * axes, 2, 0):
            yield TOLERANCE_RAD * axis, TOLERANCE_RAD * np.cross(axis, lever_mm)
            yield 0.0 * axis, TOLERANCE_MM * axis


def _moved(base_T_flange: Array, turn: Array, shift_mm: Array) -> Array:
    """Poses (N, 4, 4) after small turns (N, 3), rad, and shifts (N, 3), mm."""
    rotation = frames.rotation_from_rotvec(turn) @ base_T_flange[:, :3, :3]
    return frames.make_transform(rotation, base_T_flange[:, :3, 3] + shift_mm)


def _to_mount(parent_T_camera: Array, centre_mm: Array) -> Array:
    """Change (6, 6) of a camera's place and turn, parent's axes, by shift and turn of its frame about a centre (3,).

    The centre is a point of the camera's frame, and so are the axes of shift and turn.
    """
    turn = parent_T_camera[:3, :3]
    return -np.block([[turn, turn @ frames.skew(centre_mm)], [np.zeros((3, 3)), turn]])


def _parameter_roots(calibration: Calibration) -> tuple[Array, Array]:
    """Root (P, P) of the parameters' covariance, and a mask (P,) of its columns that the points tell.

    What the points do not tell of the links is as large, over the tolerances, as what they tell of them.
    """
    from scipy.optimize import nnls  # slow to load

    model, x = calibration.model, calibration.fit.x
    scales = model.scales
    variances, ways = np.linalg.eigh(calibration.fit.covariance / np.outer(scales, scales))
    told = variances < _UNKNOWN
    links = set(model.robot.parameter_names)
    of_links = np.array([p.name in links for p in model.parameters], dtype=bool)
    is_length = np.array([p.unit == "mm" for p in model.parameters], dtype=bool)
    shares = np.stack([np.sum(ways[rows] ** 2, axis=0) for rows in (of_links & is_length, of_links & ~is_length)], -1)
    square = np.maximum((ways.T @ ((x - model.means) / scales)) ** 2 - variances, 0.0)
    if of_links.any() and told.any() and calibration.fits_links and not calibration.links_fixed_to_table:
        size = np.clip(nnls(shares[told], square[told])[0], _LEAST_SHARE**2, 1.0)
        variances = np.where(told, variances, variances * (1.0 + shares @ (size - 1.0)))
    return np.asarray(scales[:, None] * ways * np.sqrt(np.maximum(variances, 0.0))), np.asarray(told)
