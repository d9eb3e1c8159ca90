"""Corrected joint targets as a file: a controller's point list, or the table with corrected joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.compensation.target_correction import Correction
from calib.compensation.targets_csv import Targets, corrected_table
from calib.robot_formats.programs.point_lists import (
    JointTarget,
    is_point_list,
    point_list,
    require_point_list,
)


def corrected_file(path: Path, targets: Targets, correction: Correction) -> str:
    """What a file of this name is to hold: a controller's point list, or the table with corrected joints."""
    if is_point_list(path):
        return corrected_points(path, correction, targets.poses.ids)
    return corrected_table(targets, correction)


def corrected_points(path: Path, correction: Correction, ids: Sequence[str]) -> str:
    """The targets that are reached, in the language that the file's name tells; the others as comments with the reason.

    Raises as `require_point_list`.
    """
    require_point_list(path, correction.robot.is_revolute.tolist())
    commanded = correction.robot.commands_of(correction.q)
    reasons = (
        "" if reached else reason for reached, reason in zip(correction.reached, correction.reasons, strict=True)
    )
    listed = [JointTarget(*one) for one in zip(ids, commanded, reasons, strict=True)]
    heading = (
        f"Joint targets of {correction.robot.name}, corrected for the calibrated arm ({correction.kind}).",
        f"{int(correction.reached.sum())} of {len(listed)} targets are reached.",
    )
    return point_list(path, listed, heading)
