"""Processing of one dataset of a fleet by a worker: corners, fit, diagnosis, and the row of the fleet's table."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from calib.api.validation import check
from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.dataset.files.fingerprint import fingerprint
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.causes import main_value, moved_mm
from calib.diagnosis.headline import headline_of
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import family_name
from calib.extras.fleet.row import EffectSize, Rmse, Row
from calib.extras.fleet.workers import versions
from calib.lazy_modules import pd
from calib.measurement.measured_points import failed_searches, require_corners
from calib.present.results import keys_of
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.strict_json import to_json
from calib.targets.search import find_targets
from calib.validation.acceptance import Check, TooFewPoses

LONGEST_REASON = 400  # characters


@dataclass(frozen=True)
class Task:
    """Task of processing one dataset, given by its path; the worker reads the files."""

    folder: str  # of the fleet
    path: str  # of the dataset below it
    known: str = ""  # key of the row of an earlier run


@dataclass(frozen=True)
class Judged:
    """Result of processing one dataset: its row of the table, with key and duration."""

    key: str  # hash of the files and versions that the row depends on
    row: Row
    seconds: float


def one_line(words: str) -> str:
    """A text as one line of bounded length."""
    line = " ".join(words.split())
    return line if len(line) <= LONGEST_REASON else f"{line[: LONGEST_REASON - 3]}..."


def judge(task: Task) -> Judged | None:
    """Row of the fleet's table for one dataset; None where that of an earlier run is still valid."""
    started = perf_counter()
    dataset = load_dataset(Path(task.folder) / task.path)
    depends_on = {"files": dict(sorted(fingerprint(dataset).items())), "versions": versions()}
    key = hashlib.sha256(to_json(depends_on).encode()).hexdigest()
    if key == task.known:
        return None
    searches = None
    if dataset.points is None:
        searches = find_targets(dataset, intermediate=False)
        require_corners(dataset, searches)
    checked = check(dataset, searches)
    return Judged(key, row_of(task.path, checked, failed_searches(searches or {})), perf_counter() - started)


def row_of(path: str, checked: Check, without_corner: Iterable[str] = ()) -> Row:
    """Row of the fleet's table for a checked dataset."""
    dataset, found, fits = checked.dataset, checked.diagnosis, [checked.calibration]
    if found is not None:
        fits = [found.steps[0].calibration, found.calibration]
    last = fits[-1]
    about = {
        str(key): one_line(str(value))
        for flat in pd.json_normalize(dict(dataset.about.extra)).to_dict("records")  # gears.J3 of nested tables
        for key, value in flat.items()
        if isinstance(value, str | int | float)
    }
    if dataset.about.operator:
        about["operator"] = dataset.about.operator
    told = None if last is None else headline_of([last])
    tried = (i for i in checked.items if i.name == "diagnosis" or isinstance(i.evidence, TooFewPoses))
    left_out = (*without_corner, *(last.outliers if last else ()), *(found.steps[-1].left_out if found else ()))
    row = Row(
        path=path,
        name=dataset.name,
        **keys_of(dataset.about, "serial", "site", "date"),
        about=dict(sorted(about.items())),
        robot=dataset.robot.name,
        joints=dataset.robot.n_joints,
        poses=len(dataset.poses),
        points=0 if dataset.points is None else len(dataset.points),
        left_out=tuple(dict.fromkeys(left_out)),
        train=_rmse(fits, "train"),
        test=_rmse(fits, "test"),
        noise_ratio=None if told is None or told.noise.source == FIT else told.noise_ratio,
        passed=checked.passed,
        reasons=tuple(one_line(f"{item.name}: {item.headline}") for item in checked.failed),
        words=one_line(next((item.headline for item in tried), "") if found is None else found.headline),
    )
    if found is None:
        return row
    return replace(
        row,
        **keys_of(found, "verdict", "missing", "suspected"),
        ambiguous=found.ambiguous_set,
        sizes=sizes_of(found),
        likely={name: round(found.probabilities.of(name), 4) for name in found.named},
    )


def _rmse(fits: Sequence[Calibration | None], role: str) -> Rmse:
    """Errors by the nominal robot, by the first of some fits and by the last."""
    links, last = fits[0], fits[-1]
    if links is None or last is None:
        return Rmse()
    figures = [getattr(errors, role) for errors in (last.before, links.after, last.after)]
    return Rmse(*(None if of is None else of.rmse_mm for of in figures))


def sizes_of(found: Diagnosis) -> tuple[EffectSize, ...]:
    """Sizes of the effects that a diagnosis added, by effect and joint, without learned curves."""
    calibration = found.calibration
    members = [m for m in calibration.model.effects if family_name(m) in found.named]
    out = []
    for member, moves_mm in zip(members, moved_mm(members, calibration), strict=True):
        main = main_value(member, calibration)
        if main is None or family_name(member) == LEARNED or not np.isfinite([main.value, moves_mm]).all():
            continue
        joint = getattr(member, "joint", None)
        sigma = main.sigma if np.isfinite(main.sigma) else None
        out.append(
            EffectSize(
                family_name(member), None if joint is None else joint + 1, main.name, main.value, sigma,
                main.unit, moves_mm,
            )
        )  # fmt: skip
    return tuple(sorted(out, key=lambda size: (size.effect, size.joint or 0, size.parameter)))
