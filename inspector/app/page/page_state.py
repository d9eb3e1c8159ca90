"""The page's state: the view, and the sessions of all datasets opened so far. For the worker's thread only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from calib.errors import DatasetError
from inspector.session.session import Session
from inspector.session.view import View


class PageState:
    """State shared by the controllers and the stage; code that changes it also redraws what depends on it."""

    def __init__(self, on_change: Callable[[View], None]) -> None:
        self._on_change = on_change  # told of every new view
        self.view: View | None = None  # none until a dataset is open
        self.name = ""  # of the dataset on show
        self._sessions: dict[str, Session] = {}  # by dataset, so that returning to one is immediate
        self._views: dict[str, View] = {}  # by dataset, as it was left

    @property
    def now(self) -> View:
        """The view on show. Raises DatasetError where no dataset is open."""
        if self.view is None:
            raise DatasetError("no dataset is open; choose one in the list at the top left")
        return self.view

    @property
    def session(self) -> Session:
        """The session on show. Raises as `now` does."""
        return self.now.session

    def known(self, name: str) -> Session | None:
        """Session of a dataset that was opened before; None for any other."""
        return self._sessions.get(name)

    def open(self, name: str, session: Session) -> None:
        """Show a dataset at its first pose, with the drawing settings of its last visit."""
        view = View(Session(session.dataset))
        if self.view is not None:
            self._views[self.name] = self.view
            view = self._views.get(name, view)
        first = replace(view, pose=0, joint=None, step=None, boxed=(), failures={})
        self.name, self.view = name, first.with_session(session)
        self._on_change(self.view)

    def keep(self, session: Session) -> None:
        """Replace the session of the dataset on show."""
        self.view = self.now.with_session(session)
        self._sessions[self.name] = session
        self._on_change(self.view)

    def change(self, **what: object) -> None:
        """Change fields of the view other than its session."""
        self.view = replace(self.now, **what)  # type: ignore[arg-type]
        self._on_change(self.view)
