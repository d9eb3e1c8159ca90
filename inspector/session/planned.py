"""Poses planned for the model on show."""

from __future__ import annotations

from dataclasses import dataclass

from calib.array_types import Array
from calib.errors import CalibError
from calib.planning.plan import Plan, criterion_of, plan_poses, task_of_diagnosis
from calib.planning.purpose import purposes
from calib.planning.start import FromFit
from calib.screening.blunders import without_blunders
from inspector.session.session import Session

_LIKELIEST = 5  # effects that may be planned for


@dataclass(frozen=True)
class Planned:
    """A plan, with the session that it was made for and the index of its selected pose."""

    plan: Plan
    session: Session
    pose: int | None = None

    def is_of(self, session: Session) -> bool:
        """Whether the plan was made for a session's current model."""
        return session.calibration is self.session.calibration

    @property
    def scanner_T_base(self) -> Array:
        """Pose (4, 4) of the base in the scanner's frame, of the setup in which the planned poses will be measured."""
        calibration = self.session.calibration
        assert calibration is not None
        return calibration.after.scanner_T_base[self.plan.start.setup]


def aims_of(session: Session) -> tuple[str, ...]:
    """Purposes that poses can be planned for (words of `plan --for`), the default first."""
    if session.calibration is None:
        return ()
    is_open = session.diagnosis is not None and bool(session.diagnosis.ambiguous_set)
    ranked = session.screening.candidates if session.screening is not None else ()
    likely = [c.name for c in ranked if c.members and not c.family.sparse][:_LIKELIEST]
    inside = [effect.name for effect in session.effects if effect.members]
    of_open = [purpose.name for purpose in purposes().values() if purpose.of_diagnosis and is_open]
    of_any_fit = [purpose.name for purpose in purposes().values() if purpose.criterion]
    return (*of_open, *of_any_fit, *dict.fromkeys([*inside, *likely]))


def planned_for(session: Session, aim: str, count: int, payload_kg: float | None) -> Planned:
    """Plan of the next poses for the model on show. Raises CalibError where none can be planned."""
    if session.calibration is None:
        raise CalibError(f"dataset {session.dataset.name}: calibrate first, then the next poses can be planned")
    purpose = purposes().get(aim)
    if purpose is not None and purpose.of_diagnosis:
        if session.diagnosis is None:
            raise CalibError(f"dataset {session.dataset.name}: find what is missing first; nothing is open yet")
        task = task_of_diagnosis(purpose, session.diagnosis, count, payload_kg)
        return Planned(plan_poses(task.start, task.count, criterion=task.criterion), session)
    criterion = criterion_of(aim, payload_kg=payload_kg if purpose is None else None)
    start = FromFit(without_blunders(session.calibration))
    return Planned(plan_poses(start, count, criterion=criterion, user_effects=session.user_effects), session)
