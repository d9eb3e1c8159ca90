"""A session as a file: which dataset, what was added to the model step by step, and what was on show. JSON, version 1.

No figure in it is believed: the fits are done again from the dataset, and where its files or the figures are not those
of before, that is said. It names a dataset by folder and content; only one at or below the folder that the user serves
is ever opened, so a file from someone else cannot lead anywhere. It runs no code: effects of one's own come from
--effects-file, never from here.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calib.dataset.dataset import Dataset, without_poses
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.fingerprint import changed, content_hash, fingerprint
from calib.dataset.files.folder import find_datasets, load_dataset
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, calibrate_with, recalled
from calib.effects.effect import Family
from calib.effects.user_file import load_effects
from calib.errors import CalibError
from calib.fitting.observations import nominal_state
from calib.options import RESIDUAL_KINDS, FitOptions
from inspector.session import transitions as sessions
from inspector.session.json_reader import Reader, SessionFileError, read_object
from inspector.session.json_text import to_json
from inspector.session.session import Session, StepErrors

KIND, VERSION = "robot-calibration-inspector session", 1
POSITION = "position"
KEYS = {"view": "look"}  # what the file calls a field that has another name here
KEYS = {"view": "look"}  # what the file calls a field that has another name here
SAME = 1e-6  # share by which a figure may differ and still be the same


@dataclass(frozen=True)
class Shown:
    """What was on the page; None: nothing is known of it."""

    pose: str | None = None  # id
    view: str | None = None  # its name
    dark: bool | None = None
    arrows: float | None = None  # how many times longer residuals are drawn
    factor: float | None = None  # how many times larger uncertainties are drawn


@dataclass(frozen=True)
class SavedStep:
    """One state of the model: what was fitted, and the figures that it had."""

    label: str
    residual: str
    effects: tuple[tuple[str, Mapping[str, float]], ...]  # name, sizes by full parameter name
    left_out: tuple[str, ...]
    figures: tuple[float | None, ...]  # training and test RMSE, sigma; mm


@dataclass(frozen=True)
class Saved:
    """A session file, read and checked for what can be checked without its dataset."""

    path: Path
    folder: str
    name: str
    files: Mapping[str, str]
    diagnosed: bool
    history: tuple[SavedStep, ...]  # the nominal robot first; empty where nothing was fitted
    shown: Shown = field(default_factory=Shown)


# ---- writing --------------------------------------------------------------------------------------------------------


def session_text(session: Session, *, beside: Path, shown: Shown = Shown()) -> str:
    """The file's content. `beside`: the folder that the dataset's path is told relative to."""
    dataset = session.dataset
    files = fingerprint(dataset)
    assert dataset.folder is not None
    document = {
        "format": KIND,
        "version": VERSION,
        "dataset": {"name": dataset.name, "folder": _relative(dataset.folder, beside), "files": files},
        "diagnosed": session.diagnosis is not None,
        "history": _history(session),
        "shown": {KEYS.get(key, key): value for key, value in vars(shown).items() if value is not None},
    }
    return json.dumps(json.loads(to_json(document)), indent=1, ensure_ascii=False) + "\n"


def save_session(path: Path, session: Session, shown: Shown = Shown()) -> None:
    """Write the session, whole or not at all."""
    write_text_atomically(path, session_text(session, beside=path.parent, shown=shown))


def _relative(folder: Path, beside: Path) -> str:
    try:
        return Path(os.path.relpath(folder.resolve(), beside.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return folder.resolve().as_posix()


def _history(session: Session) -> list[dict[str, Any]]:
    """The nominal robot, which was fitted to nothing, then the steps."""
    if not session.steps:
        return []
    nominal, *errors = session.history
    return [
        _entry(nominal, POSITION, (), ()),
        *(
            _entry(after, step.calibration.residual, step.selected, step.left_out)
            for after, step in zip(errors, session.steps, strict=True)
        ),
    ]


def _entry(
    errors: StepErrors, residual: str, selected: Sequence[SelectedEffect], left_out: Sequence[str]
) -> dict[str, Any]:
    return {
        "label": errors.label,
        "residual": residual,
        "effects": [{"name": effect.name, "sizes": effect.prior_sigmas} for effect in selected],
        "left_out": left_out,
        "train_rmse_mm": errors.train_rmse_mm,
        "test_rmse_mm": errors.test_rmse_mm,
        "sigma_mm": errors.sigma_mm,
    }


# ---- reading --------------------------------------------------------------------------------------------------------


def load_session(path: Path) -> Saved:
    """Read a session file. Raises SessionFileError in one line that names the file and the place."""
    data = read_object(path)
    if data.value("format") != KIND:
        data.fail("format", f"{data.value('format')!r:.80}", f"a session file says {KIND!r}")
    if type(data.value("version")) is not int or data.value("version") != VERSION:
        data.fail("version", f"{data.value('version')!r:.80}", f"this program reads version {VERSION}")
    dataset, shown = data.mapping_at("dataset"), data.mapping_at("shown")
    return Saved(
        path=path,
        folder=dataset.text("folder"),
        name=dataset.text("name"),
        files=dataset.mapping_at("files").texts(),
        diagnosed=data.flag("diagnosed") or False,
        history=tuple(_saved_step(step) for step in data.mappings_at("history")),
        shown=Shown(
            pose=shown.optional_text("pose"),
            view=shown.optional_text("look"),
            dark=shown.flag("dark"),
            arrows=shown.size("arrows"),
            factor=shown.size("factor"),
        ),
    )


def _saved_step(step: Reader) -> SavedStep:
    residual = step.text("residual")
    if residual not in RESIDUAL_KINDS:
        step.fail("residual", repr(residual), f"expected {' or '.join(RESIDUAL_KINDS)}")
    effects = [(e.text("name"), e.mapping_at("sizes").sizes()) for e in step.mappings_at("effects")]
    figures = tuple(step.number(key) for key in ("train_rmse_mm", "test_rmse_mm", "sigma_mm"))
    return SavedStep(step.text("label"), residual, tuple(effects), step.texts_at("left_out"), figures)


# ---- opening again --------------------------------------------------------------------------------------------------


def dataset_of(saved: Saved, root: Path) -> Path:
    """The session's dataset, at or below `root`: where the file says, else the one with the same dataset.toml.

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
    wanted = saved.files.get("dataset.toml")
    alike = [folder for folder in known.values() if content_hash(folder / "dataset.toml") == wanted]
    if len(alike) == 1:
        return alike[0]
    raise SessionFileError(
        f"{saved.path}: its dataset {saved.name!r} (folder {saved.folder!r:.200}) is not at or below {root}; serve the "
        "folder that holds it"
    )


