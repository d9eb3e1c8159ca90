"""The model on show: its session, undo, and the tabs and the 3D scene that display it.

Runs on the worker's thread only.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.server.background import Background
from inspector.session import transitions as sessions
from inspector.session.planned import aims_of
from inspector.session.session import Session
from inspector.session.undo import Undo
from inspector.session.user_effects import UserEffects

T = TypeVar("T")


class ShownModel:
    """Session, undo and drawing shared by all controllers that change the model.

    redraw: draws the model in the 3D view and in the tab Compare; told whether it is the dataset's first.
    recount: shows which poses are left out; told of which that has changed.
    """

    def __init__(
        self,
        state: PageState,
        panels: Panels,
        user_effects: UserEffects,
        *,
        redraw: Callable[[bool], None],
        recount: Callable[[frozenset[str]], None],
    ) -> None:
        self.state, self.panels, self.user_effects = state, panels, user_effects
        self._redraw, self._recount = redraw, recount
        self._undo: dict[str, Undo] = {}  # by dataset
        self._background = Background("model")

    def close(self) -> None:
        """End the threads."""
        self._background.close()

    @property
    def session(self) -> Session:
        """The session on show."""
        return self.state.session

    @property
    def steps(self) -> Undo:
        """Undo and redo of the model on show."""
        return self._undo.setdefault(self.state.name, Undo())

    def forget_steps(self) -> None:
        """Clear undo and redo of the dataset on show."""
        self._undo.pop(self.state.name, None)

    def reopen_steps(self, steps: Undo) -> None:
        """Restore undo and redo from a saved session."""
        self._undo[self.state.name] = steps

    def show(self) -> None:
        """Redraw the tabs "What is missing" and "Where it fails"."""
        steps = self.steps
        self.panels.missing_effects.update(
            self.state.now, undo=len(steps.past), redo=len(steps.future), own=self.user_effects.problem
        )
        self.panels.residuals.update(self.state.now)
        self.panels.plan.offer(aims_of(self.session))
        self.panels.headline.doing(words="")

    def change(self, session: Session) -> None:
        """Show a changed model, and keep the previous model for undo."""
        self.steps.changed(self.session)
        self.replace(session)

    def replace(self, session: Session) -> None:
        """Show another model of the same dataset everywhere."""
        before = self.session
        self.state.keep(sessions.with_versions(session, before))
        self._redraw(before.calibration is None)
        if before.uncounted != session.uncounted:
            self._recount(before.uncounted ^ session.uncounted)
        self.panels.show_model(self.state.now)
        self.show()

    def beside(self, compute: Callable[[], T], started: Session) -> Generator[None, None, T | None]:
        """Long work that ends with the result of `compute`; None where the model was changed in the meantime."""

        def wanted() -> bool:
            now = self.session
            return now.calibration is started.calibration and now.dataset is started.dataset

        return self._background.run(compute, wanted)
