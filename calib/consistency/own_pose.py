"""The controller's own Cartesian poses against the robot's table: whether both compute with the same one."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from calib.array_types import Array
from calib.consistency.agreement import Sample, misfit_mm, sample_of
from calib.frames import make_transform, rotation_from_rotvec
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot

AGREES_MM = 0.1  # rms, up to which both are one table: digits of a log, noise of joints
_HOPELESS = 0.4  # of the points' spread: another robot, another sequence of joints


def table_disagreement_mm(robot: Robot, q: Array, tool_mm: Array) -> float | None:
    """Root mean square distance, mm, between the controller's tool and the table's, after the best base and tool.

    None where the poses are too few to tell.

    Args:
        q: (N, n) joint values, rad or mm.
        tool_mm: (N, 3) places of the tool that the controller wrote down, in any frame that stands still.
    """
    sample = sample_of(q, tool_mm)
    if not sample.is_enough:
        return None
    rough = misfit_mm(robot, sample)
    return rough if rough > _HOPELESS * sample.spread_mm else min(rough, _best_mm(robot, sample))


def _best_mm(robot: Robot, sample: Sample) -> float:
    """Misfit at the best base frame and tool point, all nine numbers fitted at once."""
    ends = nominal_chain(robot, sample.q).base_T_frame[:, -1]
    seen, scale = sample.points_mm, sample.spread_mm

    def off(p: Array) -> Array:
        mine = ends[:, :3, 3] + ends[:, :3, :3] @ (scale * p[6:])
        frame = make_transform(rotation_from_rotvec(p[:3]), scale * p[3:6])
        return (mine @ frame[:3, :3].T + frame[:3, 3] - seen).ravel() / scale

    starts = [
        np.concatenate([turn, np.zeros(6)]) for turn in np.vstack([np.zeros(3), 2.0 * np.eye(3), -2.0 * np.eye(3)])
    ]
    best = min((least_squares(off, start, method="lm") for start in starts), key=lambda fit: float(fit.cost))
    return float(scale * np.sqrt(2.0 * best.cost / len(seen)))


def agreement_note(name: str, off_mm: float) -> tuple[bool, str]:
    """Whether the controller and the table are one, and the sentence that says so."""
    if off_mm <= AGREES_MM:
        return True, (
            f"{name}: the controller's own poses agree with the robot's table to {off_mm:.2g} mm (rms, after the best "
            "base and tool)"
        )
    return False, (
        f"{name}: your table and your controller disagree by {off_mm:.2g} mm (rms after the best base and tool): they "
        "use different tables; give the controller's (a UR's calibration.conf), or expect its poses to be off by that"
    )
