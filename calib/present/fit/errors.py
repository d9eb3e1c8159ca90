"""What is told of errors: the headline, how a change of the model moves them, tables, the promise for new poses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.model_versions import NOMINAL, Version
from calib.calibration.noise_level import FIT, NoiseLevel, SigmaCheck, noise_level
from calib.calibration.promise import PointPromise
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.headline import Headline
from calib.models.exported_table import ExportedTable
from calib.models.model_document import RoleErrors
from calib.present import names
from calib.rendering import blocks, numbers
from calib.rendering.blocks import Block, Coloured, FigurePlace, Paragraph, Table, Verdict, Words
from calib.rendering.colours import BAD, GOOD, NEUTRAL
from calib.statistics import rms

COVERAGE = "90 % intervals"
HELD_OUT = "held-out test poses"
_MICROMETRES_BELOW_MM = 0.1
_FIGURES = {  # of an evaluation, by attribute
    "rmse_mm": "3D RMSE",
    "mean_mm": "3D mean",
    "max_mm": "3D max",
    "distance_mean_mm": "distance mean",
    "distance_max_mm": "distance max",
}
_CHANGES = ("before", "after", "reduction")
_SMALL_CHANGE = 0.03  # share of an error below which a change of it counts as none


# ---- the headline ---------------------------------------------------------------------------------------------------


def error_headline(headline: Headline, *, unexplained: bool = False) -> blocks.Headline:
    """Headline block with the errors of all stages, the noise, and the note.

    unexplained: whether a diagnosis found that not all of what is left is noise, whatever its size.
    """
    stages = [(length(headline, stage.error_mm), stage.name) for stage in headline.stages]
    told = note(headline, unexplained=unexplained)
    return blocks.Headline(stages, noise(headline), told, headline.reached_noise and not unexplained)


def _unit(headline: Headline) -> tuple[str, float]:
    """Unit for all lengths of one headline, "mm" or "µm", and the number of these in a millimetre."""
    largest_mm = max(stage.error_mm for stage in headline.stages)
    return ("µm", 1e3) if largest_mm < _MICROMETRES_BELOW_MM else ("mm", 1.0)


def length(headline: Headline, length_mm: float) -> str:
    """A length in the headline's unit: "0.72 mm"."""
    unit, per_mm = _unit(headline)
    return f"{numbers.digits(per_mm * length_mm)} {unit}"


def noise(headline: Headline) -> str:
    """Phrase with the noise of a headline: "noise 0.0062 mm", or "noise as the fit left it 0.21 mm: not declared"."""
    if headline.noise_mm is None:
        return "noise not declared"
    told = length(headline, headline.noise_mm)
    return f"noise {told}" if headline.noise.is_declared else f"{headline.noise.name} {told}: not declared"


def note(headline: Headline, *, unexplained: bool = False) -> str:
    """Sentences on the poses to which a headline's errors refer, and on whether noise alone is left."""
    error = "3D error" if headline.noise.coordinates == len("xyz") else "Error of the measured lengths"
    at = HELD_OUT if headline.of_test_poses else "the fitted poses: there are no test poses, so nothing confirms it"
    of = f"{error} (RMS) at {at}."
    if headline.tool is not None:
        of += (
            f" The tool point was found {numbers.digits(headline.tool.off_mm)} mm from where robot.toml has it: not an "
            "arm error, excluded from these figures."
        )
    if headline.fits_links and headline.stages[-1].error_mm > headline.stages[0].error_mm:
        of += " It rose: the fit is worse than robot.toml as it was, so do not use it."
    return f"{of} {_left(headline, unexplained=unexplained)}"


def _left(headline: Headline, *, unexplained: bool) -> str:
    """Sentence that compares the last error with the noise."""
    ratio = headline.noise_ratio
    if ratio is None or headline.noise_mm is None:
        return "No noise was declared to compare it with."
    if headline.noise.source == FIT:
        return (
            f"No noise was declared; estimated from the fit it is {length(headline, headline.noise_mm)}, which "
            f"includes what is missing from the model; the error is {numbers.times(ratio)} that."
        )
    if headline.reached_noise and unexplained:
        return "By its size what is left could be noise; the verdict says why not all of it is."
    return f"What is left is {'no more than noise' if headline.reached_noise else f'{numbers.times(ratio)} the noise'}."


