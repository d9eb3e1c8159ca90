"""Functions from a session to the next: a search, a fit, an effect added or removed, a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from calib.calibration.model_versions import versions
from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.result import Calibration
from calib.corners.batch import search_file
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.advice import advise, asks_for_curves
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.effect_selection import (
    GEOMETRY,
    FitStep,
    SelectedEffect,
    calibrate_with,
    curves_beside,
    curves_to_add,
    proposed,
    recalled,
    selected_curves,
)
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import effects_for
from calib.effects.effect import Family
from calib.errors import CalibError, DatasetError
from calib.fitting.observations import Observations
from calib.fitting.pose_residuals import require_orientations
from calib.identifiability.structural import redundancy
from calib.measurement.labels import FaceLabels
from calib.measurement.measured_points import label_faces
from calib.options import FitOptions
from calib.screening.candidates import screen
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.pose_recommendation import discriminating_poses, nearest_rival
from calib.screening.residual_tests import run_residual_tests
from inspector.session.session import Separation, Session

SEPARATING_POSES = 3  # at which two causes are compared


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
    return _untested(
        replace(session, searches=searches, face_labels=None, calibration=None, effects=(), steps=())
    )


def with_face_labels(session: Session) -> Session:
    """Label the jig's faces in the corners found so far, where that is not done yet; points.csv needs no labels.

    Raises CornerError for face angles that no jig can have.
    """
    return replace(session, face_labels=find_face_labels(session)) if session.unlabelled else session


def find_face_labels(session: Session) -> FaceLabels:
    """Which face of the jig is which in the corners found so far. Raises as `with_face_labels`."""
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
    """Find which parameters act alike at the dataset's poses."""
    return replace(session, redundancy=redundancy(session.dataset, residual=residual))


def with_calibration(session: Session, residual: str = "position") -> Session:
    """Fit the five-parameter model, and the effects that were added, to what is measured so far."""
    session = with_face_labels(session) if residual == "pose" else session
    asked = FitOptions() if session.calibration is None else session.calibration.options
    result = calibrate_with(session.measured_for(residual), session.effects, asked.with_residual(residual))
    before, label = (session.steps[:-1], session.steps[-1].label) if session.effects else ((), GEOMETRY)
    return with_steps(session, (*before, FitStep(label, session.effects, result)))


def with_screening(session: Session) -> Session:
    """Test every effect, the catalogue's and the user's, against the calibration's residual; then test that itself."""
    return with_residual_tests(with_ranking(session))


def with_ranking(session: Session) -> Session:
    """The first half of `with_screening`: where the calibration is off, and what each effect would make of it."""
    calibration = _calibrated(session)
    screening = screen(calibration, (*effects_for(session.measured), *session.user_effects))
    pose_errors = pose_errors_of(calibration)
    return replace(
        session,
        screening=screening,
        pose_errors=pose_errors,
        residual_tests=None,
        curves=None,
        advice=None,
        separations={},
    )


def with_residual_tests(session: Session) -> Session:
    """The second half: tests of the residual, curves where no named effect explains it, and advice.

    Nothing new where they are known or nothing was ranked.
    """
    if session.screening is None or session.residual_tests is not None:
        return session
    calibration, screening = _calibrated(session), session.screening
    tests = run_residual_tests(calibration.dataset, screening.projected)
    curves = curves_beside(calibration, tests.fault) if asks_for_curves(screening, tests) else None
    return replace(session, residual_tests=tests, curves=curves, advice=advise(screening, tests, curves))


def separation(session: Session, name: str) -> Separation | None:
    """The poses at which a candidate and its nearest rival differ most; None where it is none or has no rival.

    Raises CalibError where there are too few poses to fit either one whole.
    """
    screening = session.screening
    if screening is None:
        return None
    chosen = next((candidate for candidate in screening.candidates if candidate.name == name), None)
    rival = nearest_rival(screening, name)
    if chosen is None or rival is None:
        return None
    poses = discriminating_poses(_calibrated(session), (chosen, rival), count=SEPARATING_POSES)
    return Separation(rival.name, poses)


