"""Functions from one session to the next: fits, effects added or removed, diagnoses, poses left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calib.calibration.model_versions import LINKS, versions
from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.repeats import in_repeat_groups_of, without_poses
from calib.diagnosis.advice import advice_on
from calib.diagnosis.diagnose import SearchState, next_move, whole_diagnosis
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, calibrate_with, candidate_of, recalled
from calib.diagnosis.moves import (
    AddCurves,
    AddEffect,
    DropEffect,
    LeaveOutPoses,
    Move,
    ShapeNoise,
    dropped_effects,
    fit_step_after,
)
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, step_after, with_candidate, with_curves
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.options import FitOptions
from calib.planning.discrimination import next_poses
from calib.rendering import numbers
from calib.screening.blunders import without_blunders
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import run_residual_tests
from inspector.session.measuring import with_face_labels
from inspector.session.session import LEFT_OUT, TAKEN_IN, Session, tests_of, untested

HISTORY_STEPS = 50  # that a session keeps: the first, and the last ones
RANKED_STEPS = 8  # the last ones, which keep their rankings; a search has five at most


def seen_since(session: Session, now: Session) -> Session:
    """Session with the searches, face labels and redundancy of a later state of the same dataset."""
    seen = replace(session, searches=now.searches, face_labels=now.face_labels)
    return replace(seen, redundancy=now.redundancy if session.left_out == now.left_out else None)


def with_calibration(session: Session, residual: str | None = None) -> Session:
    """Session with the links and the added effects fitted to the points measured so far; by default as usual."""
    residual = residual or session.dataset.usual_residual
    session = with_face_labels(session) if residual == "pose" else session
    asked = FitOptions() if session.calibration is None else session.calibration.options
    asked = asked if session.effects else replace(asked, noise=None)  # what is left in the end tells it
    keeps = bool(session.steps) and bool(session.effects or session.left_out)
    before, label = (session.steps[:-1], session.steps[-1].label) if keeps else ((), LINKS)
    stand_out = session.steps[-1].left_out if keeps else ()
    measured = session.measured_for(residual)
    measured = without_poses(measured, stand_out) if stand_out else measured
    result = calibrate_with(measured, session.effects, asked.with_residual(residual))
    if not keeps:
        result = without_blunders(result)
        stand_out = tuple(pose_id for pose_id in result.dataset.left_out if pose_id not in measured.left_out)
    return with_steps(session, (*before, FitStep(label, session.effects, result, left_out=stand_out)))


def with_screening(session: Session) -> Session:
    """Session with every effect ranked against the calibration's residual, and the residual tested."""
    return with_residual_tests(with_ranking(session))


def with_ranking(session: Session) -> Session:
    """Session with the pose errors, and with every effect ranked against the calibration's residual."""
    calibration = _calibrated(session)
    step = search_space(session).ranked(replace(session.steps[-1], screening=None))
    unknown = tests_of(Session(session.dataset))
    steps, errors = (*session.steps[:-1], step), pose_errors_of(calibration)
    return replace(session, **unknown, screening=step.screening, steps=steps, pose_errors=errors)


def with_residual_tests(session: Session) -> Session:
    """Session with the residual tested, and with the next change of the model, or the verdict, as advice.

    Nothing new where they are known or nothing was ranked.
    """
    if session.screening is None or session.residual_tests is not None:
        return session
    calibration = _calibrated(session)
    tests = run_residual_tests(calibration.dataset, session.screening.projected)
    return _with_next_move(replace(session, residual_tests=tests), SearchState(session.steps, session.dropped, tests))


def _with_next_move(session: Session, model: SearchState) -> Session:
    """Session with advice on the next change of its model, or with the diagnosis where no change is advised."""
    assert session.residual_tests is not None
    move = next_move(search_space(session), model)
    if isinstance(move, Diagnosis):
        return replace(session, advice=None, diagnosis=move, next_poses=next_poses(move))
    advice = advice_on(move, session.residual_tests, _calibrated(session))
    return replace(session, advice=advice, diagnosis=None, next_poses=None)


def after_advised(session: Session) -> Session:
    """Session after the advised effect was added, with its ranking, its tests and its own advice or verdict."""
    assert session.advice is not None
    return with_residual_tests(with_ranking(with_effect(session, session.advice.effect)))


def judged_as(session: Session, known: Session) -> Session:
    """Session with ranking, tests and verdict that are known of the same fit."""
    assert session.calibration is known.calibration
    steps = (*session.steps[:-1], replace(session.steps[-1], screening=known.screening))
    return replace(session, **tests_of(known, "screening", "pose_errors"), steps=steps)


def search_space(session: Session) -> SearchSpace:
    """Search space for the automatic diagnosis, with the data, options and effects of the model on show."""
    options = _calibrated(session).options
    return SearchSpace.of(session.measured, options, user_effects=session.user_effects)


