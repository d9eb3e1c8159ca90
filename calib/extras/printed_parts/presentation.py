"""Presentation of a part to print: its size, what it is for and how to use it."""

from __future__ import annotations

from typing import Any

from calib.extras.printed_parts.part import PrintedPart
from calib.present.results import keys_of
from calib.rendering.blocks import Block, Paragraph, Table

_USES = {
    "sockets": (
        "Bring a ball on the flange to rest in each socket from several sides and write down the joints, with the "
        "socket's x, y, z beside them; a column setup names where the plate stood. A print passes its own errors on to "
        "all lengths: measure the distances between the outer sockets and use those."
    ),
    "corner": (
        "Screw it to the flange, the apex away from the arm, and scan it. Print it matt, without supports, apex up; "
        "the angles of its faces are learned from the scans."
    ),
    "stem": (
        "Glue the ball into the cup and screw the stem to the flange. Where the ball is need not be known: the fit "
        "finds it."
    ),
}


def printed_part_blocks(part: PrintedPart, files: list[str]) -> list[Block]:
    """Blocks on a part: the files that hold it, its size, its points, and its use."""
    x, y, z = part.solid.extents
    fixed = f", for bolts {part.bolts} (ISO 9409-1)" if part.bolts else ""
    points = [(point.name, *(f"{value:.3f}" for value in point.xyz_mm)) for point in part.points]
    return [
        Paragraph(f"{', '.join(files)}: {x:.0f} x {y:.0f} x {z:.0f} mm, {part.solid.volume / 1e3:.0f} cm3{fixed}."),
        Table(("point", "x, mm", "y, mm", "z, mm"), points, left=(0,)),
        Paragraph(_USES[part.kind]),
    ]


def printed_part_document(part: PrintedPart, files: list[str]) -> dict[str, Any]:
    """A part with the keys of `jig --json`."""
    return {
        "files": files,
        **keys_of(part, "kind", "bolts", "points"),
        "size_mm": part.solid.extents,
        "volume_mm3": part.solid.volume,
        "use": _USES[part.kind],
    }
