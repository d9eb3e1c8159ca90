"""The file of `calibrate --hand-eye-out`: where the camera is, for ROS."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from calib.calibration.mount import CameraPlace, camera_places
from calib.calibration.result import Calibration
from calib.errors import CalibError
from calib.extras.camera.static_transform import StaticTransform, transform_text
from calib.present.fit.calibration import place_fact
from calib.rendering.blocks import Facts
from calib.rendering.text import block_text
from inspector.cli.additions import CalibrateAddition
from inspector.cli.options.fits import CalibrateOptions
from inspector.extras.camera.options import HandEyeOptions


class HandEyeFile(CalibrateAddition[HandEyeOptions, CalibrateOptions]):
    """The camera's place in the frame that is asked for, told and as a file for ROS."""

    def outputs(self) -> Iterable[Path | None]:
        """The file."""
        return [self.asked.hand_eye_out]

    def files(self, fit: Calibration) -> Mapping[Path, str | bytes]:
        """Text of the file. Raises CalibError for a fit that does not tell it."""
        path = self.asked.hand_eye_out
        return {} if path is None else {path: _text(self.asked, path, fit)}

    def told(self, fit: Calibration) -> tuple[Mapping[str, Any], str]:
        """The places of cameras, where another frame than the usual one is asked for."""
        places = _places(self.asked, fit)
        if not places or places[0].parent != "tip":
            return {}, ""
        facts = [place_fact(place, "camera at the tip, the end of robot.toml's tool row") for place in places]
        return {"hand_eye": places}, block_text(Facts(facts))


def _places(asked: HandEyeOptions, fit: Calibration) -> tuple[CameraPlace, ...]:
    """Places of the cameras in the frame that is asked for; () for a fit that does not tell them."""
    return tuple(
        place.from_tip(fit.dataset.robot) if place.parent == "flange" and asked.parent_at == "tip" else place
        for place in camera_places(fit)
    )


def _text(asked: HandEyeOptions, path: Path, fit: Calibration) -> str:
    places = _places(asked, fit)
    if not places:
        raise CalibError(f"--hand-eye-out {path}: the place and attitude of a camera need --residual pose")
    if places[0].parent != "base" and asked.parent_frame is None:
        raise CalibError(
            f"--hand-eye-out {path}: name the frame that carries the camera by --parent-frame NAME: your robot's name "
            "of the flange, such as tool0, or with --parent-at tip of the end of robot.toml's tool row"
        )
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
