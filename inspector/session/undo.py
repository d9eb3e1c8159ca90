"""Undo and redo of changes of the model, for each dataset."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from calib.errors import CalibError
from inspector.session.reopening import replayed
from inspector.session.session import Session, untested
from inspector.session.session_file import Saved, SavedModel
from inspector.session.transitions import without_ranking

UNDO_STEPS = 50  # changes that can be taken back
WHOLE = 8  # the last of them, which come back with their ranking; older ones are ranked again when they are gone to


@dataclass
class Undo:
    """Models of one dataset that undo and redo lead to; the last of each list is the next to be shown.

    Steps of a session file are fitted again when they are gone to.
    """

    past: list[Session | SavedModel] = field(default_factory=list)
    future: list[Session | SavedModel] = field(default_factory=list)

    @classmethod
    def of(cls, saved: Saved) -> Undo:
        """Undo after a session file was opened, which goes back along the model's steps."""
        counts = range(2, len(saved.history))[-UNDO_STEPS:]
        return cls([SavedModel(saved.history[:count]) for count in counts])

    def changed(self, before: Session) -> None:
        """Store the model before a change for undo, and clear redo."""
        if before.calibration is not None:
            self.past.append(before)
            del self.past[:-UNDO_STEPS]
            if len(self.past) > WHOLE:
                self.past[-WHOLE - 1] = _lean(self.past[-WHOLE - 1])
        self.future.clear()

    def move(self, now: Session, by: int) -> Session:
        """Session after a number of undo (negative) or redo steps, as far as there are any.

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


def _lean(entry: Session | SavedModel) -> Session | SavedModel:
    """Session without rankings, tests and versions, which can be computed again."""
    if isinstance(entry, SavedModel) or entry.diagnosis is not None:
        return entry
    return untested(replace(entry, steps=tuple(map(without_ranking, entry.steps))))
