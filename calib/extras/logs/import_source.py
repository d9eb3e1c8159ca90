"""Recordings among a user's files, and as tables of a row a pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from calib.dataset_import.plan import ImportSources
from calib.dataset_import.user_files import BOTH, JOINTS, POINTS, UNUSED, UserFile
from calib.errors import CalibError
from calib.extras.logs.bags import is_bag, kinds_in_bag
from calib.extras.logs.recorded_stops import recorded_poses
from calib.extras.logs.table_logs import describe, is_always_log


def is_recorded(path: Path) -> bool:
    """Whether a path is of a form that only recordings have."""
    return is_bag(path) or is_always_log(path)


def judged(path: Path) -> UserFile:
    """A bag, or another recording, with what it holds."""
    try:
        joints, points = kinds_in_bag(path) if is_bag(path) else describe(path)
    except CalibError as error:
        return UserFile(path, UNUSED, str(error).removeprefix(f"{path}: "))
    what = "a bag" if is_bag(path) else "a recording"
    if not joints and not points:
        return UserFile(path, UNUSED, f"{what} without joints and points")
    kind = BOTH if joints and points else JOINTS if joints else POINTS
    return UserFile(path, kind, f"{what}, by its {'topics' if is_bag(path) else 'columns'}")


def with_recorded_poses(sources: ImportSources) -> ImportSources:
    """Sources with tables in place of recordings, a row a pose at which the arm stood. Raises DatasetError."""
    assert sources.joints is not None
    robot = sources.robots[0].robot.robot
    found = recorded_poses(robot, sources.joints, sources.points, sources.mapping)
    points = sources.points or sources.joints.with_name(f"{sources.joints.name} (points)")
    tables = {sources.joints: found.joints} | (
        {} if found.points is None else {points: replace(found.points, path=points)}
    )
    return replace(
        sources, points=points, tables=tables, notes=found.notes, doubts=found.doubts, mapping=found.mapping,
        joint_unit_is_unknown=found.unit_is_unknown,
    )  # fmt: skip
