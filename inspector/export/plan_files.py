"""The file of a plan: its poses as poses.csv."""

from __future__ import annotations

from pathlib import Path

from calib.errors import CalibError
from calib.planning.plan import Plan
from calib.text_files.csv_text import frame_csv


def check_plan_file(path: Path) -> None:
    """Raise CalibError for a file name that is not that of a table."""
    if path.suffix.lower() != ".csv":
        raise CalibError(f"{path}: a plan is written as .csv (poses.csv); the program that measures it by --program")


def planned_file(plan: Plan) -> str:
    """Content of poses.csv with a plan's poses."""
    return frame_csv(plan.to_frame())


def files_of_plan(path: Path, plan: Plan) -> dict[Path, str]:
    """A plan's file by its path."""
    return {path: planned_file(plan)}
