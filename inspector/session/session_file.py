"""Session files: the dataset, the model's steps with their figures, and the page's selections. JSON, version 1.

No figure in it is believed: the fits are done again from the dataset, and where its files or the figures are not those
of before, that is said. It names a dataset by folder and content; only one at or below the folder that the user serves
is ever opened, so a file from someone else cannot lead anywhere. It runs no code: effects of one's own come from
--effects-file, never from here.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from calib.dataset.files.origin import Origin, SavedOrigin
from calib.diagnosis.effect_selection import FitStep
from calib.errors import CalibError
from calib.noise_shape import NoiseShape
from calib.options import RESIDUAL_KINDS
from calib.strict_json import LIST_LIMIT, AboveZero, Finite, JsonFile, Place, Size, Text, Texts, to_json, with_escapes
from inspector.session.session import Session, StepErrors, asked_out

KIND, VERSION = "robot-calibration-inspector session", 1
POSITION = "position"
FIGURES = {"train_rmse_mm": "training RMSE", "test_rmse_mm": "test RMSE", "sigma_mm": "sigma"}  # of a step, mm


class SessionFileError(CalibError):
    """Error: a session file cannot be used."""


class Shown(msgspec.Struct, frozen=True, omit_defaults=True):
    """Selections on the page when the session was saved; None for unknown selections."""

    pose: Text | None = None  # id
    view: Text | None = msgspec.field(default=None, name="look")  # its name
    dark: bool | None = None  # in older files; dark or light is each page's own and not restored
    arrows: AboveZero | None = None  # how many times longer residuals are drawn
    factor: AboveZero | None = None  # how many times larger uncertainties are drawn


NOTHING_SHOWN = Shown()


class SavedEffect(msgspec.Struct, frozen=True):
    """One effect of a saved model, with its members and prior sigmas."""

    name: Text
    sizes: dict[str, Any]  # prior sigma by full parameter name; checked one by one


class SavedStep(msgspec.Struct, frozen=True):
    """One step of a saved model: what was fitted, with its errors."""

    label: Text
    residual: Text  # of RESIDUAL_KINDS
    effects: Annotated[tuple[SavedEffect, ...], Meta(max_length=LIST_LIMIT)]
    left_out: Texts  # ids of poses that stand out
    train_rmse_mm: Finite | None = None
    test_rmse_mm: Finite | None = None
    sigma_mm: Finite | None = None
    noise: NoiseShape | None = None  # that the points were weighed by
    asked_out: Texts = ()  # ids of poses that were left out as asked; `left_out` has those that stand out
    on_behalf_of: Texts = ()  # effects that the added one stands for as well, as it does not lead them


class SavedDataset(msgspec.Struct, frozen=True):
    """Name, folder and fingerprint of the session's dataset."""

    name: Text
    folder: Text  # relative to the session file
    files: dict[str, Any]  # hash by file name; checked one by one


class _Document(msgspec.Struct, frozen=True):
    """All keys of a session file except its format and version."""

    dataset: SavedDataset
    history: Annotated[tuple[SavedStep, ...], Meta(max_length=LIST_LIMIT)]
    shown: Shown
    diagnosed: bool | None = None
    left_out: Texts = ()  # ids of poses, as asked
    new_setups: Texts = ()  # ids of poses, as asked
    program_version: Text = ""
    origin: SavedOrigin = SavedOrigin()


@dataclass(frozen=True)
class Saved:
    """A session file that was read and checked as far as possible without its dataset."""

    path: Path
    folder: str
    name: str
    origin: Origin
    diagnosed: bool
    history: tuple[SavedStep, ...]  # the nominal robot first; empty where nothing was fitted
    shown: Shown
    left_out: tuple[str, ...] = ()  # ids of poses that count for nothing, as asked
    new_setups: tuple[str, ...] = ()  # ids of poses from which on the instrument stands elsewhere, as asked


# ---- writing --------------------------------------------------------------------------------------------------------


