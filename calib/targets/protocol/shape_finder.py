"""Kind of a plug-in that brings the finder of a target's shape."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ShapeFinder:
    """The finder of targets of one shape of `calib.target_shapes`, in place of a built-in one where there is one."""

    shape: str  # name of the shape's class: "Plate"
    finder: str  # "module:name" of a `TargetFinder`
