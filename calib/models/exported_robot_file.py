"""A calibrated robot in the user's own URDF or kinematics YAML: the table best alone, and what it leaves out."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from calib.kinematics.robot import Robot
from calib.models.exported_table import ExportedTable
from calib.models.fitted_model import PROGRAM
from calib.robot_formats.calibrated_file import CalibratedFile, calibrated_urdf, calibrated_yaml


def exported_robot_file(table: ExportedTable, template: Path) -> CalibratedFile:
    """The template's text with the calibrated origins; in a URDF a comment says of what they are and how good.

    Raises RobotFileError where the template is not of the dataset's arm.
    """
    dataset = table.full.dataset
    names = ", ".join(table.left_out)
    comment = f"origins calibrated by {PROGRAM} {version(PROGRAM)} with dataset {dataset.name}: {table.error_words}"
    notes = []
    if names:
        notes.append(f"no origin holds {names}; these are the origins that are best without: {table.words}")
        comment += f"; without {names}, which no origin holds"
    return _written(template, table.robot, dataset.robot, comment).with_notes(notes)


def require_template_of(template: Path, robot: Robot) -> None:
    """Raise RobotFileError where a template cannot be read or is not of a robot's arm."""
    _written(template, robot, robot, "")


def _written(template: Path, calibrated: Robot, nominal: Robot, comment: str) -> CalibratedFile:
    if template.suffix.lower() in (".yaml", ".yml"):
        return calibrated_yaml(template, calibrated, nominal)
    return calibrated_urdf(template, calibrated, nominal, comment=comment)
