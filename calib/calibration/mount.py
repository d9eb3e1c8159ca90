"""Where the scanner sits on the flange of an arm that carries it, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge

_UNKNOWN = 0.5  # of a parameter's prior variance: what keeps more is not known from the points


@dataclass(frozen=True)
class Mount(Brief):
    """Frame of a scanner on the flange, for one mounting."""

    setup: str
    flange_T_scanner: Array  # (4, 4)
    covariance: Array  # (6, 6) of place (mm) and small turn (rad), along and about the axes of the true arm's flange
    covariance_with_table: Array  # (6, 6) the same on the flange of the fitted arm

    @property
    def xyz_mm(self) -> Array:
        """Place (3,) of the scanner's origin in the flange's frame, mm."""
        return np.asarray(self.flange_T_scanner[:3, 3])

    @property
    def rpy_rad(self) -> Array:
        """Roll, pitch and yaw (3,) of the scanner in the flange's frame, rad."""
        return frames.rpy_from_rotation(self.flange_T_scanner[:3, :3])


def mounts(calibration: Calibration) -> tuple[Mount, ...]:
    """Mount of the scanner in each setup; empty where the scanner stands in the room.

    A shift of the last joint's frame looks like one of the mount, so that the mount on the true flange is known no
    better than the table's last rows; on the flange of the fitted arm it is known as well as the points tell.
    """
    if not calibration.model.robot.carries_scanner:
        return ()
    scales = calibration.model.scales
    variances, ways = np.linalg.eigh(calibration.fit.covariance / np.outer(scales, scales))
    root = scales[:, None] * ways * np.sqrt(np.maximum(variances, 0.0))
    found = []
    for setup, scanner_T_flange in calibration.after.scanner_T_base.items():
        knowledge = JointKnowledge.of(calibration, setup)
        flange_T_scanner = frames.invert(scanner_T_flange)
        turn = flange_T_scanner[:3, :3]
        # from a shift and a turn about the points' centre, in the scanner's frame
        to_mount = -np.block([[turn, turn @ frames.skew(knowledge.centre_mm)], [np.zeros((3, 3)), turn]])
        by_table, own = to_mount @ knowledge.follows @ root, to_mount @ knowledge.frame_root
        told = by_table[:, variances < _UNKNOWN]
        found.append(Mount(setup, flange_T_scanner, by_table @ by_table.T + own @ own.T, told @ told.T + own @ own.T))
    return tuple(found)
