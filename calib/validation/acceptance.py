"""Acceptance of a dataset (`check`): every step from the corners to the held-out error, and whether it passes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from calib.calibration.calibrate import calibrate
from calib.calibration.evaluation import Figures
from calib.calibration.held_out import held_out_test
from calib.calibration.noise_level import FIT, NoiseLevel, check_sigma, noise_level
from calib.calibration.plausibility import implausibility_reason, outlier_hint, too_good
from calib.calibration.result import Calibration, declared_sigma_mm, is_declared
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.dataset.repeats import Repeats, find_repeats, pooled_sigma_mm, scatter_against_covariances
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words.conclusion_text import promise_text, verdict_text
from calib.diagnosis.words.phrases import listed
from calib.display.brief import Brief
from calib.display.shown import Documented
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Family
from calib.errors import FitError
from calib.identifiability.structural import fewest_poses
from calib.measurement.measured_points import failed_searches, with_corners
from calib.options import FitFields, FitOptions, fit_options
from calib.scans.scan import PointCount
from calib.targets.batch import find_targets
from calib.targets.search import ScanSearch
from calib.validation.cross_validation import SUSPICIOUS, noise_ratio
from calib.validation.remounting import remounting
from calib.validation.splits import training_groups

MAX_SIGMA_RATIO = 100.0
"""Residual sigma over the declared sigma, beyond which the arm is not calibrated, whatever the improvement."""
MIN_SIGMA_RATIO = 1.0 / 1.5  # ratio below which sigma was declared too large, unless by chance
MAX_LEFT_RATIO = 10.0
"""Largest ratio for the model at the end of the diagnosis; above it the residual has an unknown cause."""
UNSETTLED = ("unexplained", "ambiguous", "outliers")
"""Verdicts that are a warning: the residual has a cause without a name."""
_NO_NOISE_MM = 1e-6  # floor where no noise is declared
_MORE_SCATTER, _BY_CHANCE = 1.5, 0.001  # scatter of repeats over their covariances, and its p-value, for a warning
MAX_SHARE_DROPPED = 0.5  # share of a scan's points without a value; more is a warning


@dataclass(frozen=True)
class CheckItem:
    """Result of one step of a check. `passed` is None for a note or a warning."""

    name: str
    passed: bool | None
    description: str
    warning: bool = False

    @property
    def status(self) -> str:
        """Four characters at the start of the item's line: ok, FAIL, WARN or note."""
        if self.passed is None:
            return "WARN" if self.warning else "note"
        return "ok  " if self.passed else "FAIL"


@dataclass(frozen=True)
class Check(Brief, Documented):
    """Items of a dataset's check; it passes where none failed."""

    dataset: Dataset  # with the points that were judged
    items: tuple[CheckItem, ...]
    calibration: Calibration | None
    repeats: tuple[Repeats, ...]
    diagnosis: Diagnosis | None = None  # where the fit leaves degrees of freedom for one

    @property
    def passed(self) -> bool:
        """Whether no item failed."""
        return all(item.passed is not False for item in self.items)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The items that failed, as text."""
        return tuple(f"{f.name}: {f.description}" for f in self.items if f.passed is False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The items that are warnings, as text: they do not decide."""
        return tuple(f"{f.name}: {f.description}" for f in self.items if f.warning)

    def summary(self) -> str:
        """One line per item, then whether the dataset passed."""
        lines = [f"{f.status}  {f.name}: {f.description}" for f in self.items]
        count = len(self.warnings)
        more = f", with {count} warning{'s' if count > 1 else ''}" if count else ""
        return "\n".join([*lines, f"{self.dataset.name}: {'passed' if self.passed else 'NOT GOOD ENOUGH'}{more}"])

    def _brief(self) -> str:
        failed = ", ".join(item.name for item in self.items if item.passed is False)
        verdict = "passed" if self.passed else f"failed: {failed}"
        return f"{self.dataset.name}: {verdict}, {len(self.warnings)} warnings"