def session_text(
    session: Session,
    *,
    beside: Path,
    shown: Shown = NOTHING_SHOWN,
) -> str:
    """Text of the session file.

    beside: the folder that the dataset's path is told relative to.
    """
    dataset = session.dataset
    origin = Origin.of(dataset)
    assert dataset.folder is not None
    document = {
        "format": KIND,
        "version": VERSION,
        "program_version": origin.program_version,
        "origin": origin.document,
        "dataset": {"name": dataset.name, "folder": _relative(dataset.folder, beside), "files": origin.files},
        "diagnosed": session.searched,
        "history": list(map(_plain, saved_history(session))),
        "shown": msgspec.to_builtins(shown),
    }
    if session.asked_out:
        document["left_out"] = session.asked_out
    if dataset.new_setups:
        document["new_setups"] = dataset.new_setups
    return with_escapes(json.dumps(json.loads(to_json(document)), indent=1, ensure_ascii=False)) + "\n"


def _relative(folder: Path, beside: Path) -> str:
    try:
        return Path(os.path.relpath(folder.resolve(), beside.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return folder.resolve().as_posix()


def saved_history(session: Session) -> tuple[SavedStep, ...]:
    """Saved steps of a session: the nominal robot, then one for each fit."""
    if not session.steps:
        return ()
    nominal, *errors = session.history
    steps = (saved_step(step, after) for step, after in zip(session.steps, errors, strict=True))
    return _with_figures(SavedStep(nominal.label, POSITION, (), ()), nominal), *steps


def _plain(step: SavedStep) -> dict[str, Any]:
    """Saved step as plain values, without keys at their default."""
    values: dict[str, Any] = msgspec.to_builtins(step)
    return {key: v for key, v in values.items() if v or key not in ("noise", "asked_out", "on_behalf_of")}


def saved_step(step: FitStep, after: StepErrors) -> SavedStep:
    """Saved form of a step, with the errors after the step."""
    saved = SavedStep(
        label=step.label,
        residual=step.calibration.residual,
        effects=tuple(
            SavedEffect(effect.name, {name: float(size) for name, size in effect.prior_sigmas.items()})
            for effect in step.selected
        ),
        left_out=step.left_out,
        noise=step.calibration.options.noise,
        asked_out=asked_out(step),
        on_behalf_of=step.on_behalf_of,
    )
    return _with_figures(saved, after)


def _with_figures(step: SavedStep, errors: StepErrors) -> SavedStep:
    figures = {name: float(getattr(errors, name)) for name in FIGURES}
    known = {name: value if math.isfinite(value) else None for name, value in figures.items()}
    return msgspec.structs.replace(step, **known)


# ---- reading --------------------------------------------------------------------------------------------------------


def load_session(path: Path) -> Saved:
    """Read a session file. Raises SessionFileError in one line that names the file and the place."""
    file = JsonFile(path, "session file", "save the session again", SessionFileError)
    document = file.checked([], file.read(KIND, VERSION), _Document)
    for i, step in enumerate(document.history):
        _require_possible(file, ["history", i], step)
    dataset = document.dataset
    return Saved(
        path=path,
        folder=dataset.folder,
        name=dataset.name,
        origin=Origin.read(
            document.origin, document.program_version, file.checked_values(["dataset", "files"], dataset.files, Text)
        ),
        diagnosed=document.diagnosed or False,
        history=document.history,
        shown=document.shown,
        left_out=document.left_out,
        new_setups=document.new_setups,
    )


def _require_possible(file: JsonFile, place: Place, step: SavedStep) -> None:
    """Raise SessionFileError for a residual, a noise or prior sigmas that no step can have."""
    if step.residual not in RESIDUAL_KINDS:
        expected = f"expected {' or '.join(RESIDUAL_KINDS)}"
        file.fail([*place, "residual"], repr(step.residual), expected)
    if step.noise is not None and not step.noise.is_possible:
        file.fail([*place, "noise"], repr(step.noise)[:200], "a shape that noise can have is needed")
    for k, effect in enumerate(step.effects):
        sizes: Place = [*place, "effects", k, "sizes"]
        for name, size in effect.sizes.items():
            if size is None:
                file.fail([*sizes, name], "null", "a number above 0 is needed")
        file.checked_values(sizes, effect.sizes, Size)
