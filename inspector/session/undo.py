"""Undo and redo: the models before and after the one on show, of each dataset."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.errors import CalibError
from inspector.session.reopening import replayed
from inspector.session.session import Session
from inspector.session.session_file import Saved, SavedModel

UNDO_STEPS = 50  # changes that can be taken back; a session of a thousand poses holds some megabytes


@dataclass
class Undo:
    """The changes of one dataset's model that can be taken back or made again; the next is the last of each list.

    Those of a session file are fitted again when they are gone to.
    """

    past: list[Session | SavedModel] = field(default_factory=list)
    future: list[Session | SavedModel] = field(default_factory=list)

    @classmethod
    def of(cls, saved: Saved) -> Undo:
        """As a session file has it; one without undo has the steps of its history to go back by."""
        past = saved.past
        if not past and not saved.future:
            past = tuple(SavedModel(saved.history[:count]) for count in range(2, len(saved.history)))
        return cls(list(past[-UNDO_STEPS:]), list(saved.future[-UNDO_STEPS:]))

    def changed(self, before: Session) -> None:
        """A change was made; nothing that was taken back before can be made again."""
        if before.calibration is not None:
            self.past.append(before)
            del self.past[:-UNDO_STEPS]
        self.future.clear()

    def move(self, now: Session, by: int) -> Session:
        """The session so many changes back (below 0) or forward, as far as there are any.

        Raises CalibError where a saved model does not fit the dataset any more; it is forgotten then.
        """
        source, other = (self.past, self.future) if by < 0 else (self.future, self.past)
        count = min(abs(by), len(source))
        if count == 0:
            return now
        target = source[-count]
        if isinstance(target, SavedModel):
            try:
                target = replayed(now, target.history)
            except CalibError:
                del source[-count]
                raise
        other.append(now)
        other.extend(source[:-count:-1] if count > 1 else ())
        del source[-count:]
        return target
