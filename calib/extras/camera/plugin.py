"""What the extra brings: images and lens with a dataset, and what they tell of a fit and of a cell."""

from __future__ import annotations

from calib.calibration.doubts import LinkDoubt
from calib.dataset.attachments import Attachment
from calib.plugins import CalibrationPart
from calib.workcell.view_rules import ViewRule

_HERE = "calib.extras.camera"

CONTRIBUTIONS = (
    Attachment(
        "camera",
        load=f"{_HERE}.observed:load_camera",
        usual_residual="pose",
        instrument="camera",
        target="the board",
    ),
    LinkDoubt(f"{_HERE}.presentation:doubts"),
    CalibrationPart(
        "Reprojection",
        facts=f"{_HERE}.presentation:facts",
        figures=f"{_HERE}.presentation:figures",
        document=f"{_HERE}.presentation:document",
    ),
    ViewRule(f"{_HERE}.board_in_image:board_in_image"),
)
