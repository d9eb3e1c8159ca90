"""The headline above the 3D view: the arm's error, completed steps and the next one."""

from __future__ import annotations

from dataclasses import replace

import viser

from inspector.markup.headline import headline_html, looks_html
from inspector.session.loop import IDLE, TaskStatus
from inspector.session.view import View


class HeadlinePanel:
    """The headline as one piece of HTML, sent only after a change."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html("")
        gui.add_html(f'<div data-over-view="looks">{looks_html()}</div>')
        self._sent = ""
        self._doing: TaskStatus = IDLE
        self._view: View | None = None

    def update(self, view: View) -> None:
        """Show the session and the version of its model on show."""
        before, self._view = self._view, view
        # Another pose changes nothing.
        if before is None or before.session is not view.session or before.shown_step != view.shown_step:
            self._show()

    def opening(self, name: str) -> None:
        """Clear the figures of the dataset before while another is opened."""
        self._view, self._doing = None, TaskStatus(words=f"Opening {name} …")
        self._show()

    def still(self, view: View | None) -> None:
        """Show the session that stays on show where another cannot be opened; None where there is none."""
        self._view, self._doing = view, IDLE
        self._show()

    def doing(self, **what: bool | str) -> None:
        """Set the task that the program is working on (fields of `TaskStatus`)."""
        doing = replace(self._doing, **what)  # type: ignore[arg-type]
        if doing != self._doing:
            self._doing = doing
            self._show()

    def _show(self) -> None:
        content = f'<div data-over-view="headline">{headline_html(self._view, self._doing)}</div>'
        if content != self._sent:
            self._sent = content
            self._html.content = content
