"""Tab Corner: the intersection of the three faces, and its uncertainty."""

from __future__ import annotations

import viser

from inspector.markup.measure.corner import corner_html
from inspector.markup.parts import elements
from inspector.panels.base import Actions
from inspector.session.view import View

NOTE = (
    "The corner is where the three faces meet. Its uncertainty is drawn as an ellipsoid, enlarged so that it can be "
    "seen. Look for a long ellipsoid (a face seen edge-on) and for a face with few points or a large rms; "
    "Distances colours each point by how far it lies off its face."
)
TARGETS_NOTE = (
    "What was found of each target in this scan. Its uncertainty is drawn as an ellipsoid, enlarged so that it can be "
    "seen; the points that were taken for it have its colour. Look for a target with few points or a large rms."
)
POINTS_NOTE = (
    "The point was measured by another instrument (points.csv). Its uncertainty is drawn as an ellipsoid, enlarged so "
    "that it can be seen."
)
THIS, ALL, DISTANCES = "Show the corner", "Show all", "Distances"
POINT = "Show the point"
VIEW_OF = {THIS: "Corner", POINT: "Corner", ALL: "All corners", DISTANCES: "Distance"}


class CornerPanel:
    """Figures of the selected pose's corner."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._note = gui.add_html(elements.note(NOTE))
        self._show = gui.add_button_group("In 3D", (THIS, ALL, DISTANCES))
        self._show.on_click(lambda e: actions.show_view(VIEW_OF.get(e.target.value, "Corner")))
        self._content = gui.add_html("")

    def update(self, view: View) -> None:
        """Show the selected pose's corner."""
        has_scans = view.session.dataset.scan_folder is not None
        shown = (THIS, ALL, DISTANCES) if has_scans else (POINT, ALL)
        if shown != tuple(self._show.options):
            self._show.options = shown
        faces = view.session.dataset.shows_faces
        self._note.content = elements.note(POINTS_NOTE if not has_scans else NOTE if faces else TARGETS_NOTE)
        self._content.content = corner_html(view)
