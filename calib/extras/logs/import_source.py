"""Recordings among a user's files."""

from __future__ import annotations

from pathlib import Path

from calib.dataset_import.user_files import BOTH, JOINTS, POINTS, UNUSED, UserFile
from calib.errors import CalibError
from calib.extras.logs.bags import is_bag, kinds_in_bag
from calib.extras.logs.table_logs import describe, is_always_log


def is_recorded(path: Path) -> bool:
    """Whether a path is of a form that only recordings have."""
    return is_bag(path) or is_always_log(path)


def judged(path: Path) -> UserFile:
    """A bag, or another recording, with what it holds."""
    what, by, kinds_in = ("a bag", "topics", kinds_in_bag) if is_bag(path) else ("a recording", "columns", describe)
    try:
        joints, points = kinds_in(path)
    except CalibError as error:
        return UserFile(path, UNUSED, str(error).removeprefix(f"{path}: "))
    if not joints and not points:
        return UserFile(path, UNUSED, f"{what} without joints and points")
    return UserFile(path, BOTH if joints and points else JOINTS if joints else POINTS, f"{what}, by its {by}")
