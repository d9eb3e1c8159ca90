"""Processing of one dataset of a fleet by a worker: corners, fit, diagnosis, and the row of the fleet's table."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import numpy as np

import calib
from calib.api.validation import check
from calib.calibration.evaluation import Evaluation
from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, points_from_corners
from calib.dataset.files.fingerprint import fingerprint
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.causes import main_value, moved_mm
from calib.diagnosis.headline import headline_of
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import family_name
from calib.extras.fleet.row import EffectSize, Rmse, Row
from calib.measurement.measured_points import failed_searches, found_corners, require_corners
from calib.options import FitOptions
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.strict_json import to_json
from calib.targets.batch import find_targets
from calib.validation.acceptance import Check, TooFewPoses

LONGEST_REASON = 400  # characters
PACKAGES = ("numpy", "scipy", "pandas")


@dataclass(frozen=True)
class FleetOptions:
    """Options for the processing of each dataset of a fleet."""

    fit: FitOptions = field(default_factory=FitOptions)
    max_test_rmse_mm: float | None = None  # largest error of the test poses; None: less than that of the nominal robot


@dataclass(frozen=True)
class Task:
    """Task of processing one dataset, given by its path; the worker reads the files."""

    folder: str  # of the fleet
    path: str  # of the dataset below it
    options: FleetOptions
    known: str = ""  # key of the row of an earlier run


@dataclass(frozen=True)
class FoundCorners:
    """Corners that were found in scans, one per pose."""

    poses: tuple[str, ...]  # (K,) ids
    xyz_mm: tuple[tuple[float, ...], ...]  # (K, 3)
    covariance_mm2: tuple[tuple[float, ...], ...]  # (K, 9)

    def as_points_of(self, dataset: Dataset) -> Dataset:
        """Dataset with these corners as its measured points."""
        xyz = dict(zip(self.poses, self.xyz_mm, strict=True))
        spread = zip(self.poses, self.covariance_mm2, strict=True)
        covariance = {pose: np.reshape(values, (3, 3)) for pose, values in spread}
        return dataset.with_points(points_from_corners(dataset, xyz, covariance))


@dataclass(frozen=True)
class Judged:
    """Result of processing one dataset: its row of the table, with key, corners and duration."""

    key: str  # hash of the files, options and versions that the row depends on
    row: Row
    corners: FoundCorners | None  # where the dataset has scans
    seconds: float


def one_line(words: str) -> str:
    """A text as one line of bounded length."""
    line = " ".join(words.split())
    return line if len(line) <= LONGEST_REASON else f"{line[: LONGEST_REASON - 3]}..."


def judge(task: Task) -> Judged | None:
    """Row of the fleet's table for one dataset; None where that of an earlier run is still valid."""
    started = perf_counter()
    dataset = load_dataset(Path(task.folder) / task.path)
    key = row_key(fingerprint(dataset), task.options)
    if key == task.known:
        return None
    searches = None
    if dataset.points is None:
        searches = find_targets(dataset, intermediate=False)
        require_corners(dataset, searches)
    options = task.options
    checked = check(dataset, searches, options.fit, max_test_rmse_mm=options.max_test_rmse_mm)
    corners = None
    if searches is not None:
        found = found_corners(searches)
        corners = FoundCorners(
            tuple(found),
            tuple(tuple(c.xyz_mm.tolist()) for c in found.values()),
            tuple(tuple(c.covariance_mm2.ravel().tolist()) for c in found.values()),
        )
    without = tuple(failed_searches(searches)) if searches is not None else ()
    return Judged(key, row_of(task.path, checked, without), corners, perf_counter() - started)


def row_of(path: str, checked: Check, without_corner: tuple[str, ...] = ()) -> Row:
    """Row of the fleet's table for a checked dataset."""
    dataset, found = checked.dataset, checked.diagnosis
    links, last = _fits(checked)
    about = dict(_flat("", dataset.about.extra))
    if dataset.about.operator:
        about["operator"] = dataset.about.operator
    stood_out = () if last is None else last.outliers
    if found is not None:
        stood_out = (*stood_out, *found.steps[-1].left_out)
    told = None if last is None else headline_of([last])
    words = "" if found is None else found.headline
    if found is None:
        tried = (i for i in checked.items if i.name == "diagnosis" or isinstance(i.evidence, TooFewPoses))
        words = next((item.headline for item in tried), "")
    return Row(
        path=path,
        name=dataset.name,
        serial=dataset.about.serial,
        site=dataset.about.site,
        date=dataset.about.date,
        about=dict(sorted(about.items())),
        robot=dataset.robot.name,
        joints=dataset.robot.n_joints,
        poses=len(dataset.poses),
        points=0 if dataset.points is None else len(dataset.points),
        left_out=tuple(dict.fromkeys([*without_corner, *stood_out])),
        train=_rmse(links, last, test=False),
        test=_rmse(links, last, test=True),
        noise_ratio=None if told is None or told.noise.source == FIT else told.noise_ratio,
        passed=checked.passed,
        reasons=tuple(one_line(f"{item.name}: {item.headline}") for item in checked.failed),
        verdict="" if found is None else found.verdict,
        missing=() if found is None else found.missing,
        suspected=() if found is None else found.suspected,
        ambiguous=() if found is None else found.ambiguous_set,
        sizes=() if found is None else sizes_of(found),
        likely={} if found is None else {name: round(found.probabilities.of(name), 4) for name in found.named},
        words=one_line(words),
    )


def _fits(checked: Check) -> tuple[Calibration | None, Calibration | None]:
    """Fit of the link errors alone, and last fit of the diagnosis."""
    if checked.diagnosis is not None:
        return checked.diagnosis.steps[0].calibration, checked.diagnosis.calibration
    return checked.calibration, checked.calibration


def _rmse(links: Calibration | None, last: Calibration | None, *, test: bool) -> Rmse:
    def of(evaluation: Evaluation | None) -> float | None:
        figures = None if evaluation is None else evaluation.test if test else evaluation.train
        return None if figures is None else figures.rmse_mm

    return Rmse(
        of(None if last is None else last.before),
        of(None if links is None else links.after),
        of(None if last is None else last.after),
    )


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


def _flat(prefix: str, values: Mapping[str, object]) -> list[tuple[str, str]]:
    """Nested tables as pairs of texts, with keys joined by dots: ("gears.J3", "lot 17")."""
    out: list[tuple[str, str]] = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            out += _flat(f"{prefix}{key}.", value)
        elif isinstance(value, str | int | float):
            out.append((f"{prefix}{key}", one_line(str(value))))
    return out


# ---- keys -----------------------------------------------------------------------------------------------------------


def row_key(files: Mapping[str, str], options: FleetOptions) -> str:
    """Hash of everything that determines a row: the dataset's files, the options, this program and its libraries."""
    asked = {"fit": asdict(options.fit), "max_test_rmse_mm": options.max_test_rmse_mm}
    return _hash({"files": dict(sorted(files.items())), "asked": asked, "versions": versions()})


def pair_key(base: str, later: str) -> str:
    """Hash of everything that determines the comparison of two datasets, from the keys of their rows."""
    return _hash({"base": base, "later": later})


def _hash(document: Mapping[str, object]) -> str:
    return hashlib.sha256(to_json(document).encode()).hexdigest()


@cache
def versions() -> dict[str, str]:
    """Versions of Python and the libraries, and a hash of this program's files."""
    digest = hashlib.sha256()
    root = Path(calib.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    libraries = {name: version(name) for name in PACKAGES}
    return {"program": digest.hexdigest(), "python": platform.python_version(), **libraries}
