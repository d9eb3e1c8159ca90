"""Functions from a session to the next: a search, a fit, an effect added or removed, a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from calib.calibration.pose_errors import failure_of
from calib.calibration.result import Calibration
from calib.corners.batch import search_file
from calib.dataset.dataset import Dataset, without_poses
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.effect_selection import Added, calibrate_with, proposed, recalled
from calib.diagnosis.residual_tests import examine
from calib.diagnosis.screening import screen
from calib.diagnosis.stepwise import Diagnosis, Step, diagnose
from calib.effects.catalogue import effects_for
from calib.effects.effect import Family
from calib.errors import CalibError, DatasetError
from calib.fitting.observations import Observations
from calib.fitting.pose_residuals import require_orientations
from calib.identifiability.structural import redundancy
from calib.measurement.labels import FaceLabels
from calib.measurement.measured_points import label_faces
from calib.options import FitOptions
from inspector.session.session import HistoryStep, Session

GEOMETRY = "link errors"


def open_session(folder: Path) -> Session:
    """A session on a dataset folder. Raises DatasetError."""
    return Session(load_dataset(folder))


def with_search(session: Session, pose: int) -> Session:
    """Search the scan of one pose for its corner."""
    path = session.dataset.scan_path(pose)
    if path is None:
        raise DatasetError(f"dataset {session.dataset.name}: it has no scans to search")
    search = search_file(path, session.dataset.jig, session.dataset.scanner.scan_sigma_mm)
    searches = {**session.searches, session.dataset.poses.ids[pose]: search}
    if session.dataset.points is not None:
        return replace(session, searches=searches)
    return _unjudged(
        replace(session, searches=searches, face_labels=None, calibration=None, effects=(), history=())
    )


def with_names(session: Session) -> Session:
    """Name the jig's faces in the corners found so far, where nothing has yet; points.csv needs no names.

    Raises CornerError for face angles that no jig can have.
    """
    return replace(session, face_labels=face_names(session)) if session.unnamed else session


def face_names(session: Session) -> FaceLabels:
    """Which face of the jig is which in the corners found so far. Raises as `with_names`."""
    return label_faces(session.dataset, session.searches)


def no_full_poses(session: Session) -> str:
    """Why full poses cannot be fitted to what is known so far, in a sentence that says what would help; else ""."""
    measured = session.measured_for("pose")
    try:
        require_orientations(measured, Observations.of(measured))
    except CalibError as error:
        return str(error)
    return ""


def seen_since(session: Session, now: Session) -> Session:
    """A session of the same dataset, with what was looked at meanwhile."""
    return replace(session, searches=now.searches, face_labels=now.face_labels, redundancy=now.redundancy)


def with_redundancy(session: Session, residual: str = "position") -> Session:
    """Find which parameters say the same at the dataset's poses."""
    return replace(session, redundancy=redundancy(session.dataset, residual=residual))


def with_calibration(session: Session, residual: str = "position") -> Session:
    """Fit the five-parameter model, and the effects that were added, to what is measured so far."""
    session = with_names(session) if residual == "pose" else session
    asked = FitOptions() if session.calibration is None else session.calibration.options
    result = calibrate_with(session.measured_for(residual), session.effects, asked.with_residual(residual))
    label = session.history[-1].label if session.effects else GEOMETRY
    start = _nominal(result)
    history = (
        *(session.history[:-1] if session.effects else (start,)),
        _step(label, result, session.effects),
    )
    return _unjudged(replace(session, calibration=result, history=history))


def with_screening(session: Session) -> Session:
    """Hold every effect, the catalogue's and the user's own, against what the calibration left over; judge that."""
    return with_judgement(with_ranking(session))


def with_ranking(session: Session) -> Session:
    """The first half of `with_screening`: where the calibration is off, and what each effect would make of it."""
    calibration = _calibrated(session)
    screening = screen(calibration, (*effects_for(session.measured), *session.own))
    return replace(session, screening=screening, failure=failure_of(calibration), remains=None)


def with_judgement(session: Session) -> Session:
    """The second half: what is left over, judged; nothing new where that is known or nothing was ranked."""
    if session.screening is None or session.remains is not None:
        return session
    remains = examine(_calibrated(session).dataset, session.screening.leftover)
    return replace(session, remains=remains)


def with_own(session: Session, own: tuple[Family, ...]) -> Session:
    """The user's own effects as they are now. Those in the model are fitted again as they are now, or taken out."""
    ours = {family.name for family in (*session.own, *own)}
    session = replace(session, own=own, screening=None, diagnosis=None)
    if session.calibration is None or not any(added.name in ours for added in session.effects):
        return session
    kept: list[Added] = []
    for added in session.effects:
        try:
            again = added.name in ours
            kept.append(recalled(session.measured, added.name, added.sizes, own) if again else added)
        except CalibError:  # it is gone, or has other parameters: the ranking offers it anew
            continue
    return _changed(session, tuple(kept), "own effects read again")


