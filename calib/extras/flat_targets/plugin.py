"""What the extra brings: finders of a plate's corner and of sets of planes."""

from __future__ import annotations

from calib.targets.protocol.shape_finder import ShapeFinder

CONTRIBUTIONS = (
    ShapeFinder("Plate", "calib.extras.flat_targets.plate_corner:find_plate_corner"),
    ShapeFinder("PlaneSet", "calib.extras.flat_targets.plane_set:find_plane_set"),
)
