"""Where the instrument is, with its covariance: on the flange of an arm that carries it, or in the room."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.robot import Robot

_UNKNOWN = 0.5  # of a parameter's prior variance: what keeps more is not known from the points


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

    It follows from positions and attitudes together, with all their covariances.
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
    size = np.maximum(np.linalg.norm(nuisance.by_frames, axis=0), 1e-300)
    pseudo = np.linalg.pinv(nuisance.by_frames / size, rcond=1e-9) / size[:, None]
    follows, own = -pseudo @ nuisance.by_parameters, noise * pseudo
    poses, row = observed.used_poses
    base_T_last = model.state(fit.x, poses).base_T_flange[row]
    last_T_flange, carries = model.robot.flange.transform, model.robot.carries_scanner
    found = []
    for k, (setup, scanner_T_base) in enumerate(nuisance.placed.scanner_T_base.items()):
        parent_T_camera = frames.invert(scanner_T_base)
        parent_T_camera = frames.invert(last_T_flange) @ parent_T_camera if carries else parent_T_camera
        to_mount = _to_mount(parent_T_camera, nuisance.centre_mm[setup])
        part = slice(6 * k, 6 * k + 6)
        by_table, by_noise = to_mount @ follows[part] @ root, to_mount @ own[part]
        by_told = by_table[:, told]
        first = int(np.flatnonzero(observed.setup == setup)[0])
        board = frames.make_transform(nuisance.attitude[first] @ nuisance.placed.tool_R_jig, nuisance.base_mm[first])
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


def _to_mount(parent_T_camera: Array, centre_mm: Array) -> Array:
    """Change (6, 6) of a camera's place and turn, parent's axes, by shift and turn of its frame about a centre (3,).

    The centre is a point of the camera's frame, and so are the axes of shift and turn.
    """
    turn = parent_T_camera[:3, :3]
    return -np.block([[turn, turn @ frames.skew(centre_mm)], [np.zeros((3, 3)), turn]])


def _parameter_roots(calibration: Calibration) -> tuple[Array, Array]:
    """Root (P, P) of the parameters' covariance, and a mask (P,) of its columns that the points tell."""
    scales = calibration.model.scales
    variances, ways = np.linalg.eigh(calibration.fit.covariance / np.outer(scales, scales))
    root = scales[:, None] * ways * np.sqrt(np.maximum(variances, 0.0))
    return np.asarray(root), np.asarray(variances < _UNKNOWN)
