"""The file of `calibrate --hand-eye-out`: where the camera is, for ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from calib.calibration.mount import camera_places
from calib.calibration.result import Calibration
from calib.errors import CalibError
from calib.extras.camera.static_transform import StaticTransform, transform_text
from inspector.cli.additions import CalibrateAddition
from inspector.cli.options.fits import CalibrateOptions
from inspector.extras.camera.options import HandEyeOptions


class HandEyeFile(CalibrateAddition[HandEyeOptions, CalibrateOptions]):
    """The camera's place for ROS."""

    def outputs(self) -> Iterable[Path | None]:
        """The file."""
        return [self.asked.hand_eye_out]

    def files(self, fit: Calibration) -> Mapping[Path, str | bytes]:
        """Text of the file. Raises CalibError for a fit that does not tell it."""
        path = self.asked.hand_eye_out
        return {} if path is None else {path: _text(self.asked, path, fit)}


def _text(asked: HandEyeOptions, path: Path, fit: Calibration) -> str:
    places = camera_places(fit)
    if not places:
        raise CalibError(f"--hand-eye-out {path}: the place and attitude of a camera need --residual pose")
    on_flange = places[0].parent == "flange"
    if on_flange and asked.parent_frame is None:
        raise CalibError(
            f"--hand-eye-out {path}: name the frame that carries the camera by --parent-frame NAME: the one behind the "
            "last joint, or with --parent-at tip the tip link, such as tool0"
        )
    at_tip = on_flange and asked.parent_at == "tip"
    places = tuple(place.from_tip(fit.dataset.robot) for place in places) if at_tip else places
    parent = asked.parent_frame or "base_link"
    several = len(places) > 1
    transforms = [
        StaticTransform(
            parent,
            f"{asked.camera_frame}_{place.setup}" if several else asked.camera_frame,
            place.parent_T_camera,
            place.covariance,
        )
        for place in places
    ]
    return transform_text(path, transforms)
