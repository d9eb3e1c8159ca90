"""Tab Planes: sample sets, results of the filters, plane groups, and the three chosen as faces."""

from __future__ import annotations

import viser

from inspector.markup.measure.planes import planes_html
from inspector.markup.parts import elements
from inspector.panels.base import Actions
from inspector.session.view import View

NOTE = (
    "Each sample set is four points that may lie on one plane. Sets that pass all three filters join into plane "
    "groups; three groups, mutually perpendicular, become the jig's faces. Look for a face that is cut short, two "
    "groups on one face, or a face that sits on the flange."
)


class PlanesPanel:
    """Counts of sample sets and plane groups of the selected pose."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._note = gui.add_html(elements.note(NOTE))
        self._show = gui.add_button_group("In 3D", ("Show the planes",))
        self._show.on_click(lambda _: actions.show_view("Planes"))
        self._content = gui.add_html("")

    def update(self, view: View) -> None:
        """Show the selected pose's search."""
        self._show.visible = view.session.dataset.scan_folder is not None
        self._note.content = elements.note(NOTE) if self._show.visible else ""
        self._content.content = planes_html(view)
