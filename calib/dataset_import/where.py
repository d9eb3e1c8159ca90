"""Where the frames of an arm are at joint values, and how poses that were told differ."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib import frames
from calib.array_types import Array
from calib.dataset_import.columns import recognise
from calib.dataset_import.flange_poses import readings_of
from calib.dataset_import.place_columns import FIXED, VECTOR, XYZ, ZYX, ZYZ, has_poses, pose_columns
from calib.dataset_import.reading import ImportReport, joint_values, recognised
from calib.dataset_import.units import joint_units
from calib.errors import CalibError
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.serial_chain import chain_frames
from calib.robot_formats.robot_file import ReadOptions, RobotFile, named_robot, read_arm
from calib.text_files.column_names import ANGLES_RAD, LENGTHS_MM, SCALES
from calib.text_files.user_table import UserTable, load_table

_QUARTER_RAD = float(np.radians(1.0))  # from whole quarter turns, within which two frames are one and its axes' names
_TABLES = (".csv", ".txt", ".tsv", ".xlsx", ".json")
_WORDS = {
    VECTOR: "vector rotvec rvec",
    FIXED: "rpy wpr roll fanuc",
    ZYX: "abc kuka",
    ZYZ: "oat kawasaki",
    XYZ: "staubli stäubli",
}


@dataclass(frozen=True, eq=False)
class NamedFrame:
    """A frame in the base's, or a pose that was told."""

    name: str
    base_T_frame: Array  # (4, 4) mm
    form: str = ""  # how the numbers of a told pose were read


@dataclass(frozen=True)
class FrameDifference:
    """How two poses differ: a shift between their places, and the turn from the first frame to the second."""

    one: NamedFrame
    other: NamedFrame
    as_told: bool = True  # whether their numbers are read as they are said to be meant

    @property
    def shift_mm(self) -> Array:
        """Place of the second less that of the first (3,), in the base frame."""
        return np.asarray(self.other.base_T_frame[:3, 3] - self.one.base_T_frame[:3, 3])

    @property
    def turn(self) -> Array:
        """Rotation (3, 3) from the second frame to the first."""
        return np.asarray(self.one.base_T_frame[:3, :3].T @ self.other.base_T_frame[:3, :3])

    @property
    def quarter_turn(self) -> tuple[Array, float]:
        """Nearest rotation (3, 3) by whole quarter turns, and how far, rad, the turn is from it."""
        off = np.linalg.norm(frames.rotvec_from_rotation(np.swapaxes(_QUARTERS, 1, 2) @ self.turn), axis=1)
        return _QUARTERS[int(np.argmin(off))], float(off.min())

    @property
    def is_quarter_turn(self) -> bool:
        """Whether both are one frame whose axes have other names, as ROS's flange and tool0."""
        return self.quarter_turn[1] < _QUARTER_RAD


@dataclass(frozen=True)
class FramesTold:
    """Frames of an arm or poses that were told, and the difference of two that are compared."""

    frames: tuple[NamedFrame, ...]
    shown: tuple[NamedFrame, ...]  # those to be told in every form
    difference: FrameDifference | None = None


_QUARTERS = Rotation.create_group("O").as_matrix()  # (24, 3, 3) by quarter turns about the axes


def frames_told(
    source: str, poses: Path | None, joints: str | None, frame: str | None, reading: ReadOptions
) -> FramesTold:
    """Frames of a robot at joint values, poses of a table that were told, and the difference of two of them.

    Args:
        source: a robot's file, folder or name; or a table of poses alone.
        poses: table of joint values or of poses.
        joints: joint values, "q1,q2,..." in degrees and mm, or a table's path.
        frame: the one to be told; None: the arm's tip.

    Raises:
        CalibError: of the robot or the table, or a frame that is not there.
    """
    if poses is None and joints is None:
        told = _told_poses(load_table(Path(source), any_encoding=True)) if Path(source).suffix in _TABLES else []
        if not told:
            raise CalibError(f"{source}: give joint values beside a robot (--joints), or a table of poses")
        return _compared((), told)
    path = Path(source) / "robot.toml" if Path(source).is_dir() else Path(source)
    arm = named_robot(str(path) if path.exists() else source, reading)
    tables = [load_table(one, any_encoding=True) for one in (poses, _table_in(joints)) if one is not None]
    told = [pose for table in tables if _has_poses(table, arm.robot) for pose in _told_poses(table)]
    values = [row for table in tables if not _has_poses(table, arm.robot) for row in _joints_in(table, arm.robot)]
    if joints is not None and _table_in(joints) is None:
        values.append(_typed_joints(joints, arm.robot))
    at = [_frames_at(arm, path, reading, q) for q in values]
    known = [one.name for one in (at[0] if at else ())]
    if at and frame is not None and frame not in known:
        raise CalibError(f"--frame {frame}: there is no such frame; there are {', '.join(known)}")
    chosen = [next(one for one in each if one.name == (frame or known[-1])) for each in at]
    if len(at) > 1:
        chosen = [replace(one, name=f"{one.name} at row {k + 1}") for k, one in enumerate(chosen)]
    return _compared(at[0] if len(at) == 1 else (), [*([one] for one in chosen), *told])


