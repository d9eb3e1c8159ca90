"""Is the tool point far from where robot.toml has it? Before a fit, by the points alone, and after it, by its table.

Far is what the tolerances of the last two rows do not allow. A prior that is weighed by the residual holds a parameter
the harder the worse the fit is, so a tool that is off by 80 mm would hold itself where robot.toml has it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.effects.link_errors import LinkErrors
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.fitting.tool_point.placement import (
    free_directions,
    loose_tolerances,
    tolerance_covariance,
    tool_point,
    tool_point_in_nominal,
    with_tool_point,
)
from calib.fitting.tool_point.search import ToolPointProblem, solve_tool_point
from calib.kinematics.robot import Robot

_FAR = 4.0  # sigmas
_SYSTEMATIC = 3.0  # sigmas of the search are those of white errors; link errors are not white


def search_tool_point(observed: Observations, links: LinkErrors, held: Collection[str]) -> Robot | None:
    """The nominal arm with the tool point where the points alone have it; None where that is not far off."""
    robot = links.robot
    nominal_mm = tool_point(robot.table)
    solved = solve_tool_point(ToolPointProblem.of(observed, robot, nominal_mm, free_directions(robot, held)))
    if solved is None:
        return None
    covariance = tolerance_covariance(robot, links, held) + _SYSTEMATIC**2 * solved.covariance_mm2
    if not _is_far(solved.point_mm - nominal_mm, covariance):
        return None
    return with_tool_point(robot, solved.point_mm, held)


def fitted_tool_point(model: Model, fit: Fit, links: LinkErrors) -> Robot | None:
    """The nominal arm with the tool point where a fit has it; None where that is within what the tolerances allow.

    links: with the tolerances that were asked for; the model's may be wider.
    """
    robot, held = links.robot, model.held
    if free_directions(robot, held).shape[1] == 0:
        return None
    point_mm = tool_point_in_nominal(robot, model.calibrated_robot(fit.x).table)
    if not _is_far(point_mm - tool_point(robot.table), tolerance_covariance(robot, links, held)):
        return None
    return with_tool_point(robot, point_mm, held)


def with_loose_tool(model: Model, links: LinkErrors, found: Robot) -> Model:
    """The model with tolerances that let the tool point be as far off as it was found; those asked for stay."""
    tolerances = {**loose_tolerances(links.robot, found), **links.tolerances}
    wider = replace(links, tolerances=tolerances)
    return replace(model, effects=(wider, *model.effects[1:]), tool_found=found)


def _is_far(off_mm: Array, covariance_mm2: Array) -> bool:
    return bool(off_mm @ np.linalg.solve(covariance_mm2, off_mm) > _FAR**2)
