"""Files of a plan, by the file's name: poses.csv, a controller's point list, a ROS trajectory; measuring programs."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.files.poses_csv import poses_frame
from calib.errors import CalibError
from calib.planning.plan import Plan
from calib.planning.ways import steps_of, targets_of
from calib.robot_formats.measuring_program import (
    MeasuringOptions,
    ProgramTemplate,
    check_program,
    measuring_program,
    template_of,
)
from calib.robot_formats.programs import JointTarget, is_point_list, point_list, require_point_list, trajectory_yaml
from calib.text_files.csv_text import frame_csv

CSV, ROS = ".csv", (".yaml", ".yml")


def check_plan_file(path: Path) -> None:
    """Raise CalibError for a file name whose format is none of those for plans."""
    suffix = path.suffix.lower()
    if suffix != CSV and suffix not in ROS and not is_point_list(path):
        raise CalibError(
            f"{path}: a plan is written as .csv (poses.csv), .script (URScript), .dat (KRL), .mod (RAPID) or .yaml "
            "(ROS)"
        )


def planned_file(path: Path, plan: Plan) -> str:
    """Content of a plan's file, in the format given by the file's name.

    Raises CalibError for a name of no such form, and for an arm that its form cannot hold.
    """
    check_plan_file(path)
    if path.suffix.lower() == CSV:
        return frame_csv(poses_frame(plan.poses, plan.start.dataset.robot))
    robot = plan.start.dataset.robot
    heading = (
        f"{len(plan.poses)} poses of {robot.name} to measure, for {plan.criterion.name}, in this order.",
        "Ways were looked at with the arm at rest; the plan names those that are blocked. Run them slowly first.",
    )
    if path.suffix.lower() in ROS:
        return trajectory_yaml(robot, _targets(plan), heading)
    require_point_list(path, robot.is_revolute.tolist())
    return point_list(path, _targets(plan), heading)


def check_plan_program(path: Path, options: MeasuringOptions, template: Path | None) -> ProgramTemplate | None:
    """User's template of a measuring program, read. Raises CalibError for what cannot be written."""
    check_program(path, options, template is not None)
    return None if template is None else template_of(template)


def planned_program(
    path: Path, plan: Plan, options: MeasuringOptions, template: ProgramTemplate | None = None
) -> dict[Path, str]:
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
    return measuring_program(path, steps, robot.is_revolute, heading, options, template)


def _targets(plan: Plan) -> list[JointTarget]:
    """Commanded joints in the order of the motion, with the points past obstacles and to sides of approach."""
    return targets_of(plan.start.dataset.robot, plan.poses, plan.ways)