def errors_by_stage(headline: Headline, fits: Sequence[Calibration]) -> Table:
    """Mean, RMS and maximum of the 3D error at each stage of a headline, in one unit."""
    columns: list[Figures] = []
    for stage in headline.stages:
        evaluation = fits[-1].before if stage.step is None else fits[stage.step].after
        figures = evaluation.test if headline.of_test_poses else evaluation.train
        assert figures is not None
        columns.append(figures)
    unit, per_mm = _unit(headline)
    shown = {"mean": "mean_mm", "RMS": "rmse_mm", "maximum": "max_mm"}
    rows = [(name, *(numbers.digits(per_mm * getattr(f, key)) for f in columns)) for name, key in shown.items()]
    if headline.noise_mm is not None:
        before_last = [""] * (len(columns) - 1)
        rows.append((f"{headline.noise.name}, RMS", *before_last, numbers.digits(per_mm * headline.noise_mm)))
    of = HELD_OUT if headline.of_test_poses else "the fitted poses"
    headers = (f"3D error, {unit}", *(stage.name for stage in headline.stages))
    caption = f"Errors at {of} ({numbers.count(columns[0].points, 'point')}), all in {unit}"
    return Table(headers, rows, caption=caption)


# ---- a change of the error ------------------------------------------------------------------------------------------


class RoleRmse(Protocol):
    """3D RMSE of one model, mm, at training poses and at test poses."""

    @property
    def train_rmse_mm(self) -> float:
        """3D RMSE of the training poses; nan without any."""

    @property
    def test_rmse_mm(self) -> float:
        """3D RMSE of the test poses; nan without any."""


class ModelErrors(RoleRmse, Protocol):
    """Errors of one model in a sequence of models fitted one after the other."""

    @property
    def label(self) -> str:
        """Label of the change that made the model: "link errors", "+ backlash", "− backlash"."""

    @property
    def other_poses(self) -> bool:
        """Whether the errors are of other poses than the previous model's, so that the two cannot be compared."""


@dataclass(frozen=True)
class ErrorChange:
    """Change of the 3D RMSE from one model to another, mm, at the poses of one role ("train" or "test")."""

    role: str
    before_mm: float
    after_mm: float
    can_be_confirmed: bool = True  # else there are no test poses

    @staticmethod
    def between(before: RoleRmse, after: RoleRmse) -> ErrorChange:
        """Change at the test poses, or at the training poses where there are no test poses."""
        if math.isfinite(before.test_rmse_mm) and math.isfinite(after.test_rmse_mm):
            return ErrorChange("test", before.test_rmse_mm, after.test_rmse_mm)
        return ErrorChange("train", before.train_rmse_mm, after.train_rmse_mm, can_be_confirmed=False)

    @property
    def is_known(self) -> bool:
        """Whether both errors are known and the first is not zero."""
        return self.before_mm > 0.0 and math.isfinite(self.after_mm)

    @property
    def share(self) -> float:
        """Change over the error before, less than zero where it falls."""
        return self.after_mm / self.before_mm - 1.0

    @property
    def is_small(self) -> bool:
        """Whether the change counts as none."""
        return abs(self.share) < _SMALL_CHANGE

    @property
    def poses(self) -> str:
        """Name of the poses."""
        return HELD_OUT if self.role == "test" else f"{names.role(self.role)} poses"

    def words(self) -> str:
        """Clause: "the error of the held-out test poses falls by 46 %, from 0.65 to 0.35 mm"; "" where unknown."""
        if not self.is_known:
            return ""
        by = numbers.share(abs(self.share))
        goes = "hardly changes" if self.is_small else f"falls by {by}" if self.share < 0.0 else f"rises by {by}"
        unconfirmed = "" if self.can_be_confirmed else "; no test poses confirm it"
        change = numbers.length_change(self.before_mm, self.after_mm)
        return f"the error of the {self.poses} {goes}, {change}{unconfirmed}"


def last_change(models: Sequence[ModelErrors]) -> Verdict | None:
    """Verdict whether the last change of the model lowered the errors; None without a change or an error."""
    if len(models) < 2:
        return None
    label, change = models[-1].label, ErrorChange.between(*models[-2:])
    if not change.is_known:
        return None
    if models[-1].other_poses:
        of = f"the error of the {change.poses} that count now"
        return Verdict(f"{label}: {of} is {numbers.length(change.after_mm)}.", NEUTRAL)
    words = f"{label}: {change.words()}."
    if change.share < 0.0 and not change.is_small:
        return Verdict(words, GOOD)
    helps_not = "It does not help; Undo takes it out again."
    if label.startswith("−"):
        helps_not = "It was not needed." if change.is_small else "It was needed; Undo brings it back."
    return Verdict(f"{words} {helps_not}", NEUTRAL if change.is_small else BAD)


