"""Undo and redo of changes of the model, for each dataset."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from inspector.session.session import Session, asked_out, untested
from inspector.session.transitions import with_steps, without_ranking

UNDO_STEPS = 50  # changes that can be taken back
WHOLE = 8  # the last of them, which come back with their ranking; older ones are ranked again when they are gone to


@dataclass
class Undo:
    """Models of one dataset that undo and redo lead to; the last of each list is the next to be shown."""

    past: list[Session] = field(default_factory=list)
    future: list[Session] = field(default_factory=list)

    @classmethod
    def of(cls, session: Session) -> Undo:
        """Undo after a session file was opened, which goes back along the model's steps."""
        counts = range(1, len(session.steps))[-UNDO_STEPS:]
        return cls([_after(session, count) for count in counts])

    def changed(self, before: Session) -> None:
        """Store the model before a change for undo, and clear redo."""
        if before.calibration is not None:
            self.past.append(before)
            del self.past[:-UNDO_STEPS]
            if len(self.past) > WHOLE:
                self.past[-WHOLE - 1] = _lean(self.past[-WHOLE - 1])
        self.future.clear()

    def move(self, now: Session, by: int) -> Session:
        """Session after a number of undo (negative) or redo steps, as far as there are any."""
        source, other = (self.past, self.future) if by < 0 else (self.future, self.past)
        count = min(abs(by), len(source))
        if count == 0:
            return now
        target = source[-count]
        other.append(now)
        other.extend(source[:-count:-1] if count > 1 else ())
        del source[-count:]
        return target


def _after(session: Session, count: int) -> Session:
    """Session as it was after a number of its steps."""
    steps = session.steps[:count]
    left_out = tuple(pose_id for pose_id in asked_out(steps[-1]) if pose_id not in session.dataset.left_out)
    return replace(with_steps(session, steps), left_out=left_out, searched=False)


def _lean(entry: Session) -> Session:
    """Session without rankings, tests and versions, which can be computed again."""
    if entry.diagnosis is not None:
        return entry
    return untested(replace(entry, steps=tuple(map(without_ranking, entry.steps))))
