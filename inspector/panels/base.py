"""Common parts of all panels: the requests that they may make, and helpers for widgets."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Literal, Protocol

import viser

from inspector.session.view import View

SECONDARY: Literal["gray"] = "gray"
"""Colour of every button but a view's main one; server/client/page.css outlines it."""


class Actions(Protocol):
    """Requests that a widget may send. Each call returns at once; the work is done in order on the app's one thread."""

    def open(self, name: str) -> None: ...
    def open_again(self) -> None: ...
    def select(self, pose: int) -> None: ...
    def step(self, by: int) -> None: ...
    def show_view(self, name: str) -> None: ...
    def keep_view(self, keep: bool) -> None: ...
    def look_from(self, side: str) -> None: ...
    def layer(self, name: str, visible: bool) -> None: ...
    def factor(self, factor: float) -> None: ...
    def search(self, go_on: bool) -> None: ...
    def redundancy(self, residual: str) -> None: ...
    def calibrate(self, residual: str) -> None: ...
    def find(self, start: bool) -> None: ...
    def candidate(self) -> None: ...
    def follow(self) -> None: ...
    def add_effect(self, name: str) -> None: ...
    def remove_effect(self, name: str) -> None: ...
    def move(self, by: int) -> None: ...
    def leave_out(self, pose_id: str, out: bool) -> None: ...
    def leave_out_poses(self, pose_ids: Sequence[str]) -> None: ...
    def new_setup(self, pose_id: str) -> None: ...
    def failure(self) -> None: ...
    def select_id(self, pose_id: str) -> None: ...
    def arrows(self, factor: float | None) -> None: ...
    def version(self, name: str) -> None: ...
    def between(self, share: float) -> None: ...
    def box(self, is_in_box: None) -> None: ...
    def beside(self) -> None: ...
    def plan(self) -> None: ...
    def settle(self) -> None: ...
    def take_plan(self, what: str, client: viser.ClientHandle) -> None: ...
    def take(self, what: str, client: viser.ClientHandle) -> None: ...


class FollowsModel(ABC):
    """A panel about the model on show, refreshed whenever another model or version is shown."""

    @abstractmethod
    def update(self, view: View) -> None:
        """Show the model of a view."""


def on_page(handle: Any, then: Callable[[Any], None]) -> None:
    """Have a function called with a widget's value when a page changes it, not when this program does.

    Viser calls back for both.
    """
    handle.on_update(lambda event: None if event.client_id is None else then(event.target.value))


def put(handle: Any, value: Any) -> None:
    """Set a widget's value, which viser's annotations declare read-only."""
    handle.value = value


class ChangedValues:
    """Setter of a widget's value that sends only values different from the last one.

    A page may just have chosen something else whose turn is still to come: that must not be taken back.
    """

    def __init__(self) -> None:
        self._last: dict[int, Any] = {}  # by widget

    def put(self, handle: Any, value: Any) -> None:
        """Set a value, unless it equals the last one."""
        if self._last.get(id(handle)) != value:
            self._last[id(handle)] = value
            put(handle, value)


class ChosenByDataset:
    """Memory of a widget's choice for each dataset, so that the choice does not carry over to another dataset."""

    def __init__(self, handle: Any, default: Any) -> None:
        self._handle, self._default = handle, default
        self._dataset = ""
        self._chosen: dict[str, Any] = {}

    def open(self, dataset: str) -> Any:
        """Choice made when this dataset was last on show, else the default; the current choice is stored."""
        self._chosen[self._dataset] = self._handle.value
        self._dataset = dataset
        return self._chosen.get(dataset, self._default)


def relist(handle: Any, options: tuple[str, ...]) -> bool:
    """Set the options of a list or a row of buttons where they differ; whether they did."""
    differ = options != tuple(handle.options)
    if differ:
        handle.options = options
    return differ


def offer(handle: Any, options: tuple[str, ...]) -> None:
    """Set the options of a list; the current choice is kept if it is still among them."""
    before = str(handle.value)
    if relist(handle, options):
        put(handle, before if before in options else options[0])


def hidden_plot(gui: viser.GuiApi, aspect: float, name: str) -> viser.GuiPlotlyHandle:
    """Plot widget that stays hidden until it has a figure; `aspect`: height over width; `name`: of its image file.

    The wheel zooms with Ctrl alone, or in the enlarged figure: server/client/plots.js sees to it.
    """
    import plotly.graph_objects as go

    config = {
        "displayModeBar": False, "scrollZoom": True, "doubleClickDelay": 500,
        "toImageButtonOptions": {"filename": name},
    }  # fmt: skip
    return gui.add_plotly(go.Figure(), aspect=aspect, visible=False, config=config)