def with_effect(session: Session, name: str) -> Session:
    """Add an effect as the screening proposes it, and fit everything together again."""
    if any(added.name == name for added in session.effects):
        raise CalibError(f"effect {name} is in the model already")
    return _changed(session, (*session.effects, proposed(session.screening, name)), f"+ {name}")


def without_effect(session: Session, name: str) -> Session:
    """Take an effect out of the model, and fit the rest again."""
    kept = tuple(added for added in session.effects if added.name != name)
    if len(kept) == len(session.effects):
        inside = ", ".join(added.name for added in session.effects) or "only the link errors"
        raise CalibError(f"effect {name} is not in the model; there is {inside}")
    return _changed(session, kept, f"− {name}")


def with_diagnosis(session: Session, on_step: Callable[[str], None] | None = None) -> Session:
    """Find what is missing from the link errors alone, to the end, and take the model that this leads to.

    `on_step` hears a line of words before each stage; what it raises ends the work.
    """
    return with_found(session, diagnose(session.measured, own=session.own, on_step=on_step))


def with_found(session: Session, found: Diagnosis) -> Session:
    """Take over a diagnosis of what is measured, and the model that it leads to."""
    first = found.steps[0].calibration
    start = _nominal(first)
    left_out = _left_out(session.measured, first.dataset)
    given = " + ".join([GEOMETRY, *first.model.family_names])
    steps = [
        replace(_step(f"+ {s.effect}" if s.effect else given, s.calibration, _inside(s)), left_out=left_out)
        for s in found.steps
    ]
    return replace(
        session,
        calibration=found.calibration,
        effects=_inside(found.steps[-1]),
        screening=found.steps[-1].screening,
        failure=failure_of(found.calibration),
        remains=found.remains,
        diagnosis=found,
        history=(start, *steps),
    )


def _inside(step: Step) -> tuple[Added, ...]:
    return tuple(Added.of(candidate) for candidate in step.inside)


def replayed(session: Session, steps: Sequence[HistoryStep]) -> Session:
    """The fits of a history once more, on what is measured now; figures in `steps` are not read."""
    fits: list[Calibration] = []
    last: tuple[Added, ...] = ()
    if any(step.residual == "pose" for step in steps[1:]):
        session = with_names(session)
    for step in steps[1:]:
        measured = session.measured_for(step.residual)
        dataset = without_poses(measured, step.left_out) if step.left_out else measured
        start = _from(fits[-1], last, step.effects) if fits else None
        fits.append(calibrate_with(dataset, step.effects, FitOptions(step.residual), start=start))
        last = step.effects
    if not fits:
        return session
    history = [
        replace(_step(step.label, fit, step.effects), left_out=step.left_out)
        for step, fit in zip(steps[1:], fits, strict=True)
    ]
    return _unjudged(
        replace(
            session,
            calibration=fits[-1],
            effects=steps[-1].effects,
            history=(_nominal(fits[0]), *history),
        )
    )


def _calibrated(session: Session) -> Calibration:
    if session.calibration is None:
        raise CalibError(f"dataset {session.dataset.name}: it is not calibrated yet")
    return session.calibration


def _changed(session: Session, effects: tuple[Added, ...], label: str) -> Session:
    before = _calibrated(session)
    start = _from(before, session.effects, effects)
    result = calibrate_with(session.measured, effects, before.options, start=start)
    history = (*session.history, _step(label, result, effects))
    return _unjudged(replace(session, calibration=result, effects=effects, history=history))


def _from(before: Calibration, old: tuple[Added, ...], new: tuple[Added, ...]) -> Calibration | None:
    """The fit to go on from: the one before where effects come, none where one goes, so that it ends where it began."""
    return before if len(new) > len(old) else None


def _unjudged(session: Session) -> Session:
    """A new fit, of which nothing more is known yet."""
    return replace(session, screening=None, failure=None, remains=None, diagnosis=None)


def _left_out(whole: Dataset, used: Dataset) -> tuple[str, ...]:
    """Measured poses of a dataset that a part of it has no points of."""
    assert whole.points is not None
    assert used.points is not None
    missing = set(whole.points.pose.tolist()) - set(used.points.pose.tolist())
    return tuple(whole.poses.ids[i] for i in sorted(missing))


def _nominal(result: Calibration) -> HistoryStep:
    return HistoryStep("nominal", *_errors(result, before=True), float("nan"))


def _step(label: str, result: Calibration, effects: tuple[Added, ...]) -> HistoryStep:
    return HistoryStep(label, *_errors(result), result.sigma_mm, effects, result.residual)


def _errors(result: Calibration, *, before: bool = False) -> tuple[float, float]:
    """3D RMSE of training and test poses, mm."""
    evaluation = result.before if before else result.after
    train, test = evaluation.train, evaluation.test
    return train.rmse_mm if train else float("nan"), test.rmse_mm if test else float("nan")
