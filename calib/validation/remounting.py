"""Test whether scanner, base or tool was remounted before the test poses, by a common displacement of test points.

Test poses are placed by the scanner frame of the training poses. Where scanner or arm was moved, one rigid motion
brings all test points back; where the tool was moved, one shift in the tool's frame does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.calibration.result import Calibration
from calib.fitting.observations import Observations
from calib.frames import frames_by_name

_FEWEST = 5  # test poses
_BROUGHT_BACK = 0.5  # largest share of the test error that may remain


@dataclass(frozen=True)
class Remounting:
    """One rigid motion of all test points, with their error before and after compensating for it."""

    what: str  # "scanner" or "tool"
    shift_mm: float
    turn_rad: float  # of the scanner; 0 of the tool
    before_mm: float  # 3D RMSE of the test poses
    after_mm: float
    on_flange: bool = False  # the arm carries the scanner; "tool" is then the jig in the room

    @property
    def words(self) -> str:
        """Clause that names the motion and its likely cause."""
        left = f"brings the test poses from {self.before_mm:.3g} to {self.after_mm:.3g} mm"
        if self.what == "tool" and self.on_flange:
            return f"a jig that stands {self.shift_mm:.2g} mm elsewhere in the room {left}: it was moved, or the arm"
        if self.what == "tool":
            return f"a tool that sits {self.shift_mm:.2g} mm elsewhere {left}: it was changed or mounted anew"
        turn = f" and {np.degrees(self.turn_rad):.2g} deg" if self.turn_rad > 1e-4 else ""
        moved = "the scanner was moved on the flange" if self.on_flange else "the scanner or the arm's foot was moved"
        return f"a motion of all test points by {self.shift_mm:.2g} mm{turn} {left}: {moved}, as between two days"


def remounting(calibration: Calibration) -> Remounting | None:
    """Rigid motion that explains most of the test poses' error; None where none does, or the poses are few.

    A motion has six unknowns, a tool's place three; the remaining error is by degrees of freedom.
    """
    after = calibration.after
    rows = after.is_test[after.pose]
    if after.test is None or len(np.unique(after.pose[rows])) < _FEWEST:
        return None
    tries = [found for found in (_of_scanner(calibration, rows), _of_tool(calibration, rows)) if found]
    best = min(tries, key=lambda found: found.after_mm, default=None)
    if best is None or best.after_mm >= _BROUGHT_BACK * after.test.rmse_mm:
        return None
    return replace(best, on_flange=calibration.dataset.robot.carries_scanner)


def _of_scanner(calibration: Calibration, rows: BoolArray) -> Remounting | None:
    """Motion of the scanner that explains the test points' error; None where these are of several setups."""
    after, measured_mm = calibration.after, _points(calibration).points.xyz_mm[rows]
    if len(np.unique(calibration.dataset.poses.setup[after.pose[rows]])) > 1:
        return None
    predicted_mm = measured_mm + after.error_mm[rows]
    motion = frames.best_fit_transform(predicted_mm, measured_mm, np.ones(len(measured_mm)))
    left_mm = frames.apply(motion, predicted_mm) - measured_mm
    centre_mm = predicted_mm.mean(axis=0)
    shift_mm = float(np.linalg.norm(frames.apply(motion, centre_mm[None])[0] - centre_mm))
    turn_rad = float(np.linalg.norm(frames.rotvec_from_rotation(motion[None, :3, :3])[0]))
    return Remounting("scanner", shift_mm, turn_rad, _rmse(after.error_mm[rows], 0), _rmse(left_mm, 6))


def _of_tool(calibration: Calibration, rows: BoolArray) -> Remounting | None:
    """Shift in the tool's frame that explains the test points' error.

    With the shift t the error is scanner_R_base base_R_tool t.
    """
    after, observed = calibration.after, _points(calibration)
    if np.any(observed.points.target[rows] != "jig"):
        return None
    poses = calibration.dataset.poses
    turn = calibration.model.state(calibration.fit.x, poses).attitude
    turn = np.broadcast_to(turn, (len(poses), 3, 3))[after.pose[rows]]
    placed = frames_by_name(after.scanner_T_base, poses.setup[after.pose[rows]])[:, :3, :3]
    columns = (placed @ turn).reshape(-1, 3)
    error_mm = after.error_mm[rows].ravel()
    shift_mm = np.linalg.lstsq(columns, error_mm, rcond=None)[0]
    left_mm = (error_mm - columns @ shift_mm).reshape(-1, 3)
    return Remounting("tool", float(np.linalg.norm(shift_mm)), 0.0, _rmse(after.error_mm[rows], 0), _rmse(left_mm, 3))


def _points(calibration: Calibration) -> Observations:
    """All measured points of an evaluation as observations, in the order of the evaluation."""
    return Observations.of_all(calibration.dataset)


def _rmse(error_mm: Array, unknowns: int) -> float:
    """3D RMSE of errors (M, 3), corrected for `unknowns` fitted parameters."""
    return float(np.sqrt(np.sum(error_mm**2) / max(len(error_mm) - unknowns / 3.0, 1.0)))