def _table_in(joints: str | None) -> Path | None:
    return Path(joints) if joints is not None and Path(joints).is_file() else None


def _has_poses(table: UserTable, robot: Robot) -> bool:
    joints = all(f"q{k + 1}" in recognise(table.columns, robot, {}).columns for k in range(robot.n_joints))
    return not joints and has_poses(table)


def _typed_joints(text: str, robot: Robot) -> Array:
    """Joint values (n,), rad and mm, of a text in degrees and mm."""
    try:
        values = np.array([float(one) for one in re.split(r"[,;\s]+", text.strip())])
    except ValueError:
        raise CalibError(f"--joints {text}: is no file, and no numbers such as 0,-90,90,0,90,0") from None
    if len(values) != robot.n_joints:
        raise CalibError(f"--joints {text}: has {len(values)} numbers; {robot.name} has {robot.n_joints} joints")
    return robot.joints_of(np.where(robot.is_revolute, np.radians(values), values))


def _joints_in(table: UserTable, robot: Robot) -> Array:
    """Joint values (N, n), rad and mm, of a table."""
    report = ImportReport(robot)
    joints = recognised(report, table, {}, positions=False)
    values = joint_values(report, joints)
    report.raise_all()
    assert values is not None
    units, _ = joint_units(robot, values, [joints.meant.columns[f"q{k + 1}"].unit for k in range(robot.n_joints)], None)
    return robot.joints_of(values * [SCALES[unit] for unit in units])


def _frames_at(arm: RobotFile, path: Path, reading: ReadOptions, q: Array) -> list[NamedFrame]:
    """Frames of an arm at joint values (n,): of a URDF those of its links, else those of the joints, and the tool's."""
    if arm.chain is None:
        chain = nominal_chain(arm.robot, q[None])
        names = ["base", *(joint.name for joint in arm.robot.joints), "flange", "tool"]
        last = chain.base_T_flange[0]
        each = [np.eye(4), *chain.base_T_frame[0, 1:-1], last @ arm.robot.flange.transform, chain.base_T_frame[0, -1]]
        return [NamedFrame(*one) for one in zip(names, each, strict=True)]
    moved = chain_frames(arm.chain, q[None])[0]
    if path.suffix.lower() != ".urdf":
        names = [*(joint.name for joint in arm.chain.joints), arm.chain.tip or "tip"]
        return [NamedFrame(*one) for one in zip(names, moved, strict=True)]
    links = read_arm(path, tip=reading.tip, base=reading.base)
    at, out = np.eye(4), [NamedFrame(links.base, np.eye(4))]
    following = iter(moved)
    for joint in links.joints:
        at = next(following) if joint.moves else at @ joint.parent_T_joint
        out.append(NamedFrame(joint.child, at))
    return out


# ---- told poses ----------------------------------------------------------------------------------------------------


def _told_poses(table: UserTable) -> list[list[NamedFrame]]:
    """Each pose of a table in every form that its numbers may have, the told or usual one first."""
    return [_readings(table.of_rows([row])) for row in range(len(table))]


def _readings(row: UserTable) -> list[NamedFrame]:
    """A pose by the forms and units that its row or its columns tell. Raises CalibError where it has none."""
    found = pose_columns(row.columns)
    used = () if found is None else (*found.place, *found.attitude)
    texts = [cell for name, cell in zip(row.columns, row.rows[0], strict=True) if name not in used and cell]
    words = re.findall(r"[^\W\d_]+", " ".join(texts).lower())
    if found is not None and len(found.attitude) == 3:
        length = next((f"_{word}" for word in words if word in LENGTHS_MM), "")
        angle = next((f"_{word}" for word in words if word in ANGLES_RAD), "")
        units = dict.fromkeys(found.place, length) | dict.fromkeys(found.attitude, angle)
        row = replace(row, columns=tuple(f"{name}{units.get(name, '')}" for name in row.columns))
    told = [form for form, names in _WORDS.items() if set(words).intersection(names.split())]
    name = texts[0] if texts else f"row {row.lines[0]}"
    readings = [
        NamedFrame(name, one.base_T_flange[0], one.form.partition(" are ")[2])
        for one in readings_of(row, any_form=True)
    ]
    return sorted(readings, key=lambda one: not any(form in one.form for form in told))


def _compared(arm: Sequence[NamedFrame], readings: Sequence[Sequence[NamedFrame]]) -> FramesTold:
    """Frames with the difference of two poses; read otherwise where only then their axes are parallel."""
    shown = tuple(each[0] for each in readings)
    if len(shown) != 2:
        return FramesTold(tuple(arm) or shown, shown)
    first, *others = (FrameDifference(one, other) for one, other in product(*readings))
    if not first.is_quarter_turn and others:
        best = min(others, key=lambda each: each.quarter_turn[1])
        first = replace(best, as_told=False) if best.is_quarter_turn else first
    return FramesTold(tuple(arm) or shown, shown, first)