# ---- tables ---------------------------------------------------------------------------------------------------------


def error_tables(calibration: Calibration, colours: Mapping[str, str] | None = None) -> list[Block]:
    """Tables of all errors before and after, including those of the jig's orientation where full poses were fitted.

    colours: of training and test poses in figures, by role.
    """
    attitudes: list[tuple[Words, ...]] = []
    if calibration.orientation_errors is not None:
        before, after = calibration.orientation_errors
        attitudes = [
            (_of_role(role, name, colours), f"{was:.4f}", f"{now:.4f}", numbers.reduction(was, now))
            for role, first, last in _by_role(before, after)
            for key, name in (("rmse_rad", "RMSE"), ("max_rad", "max"))
            for was, now in [(1e3 * getattr(first, key), 1e3 * getattr(last, key))]
        ]
    return [
        error_table(calibration.before, calibration.after, colours),
        Paragraph("Distances are to the reference pose.", soft=True),
        Table(("attitude of the jig, mrad", *_CHANGES), attitudes),
    ]


def _by_role(before: Any, after: Any) -> Iterator[tuple[str, Any, Any]]:
    """Errors before and after, of training and of test poses, where both are known."""
    for role in ("train", "test"):
        first, last = getattr(before, role), getattr(after, role)
        if first is not None and last is not None:
            yield role, first, last


def error_table(
    before: Evaluation | RoleErrors,
    after: Evaluation | RoleErrors,
    colours: Mapping[str, str] | None = None,
    test: str = "test",
) -> Table:
    """Table of 3D and distance errors before and after, of training and test poses (or as `test` names them)."""
    rows = [
        (
            _of_role(test if role == "test" else role, name, colours),
            *map(numbers.column_mm, (was, now)),
            numbers.reduction(was, now),
        )
        for role, first, last in _by_role(before, after)
        for key, name in _FIGURES.items()
        for was, now in [(float(getattr(first, key)), float(getattr(last, key)))]
    ]
    return Table(("errors, mm", *_CHANGES), rows)


def _of_role(role: str, figure: str, colours: Mapping[str, str] | None) -> str | Coloured:
    words = f"{names.role(role)} {figure}"
    return words if colours is None else Coloured(words, colours[role])


def pose_errors(calibration: Calibration) -> FigurePlace:
    """Placeholder of the figure of each pose's error."""
    caption = "3D error of each pose after the fit, with everything in the model: predicted minus measured, length."
    return FigurePlace("error_bars", (calibration,), caption, height_px=280)


def history_caption(calibration: Calibration) -> str:
    """Caption of the figure of the errors after each change of a model, of which `calibration` is the last fit."""
    level, has_tests = noise_level(calibration), calibration.after.test is not None
    roles = "training and test poses" if has_tests else "the fitted poses"
    noise = ""
    if level.floor_mm is not None:
        noise = f"; {'grey band: where 95 % of such test errors lie by' if has_tests else 'dashed:'} {level.name}"
    points = "; points: single test poses" if has_tests else ""
    return f"3D RMSE of {roles} after each change of the model{noise}{points}."


def step_table(steps: Sequence[FitStep], *, as_delivered: bool = False) -> Table:
    """Table of the errors after each change of the model, and of the added effect's log Bayes factor over the next.

    as_delivered: whether a row with the errors before any fit comes first.
    """
    before = steps[-1].calibration.before
    rows: list[tuple[str, RoleRmse, float, float | None]] = [(NOMINAL, before, math.nan, None)]
    rows = rows if as_delivered else []
    rows += [(s.label, s.calibration.after, s.calibration.sigma_mm, s.log_bayes_factor) for s in steps]
    return Table(
        ("model", "training, mm", "test, mm", "residual sigma, mm", "log Bayes factor"),
        [
            (
                label,
                *map(numbers.column_mm, (errors.train_rmse_mm, errors.test_rmse_mm, sigma_mm)),
                numbers.MISSING if factor is None else f"{factor:.0f}",
            )
            for label, errors, sigma_mm, factor in rows
        ],
        caption="3D RMSE; the sigma is per coordinate, by degrees of freedom",
    )