@dataclass(frozen=True)
class Opening:
    """A saved session with the dataset folder that it belongs to."""

    session: Saved
    folder: Path


def opening(saved: Saved, root: Path, effects_file: Path | None = None) -> tuple[Opening, tuple[str, ...]]:
    """The session with its dataset at or below `root`, checked as far as that can be before its scans are searched.

    Returns what is not as it was, too. Raises CalibError.
    """
    folder = dataset_of(saved, root)
    dataset = load_dataset(folder)
    files = _changed_files(saved, dataset)
    if dataset.points is not None or effects_file is None:
        own = () if effects_file is None else load_effects(effects_file, nominal_state(dataset))
        try:
            _selections(saved, dataset, own)
        except CalibError as error:
            if files:
                return Opening(saved, folder), files
            raise SessionFileError(f"{saved.path}: {error}") from None
    return Opening(saved, folder), files


def _changed_files(saved: Saved, dataset: Dataset) -> tuple[str, ...]:
    files = changed(saved.files, fingerprint(dataset))
    return (f"The dataset has changed since the session was saved: {', '.join(files)}.",) if files else ()


def reopened(session: Session, saved: Saved) -> tuple[Session, tuple[str, ...]]:
    """The fits of the saved session once more, on what is measured now, and what is not as it was, a line each.

    Raises SessionFileError where an effect or a pose of it is unknown here.
    """
    notes = _changed_files(saved, session.dataset)
    if not saved.history:
        return session, notes
    try:
        session = sessions.with_diagnosis(session) if saved.diagnosed else replayed(session, saved)
    except CalibError as error:
        raise SessionFileError(f"{saved.path}: {error}") from None
    return session, (*notes, *_differences(saved, session.history))


def replayed(session: Session, saved: Saved) -> Session:
    """The fits of a saved session once more, on what is measured now; its figures are not read."""
    selections = _selections(saved, session.measured, session.user_effects)
    if any(step.residual == "pose" for step in saved.history[1:]):
        session = sessions.with_face_labels(session)
    steps: list[FitStep] = []
    for step, selected in list(zip(saved.history, selections, strict=True))[
        1:
    ]:  # the first is the nominal robot
        measured = session.measured_for(step.residual)
        dataset = without_poses(measured, step.left_out) if step.left_out else measured
        start = sessions.start_of(steps[-1], selected) if steps else None
        fit = calibrate_with(dataset, selected, FitOptions(step.residual), start=start)
        steps.append(FitStep(step.label, selected, fit, left_out=step.left_out))
    return sessions.with_steps(session, steps) if steps else session


def _selections(saved: Saved, dataset: Dataset, own: Sequence[Family]) -> list[tuple[SelectedEffect, ...]]:
    """The effects of each step. Raises CalibError for an effect or a pose that the dataset does not have."""
    out = []
    for step in saved.history:
        out.append(tuple(recalled(dataset, name, sigmas, own) for name, sigmas in step.effects))
        for pose_id in step.left_out:
            dataset.poses.index(pose_id)
    return out


def _differences(saved: Saved, history: Sequence[StepErrors]) -> list[str]:
    """What came out otherwise than it is written down."""
    before, now = [s.label for s in saved.history], [s.label for s in history]
    if before != now:
        return [f"The steps are now {', '.join(now)}; saved were {', '.join(before)}."]
    for old, new in zip(saved.history, history, strict=True):
        figures = (new.train_rmse_mm, new.test_rmse_mm, new.sigma_mm)
        for name, was, is_ in zip(("training RMSE", "test RMSE", "sigma"), old.figures, figures, strict=True):
            if was is not None and not math.isclose(was, is_, rel_tol=SAME, abs_tol=1e-12):
                return [f"{new.label}: the {name} is now {is_:.6g} mm; saved was {was:.6g} mm."]
    return []
