"""Programs that measure the poses of a plan."""

from __future__ import annotations

from pathlib import Path

from calib.errors import CalibError
from calib.extras.robot_programs.measuring_options import MeasuringOptions
from calib.extras.robot_programs.measuring_program import measuring_program
from calib.planning.plan import Plan
from calib.planning.ways import steps_of


def planned_program(path: Path, plan: Plan, options: MeasuringOptions) -> dict[Path, str]:
    """Files of the program that measures a plan's poses, with their content.

    Raises CalibError for an arm that its language cannot hold, and for a pose to which no free way was found.
    """
    robot, names = plan.start.dataset.robot, plan.poses.ids
    closed = [k for k, way in enumerate(plan.ways) if not way.clear]
    if closed:
        from_there = f"from {names[closed[0] - 1]} " if closed[0] else ""
        more = f", and {len(closed) - 1} more" if len(closed) > 1 else ""
        raise CalibError(
            f"{path}: no way {from_there}to {names[closed[0]]} past floor, boxes, instrument and the arm itself was "
            f"found{more}; plan with another --seed, or write the poses without motions (--out)"
        )
    heading = (
        f"Measures {len(plan.poses)} poses of {robot.name}, planned for {plan.criterion.name}, in this order.",
        "Ways from pose to pose were checked against what is known of the cell: floor, boxes, instrument, the arm.",
        "What is not known was not checked. Run it slowly first, a hand on the stop.",
    )
    steps = steps_of(robot, plan.poses, plan.ways)
    return measuring_program(path, steps, robot.is_revolute, heading, options)


def usual_program(path: Path, plan: Plan) -> dict[Path, str]:
    """Files of the program with the usual speed and waits, and without a trigger; raises as `planned_program`."""
    return planned_program(path, plan, MeasuringOptions())
