"""Undo and redo: the sessions before and after the one on show, of each dataset."""

from __future__ import annotations

from dataclasses import dataclass, field

from inspector.session.session import Session


@dataclass
class Undo:
    """The changes of one dataset's model that can be taken back or made again."""

    past: list[Session] = field(default_factory=list)
    future: list[Session] = field(default_factory=list)

    def changed(self, before: Session) -> None:
        """A change was made; nothing that was taken back before can be made again."""
        if before.calibration is not None:
            self.past.append(before)
        self.future.clear()

    def move(self, now: Session, by: int) -> Session:
        """The session so many changes back (below 0) or forward, as far as there are any."""
        source, other = (self.past, self.future) if by < 0 else (self.future, self.past)
        for _ in range(min(abs(by), len(source))):
            other.append(now)
            now = source.pop()
        return now
