"""A session as a file: which dataset, what was added to the model step by step, and what was on show. JSON, version 1.

No figure in it is believed: the fits are done again from the dataset, and where its files or the figures are not those
of before, that is said. It names a dataset by folder and content; only one at or below the folder that the user serves
is ever opened, so a file from someone else cannot lead anywhere. It runs no code: effects of one's own come from
--effects-file, never from here.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.fingerprint import fingerprint
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.errors import CalibError
from calib.noise_shape import NoiseShape
from calib.options import RESIDUAL_KINDS
from calib.strict_json import (
    LIST_LIMIT,
    AboveZero,
    Finite,
    JsonFile,
    Place,
    Text,
    Texts,
    to_json,
)
from inspector.session.session import Session, StepErrors

KIND, VERSION = "robot-calibration-inspector session", 1
POSITION = "position"


class SessionFileError(CalibError):
    """A session file cannot be used."""


class Shown(msgspec.Struct, frozen=True, omit_defaults=True):
    """What was on the page; None: nothing is known of it."""

    pose: Text | None = None  # id
    view: Text | None = msgspec.field(default=None, name="look")  # its name
    dark: bool | None = None
    arrows: AboveZero | None = None  # how many times longer residuals are drawn
    factor: AboveZero | None = None  # how many times larger uncertainties are drawn


NOTHING_SHOWN = Shown()


class SavedEffect(msgspec.Struct, frozen=True):
    """An effect of a model."""

    name: Text
    sizes: dict[str, Any]  # prior sigma by full parameter name; checked one by one


class SavedStep(msgspec.Struct, frozen=True):
    """One state of the model: what was fitted, and the figures that it had."""

    label: Text
    residual: Text  # of RESIDUAL_KINDS
    effects: Annotated[tuple[SavedEffect, ...], Meta(max_length=LIST_LIMIT)]
    left_out: Texts  # ids of poses
    train_rmse_mm: Finite | None = None
    test_rmse_mm: Finite | None = None
    sigma_mm: Finite | None = None
    noise: NoiseShape | None = None  # that the points were weighed by

    @property
    def figures(self) -> tuple[float | None, float | None, float | None]:
        """Training and test RMSE, residual sigma; mm."""
        return self.train_rmse_mm, self.test_rmse_mm, self.sigma_mm


class SavedDataset(msgspec.Struct, frozen=True):
    """Which dataset it was."""

    name: Text
    folder: Text  # relative to the session file
    files: dict[str, Any]  # hash by file name; checked one by one


class _Document(msgspec.Struct, frozen=True):
    """The whole file, beside its format and version."""

    dataset: SavedDataset
    history: Annotated[tuple[SavedStep, ...], Meta(max_length=LIST_LIMIT)]
    shown: Shown
    diagnosed: bool | None = None


@dataclass(frozen=True)
class Saved:
    """A session file, read and checked for what can be checked without its dataset."""

    path: Path
    folder: str
    name: str
    files: Mapping[str, str]
    diagnosed: bool
    history: tuple[SavedStep, ...]  # the nominal robot first; empty where nothing was fitted
    shown: Shown


# ---- writing --------------------------------------------------------------------------------------------------------


def session_text(session: Session, *, beside: Path, shown: Shown = NOTHING_SHOWN) -> str:
    """The file's content. `beside`: the folder that the dataset's path is told relative to."""
    dataset = session.dataset
    files = fingerprint(dataset)
    assert dataset.folder is not None
    document = {
        "format": KIND,
        "version": VERSION,
        "dataset": {"name": dataset.name, "folder": _relative(dataset.folder, beside), "files": files},
        "diagnosed": session.searched,
        "history": _history(session),
        "shown": msgspec.to_builtins(shown),
    }
    return json.dumps(json.loads(to_json(document)), indent=1, ensure_ascii=False) + "\n"


def save_session(path: Path, session: Session, shown: Shown = NOTHING_SHOWN) -> None:
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
            _entry(after, step.calibration.residual, step.selected, step.left_out) | _noise(step)
            for after, step in zip(errors, session.steps, strict=True)
        ),
    ]


def _noise(step: FitStep) -> dict[str, Any]:
    """The shape of the noise, where the step's fit took one."""
    shape = step.calibration.options.noise
    return {} if shape is None else {"noise": dataclasses.asdict(shape)}


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
    file = JsonFile(path, "session file", "save the session again", SessionFileError)
    document = file.checked([], file.read(KIND, VERSION), _Document)
    for i, step in enumerate(document.history):
        if step.residual not in RESIDUAL_KINDS:
            expected = f"expected {' or '.join(RESIDUAL_KINDS)}"
            file.fail(["history", i, "residual"], repr(step.residual), expected)
        if step.noise is not None and not step.noise.is_possible:
            file.fail(
                ["history", i, "noise"], repr(step.noise)[:200], "a shape that noise can have is needed"
            )
        for k, effect in enumerate(step.effects):
            place: Place = ["history", i, "effects", k, "sizes"]
            for name, size in effect.sizes.items():
                if size is None:
                    file.fail([*place, name], "null", "a number above 0 is needed")
            file.checked_values(place, effect.sizes, AboveZero)
    dataset = document.dataset
    return Saved(
        path=path,
        folder=dataset.folder,
        name=dataset.name,
        files=file.checked_values(["dataset", "files"], dataset.files, Text),
        diagnosed=document.diagnosed or False,
        history=document.history,
        shown=document.shown,
    )
