"""Presentation of a part to print: its size, what it is for and how to use it."""

from __future__ import annotations

from typing import Any

from calib.extras.printed_parts.part import PrintedPart
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
    """Blocks on a part: the files that hold it, its sizes, its points, and its use."""
    x, y, z = part.solid.extents
    cubic_cm = part.solid.volume / 1e3
    fixed = f", for bolts {part.bolts} (ISO 9409-1)" if part.bolts else ""
    sizes = [
        (name.rpartition("_")[0].replace("_", " "), f"{value:.2f}", _unit(name)) for name, value in part.sizes.items()
    ]
    points = [(point.name, *(f"{value:.3f}" for value in point.xyz_mm)) for point in part.points]
    return [
        Paragraph(f"{', '.join(files)}: {x:.0f} x {y:.0f} x {z:.0f} mm, {cubic_cm:.0f} cm3{fixed}."),
        Table(("size", "", "unit"), sizes, left=(0, 2)),
        Table(("point", "x, mm", "y, mm", "z, mm"), points, left=(0,)),
        Paragraph(_USES[part.kind]),
    ]


def _unit(name: str) -> str:
    return "°" if name.endswith("_deg") else "mm"


def printed_part_document(part: PrintedPart, files: list[str]) -> dict[str, Any]:
    """A part with the keys of `jig --json`."""
    return {
        "kind": part.kind,
        "files": files,
        "bolts": part.bolts,
        "size_mm": part.solid.extents.tolist(),
        "volume_mm3": part.solid.volume,
        "triangles": len(part.solid.faces),
        "sizes": dict(part.sizes),
        "points": [{"name": point.name, "xyz_mm": list(point.xyz_mm)} for point in part.points],
        "use": _USES[part.kind],
    }
