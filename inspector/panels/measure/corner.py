"""Tab Corner: position, covariance, faces and angles of the corner, or what was found of other targets."""

from __future__ import annotations

import numpy as np
import viser

from calib.present.fit.corners import doubt_blocks, place_table, scan_blocks, search_blocks
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Folded, Paragraph, Verdict
from calib.rendering.colours import BAD
from calib.rendering.html import panel
from calib.targets.search import ScanSearch
from inspector.markup.parts.palette import FACE_COLOURS
from inspector.panels.base import Actions, relist
from inspector.session.view import View, corner_of

NOTE = "Look for a long ellipsoid (a face seen edge-on), and for a face with few points or a large rms."
TARGETS_NOTE = "The points taken for a target have its colour. Look for one with few points or a large rms."
UNKNOWN = "not known: no covariance in points.csv, no point_sigma_mm in dataset.toml"
THIS, ALL, DISTANCES = "Show the corner", "Show all", "Distances"
POINT = "Show the point"
VIEW_OF = {THIS: "Corner", POINT: "Corner", ALL: "All corners", DISTANCES: "Distance"}


class CornerPanel:
    """Figures of the selected pose's corner."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._show = gui.add_button_group("In 3D", (THIS, ALL, DISTANCES))
        self._show.on_click(lambda e: actions.show_view(VIEW_OF.get(e.target.value, "Corner")))
        self._content = gui.add_html("")

    def update(self, view: View) -> None:
        """Show the selected pose's corner."""
        has_scans = view.session.dataset.scan_folder is not None
        shown = (THIS, ALL, DISTANCES) if has_scans else (POINT, ALL)
        relist(self._show, shown)
        self._content.content = corner_html(view)


def corner_html(view: View) -> str:
    """HTML of the whole tab Corner for one pose."""
    return panel([Paragraph(f"Pose {view.pose_id}", heading=True), *_corner_blocks(view)])


def _corner_blocks(view: View) -> list[Block]:
    found, search = corner_of(view, view.pose), view.search
    if found is None:
        if search is not None and search.failure:
            return [Verdict(f"{'Not found' if isinstance(search, ScanSearch) else 'No corner'}: {search.failure}", BAD)]
        waiting = view.session.dataset.scan_path(view.pose) is not None
        return [_note("This scan has not been searched yet." if waiting else "Nothing was measured here.")]
    xyz, covariance = found
    corner = None if search is None else search.corner
    facts: list[tuple[str, object]] = [
        ("at x, y, z", f"{', '.join(map(numbers.coordinate, xyz))} mm"),
        ("sigma, 3D", UNKNOWN if covariance is None else numbers.length(float(np.sqrt(np.trace(covariance))))),
    ]
    if corner is not None:
        facts.append(("rms of the faces", ", ".join(numbers.length(face.rms_mm) for face in corner.faces)))
    return [
        *([] if corner is None else doubt_blocks(corner)),
        Facts(facts),
        *(scan_blocks(search, _names(view), FACE_COLOURS) if isinstance(search, ScanSearch) else []),
        _note(NOTE if corner is not None else TARGETS_NOTE if search is not None else ""),
        *(
            []
            if search is None or corner is None
            else [Folded("How well it is seen", search_blocks(search, FACE_COLOURS))]
        ),
        Folded("Sigma along each axis", [place_table(xyz, covariance)]),
    ]


def _note(words: str) -> Paragraph:
    return Paragraph(words, soft=True)


def _names(view: View) -> dict[tuple[float, ...], str]:
    """Names of the selected pose's points by place; equal targets are identified from all poses together."""
    points = view.session.measured.points
    if points is None:
        return {}
    rows = np.flatnonzero(points.pose == view.pose)
    return {tuple(points.xyz_mm[row]): str(points.target[row]) for row in rows}
