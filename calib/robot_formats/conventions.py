"""Robot's table under both Denavit-Hartenberg conventions, for a choice by the measured points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from calib.errors import CalibError
from calib.frames import invert
from calib.kinematics.flange import flange_T_tip
from calib.kinematics.robot import Robot
from calib.options import BUILTIN_ROBOTS
from calib.robot_formats.chain.five_parameters import modified_transform, robot_of, row_transform
from calib.robot_formats.chain.serial_chain import ChainJoint, SerialChain
from calib.robot_formats.robot_file import ReadOptions, RobotFile, named_robot
from calib.robot_formats.robot_form import template_suffixes
from calib.robot_formats.tables import CONVENTIONS
from calib.text_files.column_names import plain, split_unit
from calib.text_files.user_table import load_table

TABLE_KINDS = {"standard": "standard Denavit-Hartenberg", "modified": "modified Denavit-Hartenberg (Craig)"}


@dataclass(frozen=True)
class RobotReading:
    """A robot read from its file under one convention, and whether the user asked for that convention."""

    convention: str  # "standard", "modified"; "" where the file leaves no choice
    robot: RobotFile
    asked: bool = True
    path: Path | None = None  # of the user's own file, whose origins can be replaced by calibrated ones


def robot_readings(name: str, reading: ReadOptions) -> list[RobotReading]:
    """Robot of a file as asked for, and under the other Denavit-Hartenberg convention of its table, if there is one.

    A table of theta, d, a, alpha without --convention has no first choice: none of its readings is `asked`.
    Raises CalibError as `named_robot`.
    """
    path = Path(name)
    if name in BUILTIN_ROBOTS:
        return [RobotReading("", named_robot(name, reading))]
    if path.suffix.lower() == ".csv" and _is_denavit_hartenberg(path):
        return _readings_of_table(path, reading)
    found = named_robot(name, reading)
    other = as_modified(found.robot) if path.suffix.lower() == ".toml" else None
    own = path if path.suffix.lower() in template_suffixes() and path.is_file() else None
    readings = [RobotReading("standard" if other is not None else "", found, path=own)]
    if other is not None:
        weighed = any(joint.mass_kg or joint.com_mm for joint in found.robot.joints)
        notes = ("masses are left out, as centres of mass stand in other frames then",) if weighed else ()
        readings.append(RobotReading("modified", RobotFile(other, None, notes), asked=False))
    return readings


def _is_denavit_hartenberg(path: Path) -> bool:
    columns = {plain(split_unit(column)[0]) for column in load_table(path).columns}
    return {"theta", "d", "a", "alpha"} <= columns


def _readings_of_table(path: Path, reading: ReadOptions) -> list[RobotReading]:
    found: list[RobotReading] = []
    failed: CalibError | None = None
    for convention in CONVENTIONS:
        is_asked = convention == reading.convention
        try:
            robot = named_robot(str(path), replace(reading, convention=convention))
            found.insert(0 if is_asked else len(found), RobotReading(convention, robot, asked=is_asked))
        except CalibError as error:
            if is_asked:
                raise
            failed = error
    if failed is not None and not found:
        raise failed
    return found


def as_modified(robot: Robot) -> Robot | None:
    """Robot with the rows taken as modified Denavit-Hartenberg, Rx(alpha) Trans(a, 0, 0) Rz(theta + q) Trans(0, 0, d).

    None where modified tables cannot express it: beta, further targets, coupled joints. The tool's row stays as it is;
    centres of mass, which would be in other frames, are left out.
    """
    if any(joint.beta_rad for joint in robot.joints) or robot.targets or robot.coupling:
        return None
    joints = [
        ChainJoint(
            joint.name, modified_transform(joint.a_mm, joint.alpha_rad, joint.d_mm, joint.theta_rad), type=joint.type,
            min=joint.min, max=joint.max, gear_ratio=joint.gear_ratio,
        )
        for joint in robot.joints
    ]  # fmt: skip
    joints[0] = replace(joints[0], before_T_joint=robot.base_T_first @ joints[0].before_T_joint)
    tool = row_transform(robot.tool.row)
    return robot_of(
        SerialChain(robot.name, tuple(joints), tool, robot.gravity_m_s2, tip_T_flange=invert(flange_T_tip(robot)))
    )