def check(
    dataset: Dataset | str | Path,
    searches: Mapping[str, CornerSearch] | None = None,
    options: FitOptions | None = None,
    *,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    max_test_rmse_mm: float | None = None,
    on_step: Callable[[str], None] | None = None,
    **keywords: Unpack[FitFields],
) -> Check:
    """Acceptance of a dataset: every step from its corners to its held-out error, and a diagnosis, passed or failed.

    Args:
        dataset: a dataset or its folder.
        searches: searches of its scans by pose id, where it has no points; None: the scans are searched first.
        options: options of the fit; the diagnosis is of positions.
        effects: effects that are in the model: names of the catalogue, families, or single members.
        user_effects: families beyond the catalogue.
        max_test_rmse_mm: largest 3D RMSE of the test poses that passes; None: any below that of the nominal robot.
        on_step: called with a line of text before each stage of the diagnosis.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    >>> import calib
    >>> calib.check("sample_data/hidden_effect_a")
    Check(hidden_effect_a: passed, 1 warnings)
    """
    options, dataset = fit_options(options, keywords), as_dataset(dataset)
    if searches is None and dataset.points is None and dataset.scan_folder is not None:
        searches = find_targets(dataset, intermediate=False)
    items = [CheckItem("dataset", None, warning, warning=True) for warning in dataset.warnings]
    items += [CheckItem("dataset", None, note) for note in dataset.notes]
    if searches:
        items += thin_scans({pose: s.count for pose, s in searches.items() if s.count is not None})
        items.append(_corners(searches))
        dataset = with_corners(dataset, searches, orientation=options.residual == "pose")
    repeats = find_repeats(dataset)
    if repeats:
        items.append(_repeats(dataset, repeats))
    calibration = diagnosis = None
    groups = training_groups(dataset)
    needed = fewest_poses(dataset.robot, residual=options.residual, setups=len(np.unique(groups.setup)))
    if len(groups) < needed:
        words = f"not tried: {len(groups)} different training poses are measured, a fit takes at least {needed}"
        items.append(CheckItem("fit", None if repeats else False, words))
    else:
        calibration = calibrate(dataset, options, effects=effects_named(dataset, effects, user_effects))
        items += _repeat_notes(dataset, calibration.fitted_dataset)
        items += _fit(calibration, max_test_rmse_mm)
        try:
            diagnosis = diagnose(
                dataset,
                options.with_residual("position"),
                effects=effects,
                user_effects=user_effects,
                on_step=on_step,
            )
            tied = listed(diagnosis.ambiguous_set, "or")  # a check lists no reasons
            words = verdict_text(diagnosis.explanation.verdict, reasons="by inspector diagnose", tied=tied)
            if diagnosis.data_problem is not None:
                items.append(CheckItem("data", False, diagnosis.data_problem.words))
            else:
                items.append(CheckItem("diagnosis", None, words, warning=diagnosis.verdict in UNSETTLED))
                items += _left_by_diagnosis(diagnosis)
                items += _promise(diagnosis)
        except FitError as error:  # no degree of freedom is left: a note, no failure
            items.append(CheckItem("diagnosis", None, f"not tried: {error}"))
    return Check(dataset, tuple(items), calibration, repeats, diagnosis)


def _repeat_notes(given: Dataset, fitted: Dataset) -> list[CheckItem]:
    """Warnings and notes that the fit added on repeats, where it took their mean."""
    warnings, notes = fitted.warnings[len(given.warnings) :], fitted.notes[len(given.notes) :]
    return [
        *(CheckItem("dataset", None, warning, warning=True) for warning in warnings),
        *(CheckItem("dataset", None, note) for note in notes),
    ]


def thin_scans(counts: Mapping[str, PointCount]) -> list[CheckItem]:
    """A warning where more than half of a scan's points have no value."""
    thin = {pose_id: count for pose_id, count in counts.items() if count.share_dropped > MAX_SHARE_DROPPED}
    if not thin:
        return []
    pose_id, worst = max(thin.items(), key=lambda item: item[1].share_dropped)
    words = (
        f"{len(thin)} of {len(counts)} lose more than half of their points, which have no value; the worst, {pose_id}, "
        f"{worst.dropped} of {worst.points + worst.dropped}; where the jig should be among them, look at the exposure, "
        "the distance and glare"
    )
    return [CheckItem("scans", None, words, warning=True)]


