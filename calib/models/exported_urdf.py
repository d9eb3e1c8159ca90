"""A calibrated robot in the user's own URDF: the table that is best alone, as origins, and what a URDF cannot hold."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from calib.models.exported_table import ExportedTable
from calib.models.fitted_model import PROGRAM
from calib.robot_formats.calibrated_file import CalibratedFile, calibrated_urdf


def exported_urdf(table: ExportedTable, template: Path) -> CalibratedFile:
    """The template's text with the calibrated origins; a comment in it says of what they are and how good.

    Raises RobotFileError where the template is not of the dataset's arm.
    """
    dataset = table.full.dataset
    comment = (
        f"origins calibrated by {PROGRAM} {version(PROGRAM)} with dataset {dataset.name}: {table.error_words}"
    )
    notes = []
    if table.left_out:
        names = ", ".join(table.left_out)
        notes.append(
            f"a URDF cannot hold {names}; the origins are those that are best without: {table.words}"
        )
        comment += f"; without {names}, which a URDF cannot hold"
    return calibrated_urdf(template, table.robot, dataset.robot, comment=comment).with_notes(notes)