def _floor(level: NoiseLevel) -> str:
    return "not declared" if level.floor_mm is None else numbers.column_mm(level.floor_mm)


def errors_by_version(versions: Sequence[Version], colours: Mapping[str, str]) -> Table:
    """Table of RMSE and largest 3D error of each version of a model, mm, and of noise alone."""
    rows: list[tuple[Words, ...]] = []
    for version in versions:
        of_roles = (version.evaluation.train, version.evaluation.test)
        cells = [numbers.column_mm(getattr(f, key, None)) for f in of_roles for key in ("rmse_mm", "max_mm")]
        rows.append((Coloured(version.name, colours[version.name]), *cells))
    level, has_tests = noise_level(versions[-1].calibration), versions[-1].evaluation.test is not None
    of_test = _floor(level) if level.floor_mm is not None and has_tests else numbers.MISSING
    rows.append((level.name, _floor(level), numbers.MISSING, of_test, numbers.MISSING))
    return Table(("model", "training", "max", "test", "max"), rows)


def pose_error_by_version(versions: Sequence[Version], pose: int, colours: Mapping[str, str]) -> Table:
    """Table of predicted minus measured at one pose by each version of a model, mm, where it has an error there."""
    errors = [(version.name, version.pose_error_vectors_mm()[pose]) for version in versions]
    rows = [
        (
            Coloured(name, colours[name]),
            *(numbers.signed(float(e), "+.4f") for e in error),
            numbers.column_mm(float(np.linalg.norm(error))),
        )
        for name, error in errors
        if np.isfinite(error).all()
    ]
    return Table(("model", "x", "y", "z", "length"), rows)


# ---- sentences ------------------------------------------------------------------------------------------------------


def table_alone(table: ExportedTable) -> list[Block]:
    """Paragraph with the errors of robot.toml's table alone and of the full model; [] for a model without effects."""
    return [Paragraph(f"What robot.toml can hold, {table.comment}.")] if table.comment else []


def sigma_sentence(check: SigmaCheck) -> str:
    """Sentence with the residual sigma, its 95 % interval and the declared sigma, and what the comparison means."""
    if not math.isfinite(check.sigma_mm):
        return "Residual sigma: no degree of freedom is left to estimate it."
    low, high = numbers.length(check.low_mm), numbers.length(check.high_mm)
    found = (
        f"Residual sigma {numbers.length(check.sigma_mm)} per coordinate (95 %: {low} to {high}, "
        f"{check.degrees_of_freedom:.0f} degrees of freedom)"
    )
    if check.declared_mm is None:
        return f"{found}; no sigma is declared, so this holds noise and missing physics together."
    meaning = {
        "excess": "more than noise is left: physics is missing from the model, or sigma was declared too small",
        "as declared": "nothing but noise is left",
        "below": "less than declared: sigma was declared too large",
    }[check.verdict]
    times = numbers.times(check.sigma_mm / check.declared_mm)
    return f"{found}, {times} the declared {numbers.length(check.declared_mm)}: {meaning}."


# ---- the promise for poses that no fit saw --------------------------------------------------------------------------


def coverage_words(promise: PointPromise) -> str:
    """Words on the promised sigma and its coverage: "cover 91 % of 900 test coordinates (sigma 0.07 mm)"; or ""."""
    share = promise.coverage_90
    if share is None:
        return ""
    sigma_mm = rms(promise.sigma_mm[promise.is_test])
    count = promise.error_mm[promise.is_test].size
    of_points = f"promised sigma {numbers.length(sigma_mm)} per coordinate"
    return f"cover {100.0 * share:.0f} % of {count} test coordinates; {of_points}"


def coverage_sentence(promise: PointPromise) -> str:
    """Sentence on the coverage of 90 % intervals; "" without test poses."""
    words = coverage_words(promise)
    return f"{COVERAGE} of the error {words}." if words else ""


def promise_document(promise: PointPromise, poses: Poses) -> dict[str, Any]:
    """JSON keys of all measured points with the sigma promised for a pose that no fit saw, and the coverage."""
    return {
        "poses": [
            {"pose": poses.ids[pose], "role": poses.role[pose], "target": target, "error_mm": error, "sigma_mm": sigma}
            for pose, target, error, sigma in zip(
                promise.pose, promise.target.tolist(), promise.error_mm, promise.sigma_mm, strict=True
            )
        ],
        "coverage_90": promise.coverage_90,
    }