def _corners(searches: Mapping[str, CornerSearch]) -> CheckItem:
    failed = failed_searches(searches)
    if failed:
        first, reason = next(iter(failed.items()))
        words = f"{len(failed)} of {len(searches)} scans have none; the first, {first}: {reason}"
        return CheckItem("corners", False, words)
    sigmas = [
        place.sigma_mm()
        for search in searches.values()
        for place in (search.places if isinstance(search, ScanSearch) else (search.corner,))
        if place is not None
    ]
    return CheckItem(
        "corners", True, f"found in all {len(searches)} scans, median sigma {float(np.median(sigmas)):.4f} mm"
    )


def _repeats(dataset: Dataset, repeats: tuple[Repeats, ...]) -> CheckItem:
    sigma_mm = pooled_sigma_mm(repeats)
    words = f"{len(repeats)} places measured again and again: one coordinate's sigma is {sigma_mm:.4f} mm"
    hopeless = is_declared(dataset) and sigma_mm > MAX_SIGMA_RATIO * declared_sigma_mm(dataset)
    if hopeless:
        words += f", {sigma_mm / declared_sigma_mm(dataset):.3g} times the declared: these are not points of one place"
    scatter = scatter_against_covariances(dataset)
    if scatter is None:
        return CheckItem("repeats", False if hopeless else None, words)
    words += f"; they lie {scatter.ratio:.2f} times as far apart as their covariances say"
    doubtful = scatter.ratio > _MORE_SCATTER and scatter.p_value < _BY_CHANCE
    if doubtful:
        words += ": they lack an error that changes between repeats; declare it as correlated_sigma_mm of [scanner]"
    return CheckItem("repeats", False if hopeless else None, words, warning=doubtful)


def _against_training(calibration: Calibration, train: Figures, test: Figures) -> CheckItem:
    """The test error over the training error, compared with the ratio that noise explains (`noise_ratio`).

    It is a warning where the ratio is larger, unless the test error is no more than the noise, declared or by repeats:
    the training error is then not to be expected elsewhere.
    """
    ratio, expected = test.rmse_mm / train.rmse_mm, noise_ratio(calibration.fit)
    name, words = "test against training", f"{ratio:.2f} times the training error"
    floor_mm = _floor_mm(noise_level(calibration))
    if ratio <= SUSPICIOUS * expected or test.rmse_mm <= SUSPICIOUS * floor_mm:
        return CheckItem(name, None, words)
    after = calibration.after
    error_mm = np.linalg.norm(after.error_mm, axis=1)
    worst = int(np.argmax(np.where(after.is_test[after.pose], error_mm, -1.0)))
    moved = remounting(calibration)
    if moved is not None:
        return CheckItem(name, None, f"{words}, noise explains {expected:.2f}: {moved.words}", warning=True)
    words += (
        f", noise explains {expected:.2f}: expect the test error elsewhere; too few poses, physics that is not in the "
        f"model, or wrong test points, the worst at {calibration.dataset.poses.ids[after.pose[worst]]} with "
        f"{error_mm[worst]:.3g} mm"
    )
    return CheckItem(name, None, words, warning=True)


def _floor_mm(level: NoiseLevel) -> float:
    """Error that noise alone leaves, mm; nearly 0 where the noise is known from the fit's own residual only."""
    return level.floor_mm or _NO_NOISE_MM if level.source != FIT else _NO_NOISE_MM


def _fit(calibration: Calibration, max_test_rmse_mm: float | None) -> list[CheckItem]:
    fit, shift, hint = calibration.fit, calibration.tool_shift, outlier_hint(calibration)
    return [
        CheckItem("fit", fit.converged, fit.summary(declared=is_declared(calibration.dataset))),
        *([] if shift is None else [CheckItem("tool point", None, shift.words, warning=True)]),
        *([CheckItem("outliers", None, hint, warning=True)] if hint else []),
        *(CheckItem("fit", None, note) for note in calibration.after.notes),
        *_test_poses(calibration, max_test_rmse_mm),
        *_residual(calibration),
    ]


