"""What works for a tab that a plug-in brings, and what it may use of the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from inspector.app.page.page_state import PageState
from inspector.server.worker import Worker


@dataclass(frozen=True)
class Page:
    """What the controller of a tab may use: the datasets of the list by name, what is on show, and the worker."""

    folders: Mapping[str, Path]
    state: PageState
    worker: Worker


class TabController:
    """Base of what works for a tab: made with a `Page` and the tab's panel, it connects the panel's widgets.

    Widgets call back on any thread; what changes the page or reads its state is submitted to the worker.
    """

    def opened(self) -> None:
        """Show what belongs to the dataset that was just opened. Called on the worker's thread."""

    def model_shown(self) -> None:
        """Ask the worker for what is to be shown of the model that was just drawn."""

    def close(self) -> None:
        """End the threads of its own."""
