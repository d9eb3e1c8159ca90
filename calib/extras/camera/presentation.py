"""What a camera tells of a fit: how well its images are met, and whether arm or camera errs."""

from __future__ import annotations

from typing import Any

from calib.calibration.result import Calibration
from calib.extras.camera.arm_or_camera import ArmOrCamera, arm_or_camera
from calib.extras.camera.observed import camera_of
from calib.extras.camera.reprojection import ReprojectedView, reprojected_views, rms_px
from calib.rendering import numbers
from calib.rendering.blocks import FigurePlace


def facts(calibration: Calibration) -> list[tuple[str, object]]:
    """Facts on how well a camera's images are met, and whether arm or camera errs."""
    found: list[tuple[str, object]] = []
    reprojected = reprojected_views(calibration)
    if reprojected:
        found.append(("reprojection", _reprojection_words(calibration, reprojected)))
    asked = arm_or_camera(calibration)
    if asked is not None:
        found.append(("arm or camera", _words(asked)))
    return found


def figures(calibration: Calibration) -> list[FigurePlace]:
    """Place of the figure of the image that the fit meets worst; [] without images."""
    if not reprojected_views(calibration):
        return []
    caption = "Corners of the image that the fit meets worst, with arrows from where it puts them."
    return [FigurePlace("reprojection", (calibration,), caption, height_px=420)]


def document(calibration: Calibration) -> dict[str, Any]:
    """Keys of `calibrate --json` on reprojection, and on arm or camera."""
    views, asked = reprojected_views(calibration), arm_or_camera(calibration)
    size = {} if asked is None else {"board_size": asked.board_size, "board_size_sigma": asked.board_size_sigma}
    return {
        "reprojection": _reprojection_document(views) if views else None,
        "arm_or_camera": None if asked is None else {**asked.probabilities, **size},
    }


def doubts(calibration: Calibration) -> list[str]:
    """Sentence on a board or lens that is not as it was told, without capital; [] where it may be."""
    asked = arm_or_camera(calibration)
    taken_up = "which the fitted links take up: take neither them nor distances from this fit"
    if asked is not None and asked.board_is_off:
        told = f"by arm and camera the board is {_board_size_words(asked)}, {taken_up}"
        return [f"{told}; measure it and import it again."]
    if asked is not None and asked.camera_alone_errs:
        return [
            f"the camera's side errs, not the arm (probability {asked.probabilities['camera']:.2g}): its lens or the "
            f"board is not as it was told, {taken_up}; import without --intrinsics, or with those of this camera."
        ]
    return []


def _reprojection_words(calibration: Calibration, views: tuple[ReprojectedView, ...]) -> str:
    """Clause on the pixels between the corners and where the fit puts them."""
    camera = camera_of(calibration.dataset)
    assert camera is not None
    worst = max(views, key=lambda one: one.rms_px)
    each = zip(_fitted_and_test_px(views), ("fitted", "test"), strict=True)
    told = [f"{value:.3f} pixels at the {what} poses" for value, what in each if value]
    return (
        f"{' and '.join(told)} (RMS per coordinate; the corners' own noise is "
        f"{camera.sigma_px:.3f}), most at {worst.view.pose}, {worst.rms_px:.3f}"
    )


def _fitted_and_test_px(views: tuple[ReprojectedView, ...]) -> list[float | None]:
    return [rms_px(tuple(one for one in views if (one.role == "test") is is_test)) for is_test in (False, True)]


def _reprojection_document(views: tuple[ReprojectedView, ...]) -> dict[str, Any]:
    poses = [
        {"pose": one.view.pose, "role": one.role, "corners": len(one.predicted), "rms_px": one.rms_px} for one in views
    ]
    fitted, test = _fitted_and_test_px(views)
    return {"train_rms_px": fitted, "test_rms_px": test, "poses": poses}


_HARDLY = 0.005  # probability below which a hypothesis is not told
_WRONG = {
    "neither": "neither errs beyond the noise",
    "arm": "the arm errs",
    "camera": "the camera's side errs (lens, or the size of the board)",
    "both": "both err",
}


def _words(asked: ArmOrCamera) -> str:
    """Clause on how likely it is that the arm errs, the camera, both or neither."""
    ordered = sorted(asked.probabilities.items(), key=lambda one: -one[1])
    said = [f"{_WRONG[name]}: {numbers.probability(p)}" for name, p in ordered if p >= _HARDLY or name == ordered[0][0]]
    told = asked.likeliest in ("camera", "both") and abs(asked.board_size - 1.0) > 2.0 * asked.board_size_sigma
    return "; ".join([*said, *([f"the board is {_board_size_words(asked)}"] if told else [])])


def _board_size_words(asked: ArmOrCamera) -> str:
    """By how much a board is larger or smaller, such as "0.98 ± 0.12 % larger than it was told"."""
    off, sigma = 100.0 * (asked.board_size - 1.0), 100.0 * asked.board_size_sigma
    return f"{abs(off):.2f} ± {sigma:.2f} % {'larger' if off > 0.0 else 'smaller'} than it was told"