def _test_poses(calibration: Calibration, max_test_rmse_mm: float | None) -> list[CheckItem]:
    train, test, before = calibration.after.train, calibration.after.test, calibration.before.test
    asked = max_test_rmse_mm is not None
    if test is None or before is None:
        words = "no pose has the role test, so nothing says how good this is away from the training poses"
        return [CheckItem("test poses", False if asked else None, words, warning=not asked)]
    words = f"RMSE {before.rmse_mm:.4g} -> {test.rmse_mm:.4g} mm, max {before.max_mm:.4g} -> {test.max_mm:.4g} mm"
    if max_test_rmse_mm is None:
        items = [CheckItem("test poses", test.rmse_mm < before.rmse_mm, words)]
    else:
        good = test.rmse_mm <= max_test_rmse_mm
        items = [CheckItem("test poses", good, f"{words}; {max_test_rmse_mm:g} mm was asked for")]
    if train is not None and train.rmse_mm > 0.0:
        items.append(_against_training(calibration, train, test))
    return items


def _promise(diagnosis: Diagnosis) -> list[CheckItem]:
    """Whether the test poses' error is no more than the model at the end of the diagnosis predicts."""
    last, tests = diagnosis.calibration, diagnosis.residual_tests
    noise_mm, noise_from = tests.noise_mm, tests.noise_from
    if last.sigma_mm > noise_mm:  # an excess over the noise has an item of its own; the promise includes it
        noise_mm, noise_from = last.sigma_mm, "fit"
    test = held_out_test(last, noise_mm, noise_from)
    if test is None:
        return []
    if test.is_broken:
        return [CheckItem("promise", False, promise_text(test))]
    words = f"the test poses are off by {test.rmse_mm:.4g} mm, {test.promised_mm:.4g} mm was to be expected"
    return [CheckItem("promise", True, words)]


def _too_good(name: str, calibration: Calibration) -> list[CheckItem]:
    """A failure of a fit that leaves far less than the declared noise; a warning where no noise is declared."""
    words, declared = too_good(calibration), is_declared(calibration.dataset)
    return [CheckItem(name, False if declared else None, words, warning=not declared)] if words else []


def _left_by_diagnosis(diagnosis: Diagnosis) -> list[CheckItem]:
    """A failure where the last model leaves many times the declared noise, or far too little, or is implausible."""
    last = diagnosis.calibration
    doubt = implausibility_reason(last) if last.model.added_effects else ""
    if doubt:
        return [CheckItem("model", False, doubt)]
    if surprise := _too_good("model", last):
        return surprise
    if not is_declared(last.dataset) or not last.fit.reduced_chi > MAX_LEFT_RATIO:
        return []
    what = " with ".join(["the links", *(["all that was found"] if last.model.family_names else [])])
    words = (
        f"{last.sigma_mm:.4g} mm per coordinate are left by {what}, {last.fit.reduced_chi:.3g} times the declared "
        "sigma: the arm is not calibrated to what was measured, or sigma was declared far too small"
    )
    return [CheckItem("noise", False, words)]


def _over_noise_text(calibration: Calibration) -> str:
    """The residual's sigma as a multiple of the noise, as text, and the source of the noise."""
    level = noise_level(calibration)
    if level.is_declared:
        return f", {calibration.fit.reduced_chi:.3g} times the declared sigma"
    if level.source == FIT:
        return f", {level.name}; no sigma is declared"
    ratio = calibration.sigma_mm / level.sigma_mm
    return f", {ratio:.3g} times the {level.name}, {level.sigma_mm:.4g} mm; no sigma is declared"


def _residual(calibration: Calibration) -> list[CheckItem]:
    noise = calibration.fit.reduced_chi
    if not np.isfinite(noise):
        return []
    meaning = ""
    declared = is_declared(calibration.dataset)
    ratio_words = _over_noise_text(calibration)
    doubt = implausibility_reason(calibration)
    if not doubt and (surprise := _too_good("residual", calibration)):
        return surprise
    if not doubt and declared and noise > MAX_SIGMA_RATIO:
        doubt = "the model does not describe these data; check joint signs, units and the order of the poses"
    if doubt:
        meaning = f": {doubt}"
    elif declared and noise > 1.5:
        meaning = ": more than noise is left; something is missing from the model, or sigma was declared too small"
    elif declared and noise < MIN_SIGMA_RATIO and check_sigma(calibration).verdict == "below":
        meaning = ": clearly less than was declared; sigma was declared too large, and small effects are doubted for it"
    words = f"{calibration.sigma_mm:.4g} mm per coordinate{ratio_words}{meaning}"
    return [CheckItem("residual", False if doubt else None, words, warning=bool(meaning) and not doubt)]
