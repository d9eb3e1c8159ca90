"""Files of a plan for the robot, by the file's name: poses.csv, a controller's point list, a ROS trajectory."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.files.poses_csv import poses_frame
from calib.errors import CalibError
from calib.planning.plan import Plan
from calib.robot_formats.programs import (
    JointTarget,
    is_point_list,
    point_list,
    require_point_list,
    trajectory_yaml,
)
from calib.text_files.csv_text import frame_csv
from calib.workcell.pose_conditions import come_from

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


def _targets(plan: Plan) -> list[JointTarget]:
    """Commanded poses; before a pose to be approached from given sides comes its starting point."""
    robot, poses, cell = plan.start.dataset.robot, plan.poses, plan.start.cell
    start = None
    if poses.approach is not None:
        start = robot.commands_of(come_from(poses.q, poses.approach, robot.is_revolute, cell.low, cell.high))
    out: list[JointTarget] = []
    for k, (name, q) in enumerate(zip(poses.ids, robot.commands_of(poses.q), strict=True)):
        if start is not None:
            out.append(JointTarget(f"{name}_from", start[k]))
        out.append(JointTarget(name, q))
    return out
