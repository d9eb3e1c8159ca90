"""Reopening of a saved session: find its dataset, repeat its fits, report differences from the saved figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.fingerprint import changed, content_hash, fingerprint
from calib.dataset.files.folder import find_datasets, load_dataset
from calib.dataset.repeats import without_poses
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, calibrate_with, recalled, relearned
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.fitting.observations import nominal_state
from calib.options import FitOptions
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session, StepErrors
from inspector.session.session_file import FIGURES, Saved, SavedStep, SessionFileError

SAME = 1e-6  # share by which a figure may differ and still be the same


def dataset_of(saved: Saved, root: Path) -> Path:
    """Folder of a saved session's dataset, at or below `root`: as recorded, else with the same dataset.toml.

    Raises SessionFileError where there is none. Nothing outside `root` is looked at.
    """
    known = {folder.resolve(): folder for folder in find_datasets(root)}
    for beside in (saved.path.parent, root):
        try:
            told = (beside / saved.folder).resolve()
        except (OSError, RuntimeError, ValueError):  # too long, or links in a circle
            continue
        if told in known:
            return known[told]
    wanted = saved.origin.files.get("dataset.toml")
    alike = [folder for folder in known.values() if content_hash(folder / "dataset.toml") == wanted]
    if len(alike) == 1:
        return alike[0]
    raise SessionFileError(
        f"{saved.path}: its dataset {saved.name!r} (folder {saved.folder!r:.200}) is not at or below {root}; serve the "
        "folder that holds it"
    )


@dataclass(frozen=True)
class Opening:
    """A saved session and the dataset folder that it belongs to."""

    session: Saved
    folder: Path


def opening(saved: Saved, root: Path, effects_file: Path | None = None) -> tuple[Opening, tuple[str, ...]]:
    """Saved session with its dataset at or below `root`, checked as far as possible before the scans are searched.

    Returns what is not as it was, too. Raises CalibError.
    """
    folder = dataset_of(saved, root)
    dataset = load_dataset(folder)
    files = _changed_files(saved, dataset)
    if dataset.points is not None or effects_file is None:
        own = () if effects_file is None else load_effects(effects_file, nominal_state(dataset))
        try:
            _selections(saved.history, dataset, own)
        except CalibError as error:
            if files:
                return Opening(saved, folder), files
            raise SessionFileError(f"{saved.path}: {error}") from None
    return Opening(saved, folder), files


def _changed_files(saved: Saved, dataset: Dataset) -> tuple[str, ...]:
    files = changed(saved.origin.files, fingerprint(dataset))
    return (f"The dataset has changed since the session was saved: {', '.join(files)}.",) if files else ()


def reopened(session: Session, saved: Saved) -> tuple[Session, tuple[str, ...]]:
    """Session with the saved fits repeated on the present measurements, and a line per difference to saved figures.

    Raises SessionFileError where an effect or a pose of it is unknown here.
    """
    notes = _changed_files(saved, session.dataset)
    for pose_id in saved.left_out:
        if pose_id not in session.dataset.poses.ids:
            raise SessionFileError(f"{saved.path}: left_out: found {pose_id!r}; no pose has this name")
    further = [pose_id for pose_id in saved.new_setups if pose_id not in session.dataset.new_setups]
    try:
        session = replace(session, dataset=session.dataset.with_new_setups(further))
    except CalibError as error:
        raise SessionFileError(f"{saved.path}: new_setups: {error}") from None
    out = tuple(pose_id for pose_id in saved.left_out if pose_id not in session.dataset.left_out)
    session = replace(session, left_out=out)
    if not saved.history:
        return session, notes
    try:
        session = sessions.with_diagnosis(session) if saved.diagnosed else replayed(session, saved.history)
    except CalibError as error:
        raise SessionFileError(f"{saved.path}: {error}") from None
    return session, (*notes, *_differences(saved, session.history))


def replayed(session: Session, history: Sequence[SavedStep]) -> Session:
    """Steps of a saved model fitted again to the present measurements; the saved figures are not read.

    Raises CalibError for an effect or a pose that the dataset does not have.
    """
    selections = _selections(history, session.measured, session.user_effects)
    if any(step.residual == "pose" for step in history[1:]):
        session = measuring.with_face_labels(session)
    steps: list[FitStep] = []
    for step, selected in list(zip(history, selections, strict=True))[1:]:
        measured = replace(session, left_out=_to_leave_out(session, step)).measured_for(step.residual)
        dataset = without_poses(measured, step.left_out) if step.left_out else measured
        selected = relearned(selected, steps) if steps else selected
        start = sessions.start_of(steps[-1], selected) if steps else None
        fit = calibrate_with(dataset, selected, FitOptions(step.residual, noise=step.noise), start=start)
        steps.append(FitStep(step.label, selected, fit, left_out=step.left_out, on_behalf_of=step.on_behalf_of))
    session = replace(session, left_out=_to_leave_out(session, history[-1]))
    return sessions.with_steps(session, steps) if steps else session


def _to_leave_out(session: Session, step: SavedStep) -> tuple[str, ...]:
    """Ids of poses that a saved step left out on request and that the dataset has."""
    return tuple(pose_id for pose_id in step.asked_out if pose_id not in session.dataset.left_out)


def _selections(
    history: Sequence[SavedStep], dataset: Dataset, own: Sequence[Family]
) -> list[tuple[SelectedEffect, ...]]:
    """Effects of each saved step. Raises CalibError for an effect or a pose that the dataset does not have."""
    out = []
    for step in history:
        out.append(tuple(recalled(dataset, effect.name, effect.sizes, own) for effect in step.effects))
        for pose_id in (*step.left_out, *step.asked_out):
            dataset.poses.index(pose_id)
    return out


def _differences(saved: Saved, history: Sequence[StepErrors]) -> list[str]:
    """One line for each figure of the repeated fits that differs from the saved one."""
    # The first two are the arm as delivered and its first fit, whatever an older file calls them.
    before, now = [s.label for s in saved.history[2:]], [s.label for s in history[2:]]
    if before != now:
        return [f"The steps are now {', '.join(now)}; saved were {', '.join(before)}."]
    for old, new in zip(saved.history, history, strict=True):
        for key, name in FIGURES.items():
            was, is_ = getattr(old, key), getattr(new, key)
            if was is not None and not math.isclose(was, is_, rel_tol=SAME, abs_tol=1e-12):
                return [f"{new.label}: the {name} is now {is_:.6g} mm; saved was {was:.6g} mm."]
    return []