def with_versions(session: Session, before: Session) -> Session:
    """Session with the model's versions side by side, where it has a model.

    With effects in the model the link errors alone are fitted to the same points, unless the session `before` has that
    fit already.
    """
    if session.calibration is None or session.versions:
        return session
    return replace(session, versions=versions(session.calibration, before.links_alone))


def with_user_effects(session: Session, effects: tuple[Family, ...]) -> Session:
    """Session with the given user effects; the model's own are fitted again, or removed where no longer defined."""
    ours = {family.name for family in (*session.user_effects, *effects)}
    session = replace(session, user_effects=effects, screening=None, diagnosis=None, next_poses=None)
    if session.calibration is None or not any(added.name in ours for added in session.effects):
        return session
    kept: list[SelectedEffect] = []
    for added in session.effects:
        try:
            again = added.name in ours
            kept.append(recalled(session.measured, added.name, added.prior_sigmas, effects) if again else added)
        except CalibError:  # it is gone, or has other parameters: the ranking offers it anew
            continue
    return _changed(session, tuple(kept), "own effects read again")


def with_effect(session: Session, name: str) -> Session:
    """Session with an effect (as proposed by the screening) or learned curves added, and all fitted again.

    Members of the effects inside are chosen anew beside it, as the automatic search does.
    """
    if any(added.name == name for added in session.effects):
        raise CalibError(f"effect {name} is in the model already")
    move = _advised(session, name)
    session = replace(session, dropped=session.dropped - {name})
    last = session.steps[-1]
    if isinstance(move, AddEffect):
        session = replace(session, dropped=session.dropped.union(dropped_effects(move)))
        return with_steps(session, (*session.steps, fit_step_after(last, move)))
    if isinstance(move, AddCurves):
        step = move.diagnosis.steps[-1]
        return _judged(with_steps(session, (*session.steps, step)), move.diagnosis)
    space = search_space(session).without(last.left_out)
    if name == LEARNED:
        return with_steps(session, (*session.steps, with_curves(space, last)))
    candidate = candidate_of(session.screening, name)
    step = step_after(last, name, *with_candidate(space, last, candidate), candidate)
    return with_steps(session, (*session.steps, step))


def _advised(session: Session, name: str) -> Move | None:
    """The advised change of the model, if it adds this effect; else None."""
    advice = session.advice if session.screening is not None else None
    return advice.move if advice is not None and advice.effect == name else None


def without_effect(session: Session, name: str) -> Session:
    """Session with an effect removed from the model, and the rest fitted again."""
    kept = tuple(added for added in session.effects if added.name != name)
    if len(kept) == len(session.effects):
        inside = ", ".join(added.name for added in session.effects) or f"only {LINKS}"
        raise CalibError(f"effect {name} is not in the model; there is {inside}")
    move = _advised(session, name)
    if isinstance(move, DropEffect):
        session = replace(session, dropped=session.dropped.union(dropped_effects(move)))
        return with_steps(session, (*session.steps, fit_step_after(session.steps[-1], move)))
    return _changed(session, kept, f"− {name}")


def with_advice_followed(session: Session) -> Session:
    """Session after the advised change of the model. Raises CalibError where none is advised."""
    if session.advice is None:
        raise CalibError("there is nothing to follow: no move leads on from this model")
    move = session.advice.move
    match move:
        case LeaveOutPoses() | ShapeNoise():
            moved = with_found(session, move.diagnosis)
            return _with_next_move(moved, SearchState(moved.steps, moved.dropped, diagnosis=move.diagnosis))
        case DropEffect():
            return without_effect(session, move.name)
    return with_effect(session, session.advice.effect)


def with_diagnosis(session: Session, on_step: Callable[[str], None] | None = None) -> Session:
    """Session with the diagnosis that starts from the link errors alone, and with the model that it ends with.

    `on_step` is called with a line of text before each stage; what it raises ends the work.
    """
    dataset = session.measured
    asked = FitOptions(residual=dataset.usual_residual)
    space = SearchSpace.of(dataset, asked, user_effects=session.user_effects)
    return with_found(session, whole_diagnosis(space, on_step))


def with_found(session: Session, found: Diagnosis) -> Session:
    """Session with a diagnosis made elsewhere, and with the model that it ends with."""
    dropped = session.dropped if found.noise is None else session.dropped | {found.noise.rival}
    return replace(_judged(with_steps(session, found.steps), found), searched=True, dropped=dropped)


def _judged(session: Session, found: Diagnosis) -> Session:
    """Diagnosis of the model on show, without a further search."""
    return replace(
        session,
        screening=found.screenings[-1],
        pose_errors=pose_errors_of(found.calibration),
        residual_tests=found.residual_tests,
        diagnosis=found,
        next_poses=next_poses(found),
    )


