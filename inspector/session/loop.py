"""The four steps of the work (measure, fit, find, take away), and a session's progress through them."""

from __future__ import annotations

from dataclasses import dataclass

from inspector.session.session import Session

MEASURE, FIT, FIND, TAKE = "Measure", "Fit", "Find", "Take away"
STEPS = (MEASURE, FIT, FIND, TAKE)


@dataclass(frozen=True)
class TaskStatus:
    """The program's current task, as far as it does not follow from the session."""

    searching: bool = False  # scan after scan
    finding: bool = False  # the whole diagnosis
    words: str = ""  # what is being done, as the page says it
    problem: str = ""  # why there is no fit
    leads: bool = False  # whether the page opens the tab of each next step up to the verdict


IDLE = TaskStatus()


@dataclass(frozen=True)
class Progress:
    """The steps that a session has done, and the next one."""

    done: frozenset[str]  # of STEPS
    next: str  # of STEPS: what is being done, or what leads on

    @classmethod
    def of(cls, session: Session, doing: TaskStatus = IDLE) -> Progress:
        """The progress of a session, counted for the model on show."""
        done = []
        if session.is_measured:
            done.append(MEASURE)
        if session.calibration is not None:
            done.append(FIT)
        if session.diagnosis is not None and not doing.finding:
            done.append(FIND)
        return cls(frozenset(done), next(step for step in STEPS if step not in done))
