"""Poses of the flange in place of joint values: which way of reading them agrees with what a camera saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib import frames
from calib.dataset_import.columns import Meaning, recognise
from calib.dataset_import.flange_poses import FlangePoses, clear_reading, joints_in_place, readings_of
from calib.dataset_import.place_columns import has_poses
from calib.errors import CalibError
from calib.extras.camera.board_hand_eye import MOUNTS, least_misfit_mm
from calib.extras.camera.importing.camera_views import CameraChoice, CameraPoints
from calib.extras.camera.importing.documents import SUFFIXES
from calib.extras.camera.importing.pose_files import EASY_HANDEYE, FLANGE, PoseFile, poses_of_document
from calib.kinematics.cartesian import cartesian_arm
from calib.kinematics.robot import Robot
from calib.text_files.user_table import UserTable, load_table

_FEWEST_JOINTS = 5
_CLEAR = 3.0  # ratio of misfits from which poses are taken for inverse ones
_INVERSE = "of the base in the flange's frame"


@dataclass(frozen=True)
class ArmTable:
    """A table of the arm's poses, a row each: of joint values, or of the flange with every reading of its poses."""

    table: UserTable
    readings: tuple[FlangePoses, ...] = ()  # () where it has joint values
    may_be_inverse: bool = False  # whether the program that wrote it inverts them where the camera stands in the room


def table_of_arm(
    choice: CameraChoice, joints: Path | None, robot: Robot | None, mapping: Mapping[str, Meaning]
) -> ArmTable:
    """Table of the arm's poses at which a camera measured, from what the user gave. Raises CalibError.

    joints: the table of joint values, which may have poses of the flange in their place.
    """
    path = choice.flange_poses or joints
    beside = path or choice.marker_poses
    assert beside is not None
    if path is not None and (path.suffix.lower() not in SUFFIXES or "*" in path.name):
        table = load_table(path, lambda _: None, any_encoding=True)
        is_of_flange = choice.flange_poses is not None or _has_no_joints(table, robot, mapping)
        return ArmTable(table, tuple(readings_of(table)) if is_of_flange else ())
    found = None
    if beside.suffix.lower() in SUFFIXES and (path is None or choice.flange_poses is not None):
        found = poses_of_document(beside, FLANGE, named=path is None)
    if found is None and path is None:
        raise CalibError(
            "--images and --marker-poses need the arm's poses: --joints FILE.csv, the joint values of each, or "
            "--flange-poses FILE, the poses of the flange as the controller tells them"
        )
    if found is None:
        raise CalibError(
            f"{path}: holds no pose of the flange; --flange-poses takes poses of ROS, samples of a hand-eye tool, and "
            "tables, --joints a table of joint values"
        )
    return _of_document(beside, found)


def _has_no_joints(table: UserTable, robot: Robot | None, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a table of joint values has poses of the flange in their place."""
    if not has_poses(table):
        return False
    found = recognise(table.columns, robot, mapping)
    count = _FEWEST_JOINTS if robot is None else robot.n_joints  # q1 ... q4 alone may be a quaternion
    return not all(f"q{k + 1}" in found.columns for k in range(count))


def _of_document(path: Path, found: PoseFile) -> ArmTable:
    (reading,) = found.readings
    count = len(reading.base_T_flange)
    ids = next(iter(found.names), [f"p{k + 1}" for k in range(count)])
    table = UserTable(path, ("pose",), tuple((one,) for one in ids), tuple(range(1, count + 1)), has_header=True)
    return ArmTable(table, found.readings, found.key == EASY_HANDEYE)


def joints_table(
    arm: ArmTable, camera: CameraPoints, ids: Sequence[str], given: Robot | None
) -> tuple[Robot, UserTable, list[str], list[str]]:
    """Arm and joints' table that stand for the poses of the flange, with notes and doubts.

    Of several readings the one is taken in which the arm meets the board. Raises CalibError where none does clearly.

    ids: of the table's poses. given: the robot that the user named, of which nothing but the name is taken.
    """
    row = [list(ids).index(name) for name in camera.names]
    markers = [one.base_T_flange for one in camera.readings] or [camera.camera_T_board]
    mounts = MOUNTS if camera.mount is None else (camera.mount,)

    def missed_mm(readings: Sequence[FlangePoses]) -> list[float]:
        flanges = [one.base_T_flange[row] for one in readings]
        return [min(least_misfit_mm(flange, seen, mounts) for seen in markers) for flange in flanges]

    readings, off_mm = list(arm.readings), missed_mm(arm.readings)
    if camera.mount is not None:
        inverse = [
            replace(one, base_T_flange=frames.invert(one.base_T_flange), form=f"{one.form}, {_INVERSE}")
            for one in readings
        ]
        inverse_mm = missed_mm(inverse)
        if min(inverse_mm) < min(off_mm) / _CLEAR:
            readings, off_mm = inverse, inverse_mm
    path = arm.table.path
    chosen, note = clear_reading(path, readings, off_mm, "what the camera saw", "the board")
    doubts = []
    if _INVERSE in chosen.form:
        doubts.append(
            f"{path}: by --mount {camera.mount} its poses are {_INVERSE}; if they are of the flange, leave --mount out"
        )
    if given is not None:
        doubts.append(
            f"{path}: has poses of the flange and no joint values: the camera's place is found for the arm as its "
            "controller takes it to be, and nothing of its links; log the joints too to calibrate the arm"
        )
    if arm.may_be_inverse and camera.mount is None:
        doubts.append(
            f"{path}: easy_handeye writes the inverse of the arm's poses where the camera stands in the room, which no "
            "number shows: give --mount room if it does"
        )
    robot = cartesian_arm(given.name if given is not None else "poses of the flange")
    return robot, joints_in_place(arm.table, chosen), [note], doubts