def with_steps(session: Session, steps: Sequence[FitStep]) -> Session:
    """Session with these fits as its steps, the last as the model; rankings and tests are dropped."""
    calibration, effects = steps[-1].calibration, steps[-1].selected
    if len(steps) > HISTORY_STEPS:
        steps = (steps[0], *steps[1 - HISTORY_STEPS :])
    steps = [without_ranking(step) for step in steps[:-RANKED_STEPS]] + list(steps[-RANKED_STEPS:])
    return untested(replace(session, calibration=calibration, effects=effects, steps=tuple(steps)))


def without_ranking(step: FitStep) -> FitStep:
    """Step without its ranking of effects, which takes most of its memory and can be computed again."""
    return step if step.screening is None else replace(step, screening=None)


def _calibrated(session: Session) -> Calibration:
    if session.calibration is None:
        raise CalibError(f"dataset {session.dataset.name}: it is not calibrated yet")
    return session.calibration


def _changed(session: Session, effects: tuple[SelectedEffect, ...], label: str) -> Session:
    last = session.steps[-1]
    result = search_space(session).without(last.left_out).fit(effects, start_of(last, effects))
    return with_steps(session, (*session.steps, FitStep(label, effects, result, left_out=last.left_out)))


def start_of(last: FitStep, effects: Sequence[SelectedEffect]) -> Calibration | None:
    """Fit to start from when a model with these effects is fitted.

    The last one where effects are added; none where one is taken out, so that the fit ends where it was before.
    """
    return last.calibration if len(effects) > len(last.selected) else None


LABELLED_POSES = 3  # left out together: ids that the label of their step names

# ---- poses left out, and taken in again ------------------------------------------------------------


def with_poses_left_out(session: Session, *pose_ids: str) -> Session:
    """Session with poses left out of training and test, and the same model fitted to the others.

    Raises CalibError for an unknown pose, where all are left out already, and where the others are too few to fit.
    """
    for pose_id in pose_ids:
        session.dataset.poses.index(pose_id)
    further = tuple(pose_id for pose_id in dict.fromkeys(pose_ids) if pose_id not in session.uncounted)
    if not further:
        several = "poses {} are" if len(pose_ids) > 1 else "pose {} is"
        raise CalibError(f"{several.format(', '.join(pose_ids))} left out already")
    label = numbers.in_short(further, LABELLED_POSES)
    return _fitted_again(replace(session, left_out=(*session.left_out, *further)), f"{LEFT_OUT}{label}")


def with_pose_taken_in(session: Session, pose_id: str) -> Session:
    """Session with a pose used again that was left out on request or as an outlier, and the same model fitted.

    Raises CalibError for an unknown pose and one that is not left out.
    """
    session.dataset.poses.index(pose_id)
    if pose_id not in session.uncounted:
        raise CalibError(f"pose {pose_id} is not left out")
    if pose_id in session.dataset.left_out:
        raise CalibError(f"pose {pose_id} was left out when the dataset was loaded; load it with the pose")
    kept = tuple(other for other in session.left_out if other != pose_id)
    return _fitted_again(replace(session, left_out=kept), f"{TAKEN_IN}{pose_id}", pose_id)


def with_new_setup(session: Session, pose_id: str) -> Session:
    """Session whose instrument stands elsewhere from a pose on, with a first fit of the links alone.

    Earlier models had another place of the instrument and are dropped. Raises CalibError for an unknown pose.
    """
    dataset = session.dataset.with_new_setups([pose_id])
    fresh = Session(
        dataset,
        searches=session.searches,
        face_labels=session.face_labels,
        user_effects=session.user_effects,
        left_out=session.left_out,
    )
    return fresh if session.calibration is None else with_calibration(fresh, session.calibration.residual)


def _fitted_again(session: Session, label: str, taken_in: str = "") -> Session:
    """Session with the last step's model fitted to the poses in use; unchanged before the first calibration."""
    if session.calibration is None:
        return replace(session, redundancy=None)
    last = session.steps[-1]
    # Repeats of one pose are outliers together, and are taken in together.
    alone = {taken_in} if taken_in else set()
    if taken_in and last.left_out:
        ids, of_stand = session.dataset.poses.ids, in_repeat_groups_of(session.dataset, [taken_in])
        alone = {ids[i] for i in np.flatnonzero(of_stand)}
    gone = alone | set(session.left_out)
    stand_out = tuple(pose_id for pose_id in last.left_out if pose_id not in gone)
    space = search_space(session).without(stand_out)
    step = FitStep(label, last.selected, space.fit(last.selected, None), left_out=stand_out)
    return replace(with_steps(session, (*session.steps, step)), redundancy=None)
