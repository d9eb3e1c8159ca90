"""Presentation of a place to which the tool is brought: the arm's error there as delivered, joints, trained ranges."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.compensation.tool_place import ToolPlace
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Paragraph, Presentation, Verdict, joint, listed, pose, spans
from calib.rendering.colours import BAD, DOUBT, GOOD


@presentation.register
def _tool_place(place: ToolPlace) -> Presentation:
    return Presentation("The tool at a place", tool_place_blocks(place))


def tool_place_blocks(place: ToolPlace) -> list[Block]:
    """Blocks on a place of the tool: whether it is reached, the error there, and whether the joints were trained."""
    if place.error is None:
        missed = numbers.length(place.missed_mm)
        turned = "" if place.missed_rad < np.radians(0.5) else f" and {numbers.size(place.missed_rad, 'rad')}"
        return [
            Verdict(f"This place cannot be reached: the nearest posture found misses it by {missed}{turned}.", BAD),
            Paragraph("Drag the tool back, or turn it: joints stay within their limits.", soft=True),
        ]
    length, sigma = float(place.error.length_mm[0]), float(place.error.sigma_mm[0])
    said = f"As delivered the arm is off by {numbers.with_sigma(length, sigma, 'mm')} here."
    spread = np.sqrt(np.maximum(np.diagonal(place.error.covariance_mm2[0]), 0.0))
    parts = [
        (f"{axis} of the base, mm", numbers.with_sigma(float(value), float(s), sign=True))
        for axis, value, s in zip("xyz", place.error.error_mm[0], spread, strict=True)
    ]
    return [
        Verdict(said, DOUBT if place.outside else GOOD),
        Facts(parts),
        _ranges(place),
        Facts([("joints", " · ".join(_joint_values(place)))]),
        Paragraph(
            spans(
                "Delivered minus calibrated model; ± is one standard deviation by the fitted parameters and what the "
                "model is known to miss, without noise. Payload and other conditions as at pose ",
                pose(place.like), ".",
            ),
            soft=True,
        ),
    ]  # fmt: skip


def _ranges(place: ToolPlace) -> Block:
    if not place.outside:
        return Paragraph("All joints are within the ranges that were trained.")
    one = len(place.outside) == 1
    return Paragraph(
        spans(
            "Outside the trained ranges: ", listed([joint(i + 1, f"joint {i + 1}") for i in place.outside]),
            f". The model is not confirmed there, and the error may be larger than {'its' if one else 'the'} ± says.",
        )
    )  # fmt: skip


def _joint_values(place: ToolPlace) -> list[str]:
    turns = place.calibration.dataset.robot.is_revolute
    return [
        numbers.signed(float(np.degrees(value) if turning else value), ".1f") + ("°" if turning else " mm")
        for value, turning in zip(place.q, turns, strict=True)
    ]


@document.register
def _document(place: ToolPlace) -> dict[str, Any]:
    error = place.error
    return {
        "reached": place.reached,
        "missed_mm": place.missed_mm,
        "missed_rad": place.missed_rad,
        "q": place.q,
        "like_pose": place.like,
        "error_mm": None if error is None else error.error_mm[0],
        "length_mm": None if error is None else float(error.length_mm[0]),
        "sigma_mm": None if error is None else float(error.sigma_mm[0]),
        "joints_outside": [i + 1 for i in place.outside],
    }
