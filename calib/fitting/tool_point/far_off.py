"""Is the tool point far from where robot.toml has it? Before a fit, by the points alone, and after it, by its table.

Far is what the tolerances of the last two rows do not allow. A prior that is weighed by the residual holds a parameter
the harder the worse the fit is, so a tool that is off by 80 mm would hold itself where robot.toml has it. Far is, too,
what the rows reach only by turning the tip by more than an angle's tolerance: one point tells nothing of its attitude.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from calib.array_types import Array
from calib.effects.link_errors import TOLERANCE_RAD, LinkErrors
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.fitting.tool_point.placement import (
    angles_behind_last_axis,
    free_directions,
    tip_turn_rad,
    tolerance_covariance,
    tool_point_in_nominal,
)
from calib.fitting.tool_point.search import ToolPointProblem, solve_tool_point
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import tool_point_of, with_own_tool_point

_FAR = 3.0  # sigmas
_SYSTEMATIC = 3.0  # sigmas of the search are those of white errors; link errors are not white


def search_tool_point(observed: Observations, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """The nominal arm with the tool point where the points alone have it; None where that is not far off."""
    robot = links.robot
    nominal_mm = tool_point_of(robot)
    solved = solve_tool_point(ToolPointProblem.of(observed, robot, nominal_mm, free_directions(robot, fixed)))
    if solved is None:
        return None
    covariance = tolerance_covariance(robot, links, fixed) + _SYSTEMATIC**2 * solved.covariance_mm2
    if not _is_far(solved.point_mm - nominal_mm, covariance):
        return None
    return with_own_tool_point(robot, solved.point_mm)


def fitted_tool_point(model: Model, fit: Fit, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """The nominal arm with the tool point where a fit has it; None where that is within what the tolerances allow.

    links, fixed: as they were asked for; the model may have wider tolerances, and fix more.
    """
    if free_directions(links.robot, fixed).shape[1] == 0:
        return None
    point_mm = tool_point_in_nominal(links.robot, model.calibrated_robot(fit.x))
    off_mm = point_mm - tool_point_of(links.robot)
    if not _is_far(off_mm, tolerance_covariance(links.robot, links, fixed)):
        return None
    return with_own_tool_point(links.robot, point_mm)


def turning_tool_point(model: Model, fit: Fit, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """The nominal arm with the tool point where a fit has it by turning the tip; None where it hardly turns it."""
    calibrated = model.calibrated_robot(fit.x)
    tolerance_rad = max(links.tolerances.get(name, TOLERANCE_RAD) for name in angles_behind_last_axis(links.robot))
    turned = tip_turn_rad(links.robot, calibrated) > tolerance_rad
    if free_directions(links.robot, fixed).shape[1] < 3 or not turned:
        return None
    return with_own_tool_point(links.robot, tool_point_in_nominal(links.robot, calibrated))


def _is_far(off_mm: Array, covariance_mm2: Array) -> bool:
    return bool(off_mm @ np.linalg.solve(covariance_mm2, off_mm) > _FAR**2)
