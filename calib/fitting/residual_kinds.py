"""Kinds of residuals, by the name that a user chooses:

* "position" (`PositionResiduals`): predicted minus measured points, the scanner frame of each setup unknown.
* "distance" (`DistanceResiduals`): distances from a reference pose, which need no frame at all (Jang 2025 eq 9-16).
* "pairs" (`PairResiduals`): the distances between all points of a setup, with their joint covariance.
* "pose" (`PoseResiduals`): positions, and orientations of the jig where they were measured.

All implement `calib.fitting.residual.Residuals`.
"""

from __future__ import annotations

from calib.errors import FitError
from calib.fitting.distance_residuals import DistanceResiduals
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.fitting.pose_residuals import PoseResiduals
from calib.fitting.position_residuals import PairResiduals, PositionResiduals
from calib.kinematics.robot import Robot
from calib.options import RESIDUAL_KINDS


def make_residuals(
    kind: str, model: Model, observed: Observations
) -> PositionResiduals | DistanceResiduals | PoseResiduals:
    """Least-squares problem of a named kind (`RESIDUAL_KINDS`). Raises FitError if unknown or unfit for the arm."""
    require_kind_for(model.robot, kind)
    if kind == "pairs":
        return PairResiduals(model, observed)
    if kind == "position":
        return PositionResiduals(model, observed)
    if kind == "distance":
        return DistanceResiduals(model, observed)
    if kind == "pose":
        return PoseResiduals(model, observed)
    raise FitError(f"no residual named {kind!r}; there are {' and '.join(RESIDUAL_KINDS)}")


def require_kind_for(robot: Robot, kind: str) -> None:
    """Raise FitError for residuals of distances if the arm carries the scanner, as its targets do not move."""
    if robot.carries_scanner and kind in ("distance", "pairs"):
        raise FitError(
            f"residual {kind}: a scanner on the flange measures a jig that stands still, and distances between poses "
            "are not the arm's; take position or pose"
        )
