"""Files of a plan, by the file's name: poses.csv, and what plug-ins write of joint targets."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.files.poses_csv import poses_frame
from calib.errors import CalibError
from calib.planning.plan import Plan
from calib.planning.ways import targets_of
from calib.plugins import contributions
from calib.rendering import numbers
from calib.robot_formats.joint_targets import JointTarget, written_targets
from calib.robot_formats.target_form import TargetForm, form_of_targets
from calib.text_files.csv_text import frame_csv

CSV = ".csv"


def check_plan_file(path: Path) -> None:
    """Raise CalibError for a file name whose format is none of those for plans."""
    if path.suffix.lower() != CSV and form_of_targets(path) is None:
        forms = [f"{form.suffixes[0]} ({form.name})" for form in contributions(TargetForm)]
        known = numbers.listing([f"{CSV} (poses.csv)", *forms], "or")
        others = "" if forms else "; robot programs are written by the extra robot_programs"
        raise CalibError(f"{path}: a plan is written as {known}{others}")


def planned_file(path: Path, plan: Plan) -> str:
    """Content of a plan's file, in the format given by the file's name.

    Raises CalibError for a name of no such form, and for an arm that its form cannot hold.
    """
    check_plan_file(path)
    form = form_of_targets(path)
    if form is None:
        return frame_csv(poses_frame(plan.poses, plan.start.dataset.robot))
    robot = plan.start.dataset.robot
    heading = (
        f"{len(plan.poses)} poses of {robot.name} to measure, for {plan.criterion.name}, in this order.",
        "Ways were looked at with the arm at rest; the plan names those that are blocked. Run them slowly first.",
    )
    return written_targets(form, path, robot, _targets(plan), heading)


def files_of_plan(path: Path, plan: Plan) -> dict[Path, str]:
    """A plan's file by its path; raises as `planned_file`."""
    return {path: planned_file(path, plan)}


def _targets(plan: Plan) -> list[JointTarget]:
    """Commanded joints in the order of the motion, with the points past obstacles and to sides of approach."""
    return targets_of(plan.start.dataset.robot, plan.poses, plan.ways)