def with_versions(session: Session, before: Session) -> Session:
    """The model's versions side by side, where the session has a model.

    With effects in the model the link errors alone are fitted to the same points, unless the session `before` has that
    fit already.
    """
    if session.calibration is None or session.versions:
        return session
    return replace(session, versions=versions(session.calibration, before.links_alone))


def with_user_effects(session: Session, effects: tuple[Family, ...]) -> Session:
    """The user's own effects as they are now. Those in the model are fitted again as they are now, or taken out."""
    ours = {family.name for family in (*session.user_effects, *effects)}
    session = replace(session, user_effects=effects, screening=None, separations={}, diagnosis=None)
    if session.calibration is None or not any(added.name in ours for added in session.effects):
        return session
    kept: list[SelectedEffect] = []
    for added in session.effects:
        try:
            again = added.name in ours
            kept.append(
                recalled(session.measured, added.name, added.prior_sigmas, effects) if again else added
            )
        except CalibError:  # it is gone, or has other parameters: the ranking offers it anew
            continue
    return _changed(session, tuple(kept), "own effects read again")


def with_effect(session: Session, name: str) -> Session:
    """Add an effect as the screening proposes it, or the curves that were learned, and fit everything again."""
    if any(added.name == name for added in session.effects):
        raise CalibError(f"effect {name} is in the model already")
    if name != LEARNED:
        added = proposed(session.screening, name)
    elif session.curves is not None:
        added = selected_curves(session.curves)
    else:
        added = curves_to_add(_calibrated(session))
    return _changed(session, (*session.effects, added), f"+ {name}")


def without_effect(session: Session, name: str) -> Session:
    """Take an effect out of the model, and fit the rest again."""
    kept = tuple(added for added in session.effects if added.name != name)
    if len(kept) == len(session.effects):
        inside = ", ".join(added.name for added in session.effects) or "only the link errors"
        raise CalibError(f"effect {name} is not in the model; there is {inside}")
    return _changed(session, kept, f"− {name}")


def with_diagnosis(session: Session, on_step: Callable[[str], None] | None = None) -> Session:
    """Find what is missing from the link errors alone, to the end, and take the model that this leads to.

    `on_step` is called with a line of text before each stage; what it raises ends the work.
    """
    return with_found(session, diagnose(session.measured, user_effects=session.user_effects, on_step=on_step))


def with_found(session: Session, found: Diagnosis) -> Session:
    """Take over a diagnosis of what is measured, and the model that it leads to."""
    return replace(
        with_steps(session, found.steps),
        screening=found.screenings[-1],
        pose_errors=pose_errors_of(found.calibration),
        residual_tests=found.residual_tests,
        diagnosis=found,
    )


def with_steps(session: Session, steps: Sequence[FitStep]) -> Session:
    """Take over fits that were made, the last as the model; nothing more is known of that yet."""
    calibration, effects = steps[-1].calibration, steps[-1].selected
    return _untested(replace(session, calibration=calibration, effects=effects, steps=tuple(steps)))


def _calibrated(session: Session) -> Calibration:
    if session.calibration is None:
        raise CalibError(f"dataset {session.dataset.name}: it is not calibrated yet")
    return session.calibration


def _changed(session: Session, effects: tuple[SelectedEffect, ...], label: str) -> Session:
    before = _calibrated(session)
    start = start_of(session.steps[-1], effects)
    result = calibrate_with(session.measured, effects, before.options, start=start)
    return with_steps(session, (*session.steps, FitStep(label, effects, result)))


def start_of(last: FitStep, effects: Sequence[SelectedEffect]) -> Calibration | None:
    """The fit that one with these effects goes on from.

    The last one where effects are added; none where one is taken out, so that the fit ends where it was before.
    """
    return last.calibration if len(effects) > len(last.selected) else None


def _untested(session: Session) -> Session:
    """A new fit, of which nothing more is known yet."""
    unknown = replace(
        session, screening=None, pose_errors=None, residual_tests=None, curves=None, advice=None
    )
    return replace(unknown, diagnosis=None, separations={}, versions=())
