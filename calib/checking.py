"""Is this calibration good? The whole chain on one dataset, each link with what was found and whether it holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calib.calibration import Calibration, calibrate, declared_sigma_mm, structural_rank
from calib.corners import CornerSearch
from calib.dataset import Dataset
from calib.diagnosis import Diagnosis, diagnose
from calib.errors import FitError
from calib.explanation import verdict_words
from calib.fitting_together import does_not_belong
from calib.measurement import failed_searches, with_corners
from calib.repeatability import Repeats, find_repeats, pooled_sigma_mm
from calib.sigma_check import is_declared

HOPELESS = 100.0
"""A residual this many times the declared sigma is no calibrated arm, whatever the improvement."""


@dataclass(frozen=True)
class Finding:
    """One link of the chain. `passed` is None for what is told, not judged."""

    name: str
    passed: bool | None
    words: str


@dataclass(frozen=True)
class Check:
    """All findings on a dataset. It passes where none failed."""

    dataset: Dataset  # with the points that were judged
    findings: tuple[Finding, ...]
    calibration: Calibration | None
    repeats: tuple[Repeats, ...]
    diagnosis: Diagnosis | None = None  # where the fit leaves enough to judge a cause by

    @property
    def passed(self) -> bool:
        return all(finding.passed is not False for finding in self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it did not pass."""
        return tuple(f"{f.name}: {f.words}" for f in self.findings if f.passed is False)

    def summary(self) -> str:
        marks = {True: "ok  ", False: "FAIL", None: "note"}
        lines = [f"{marks[f.passed]}  {f.name}: {f.words}" for f in self.findings]
        return "\n".join([*lines, f"{self.dataset.name}: {'passed' if self.passed else 'NOT GOOD ENOUGH'}"])


def check(
    dataset: Dataset,
    searches: Mapping[str, CornerSearch] | None = None,
    *,
    residual: str = "position",
    max_test_rmse_mm: float | None = None,
    on_step: Callable[[str], None] | None = None,
) -> Check:
    """Judge a dataset from its corners to its held-out error, and tell what is missing from the model.

    Args:
        searches: of the scans, by pose id, where the points come from them.
        max_test_rmse_mm: what the 3D error of the test poses may be; without it, it has to be less than before.
        on_step: hears a line of words before each stage of the diagnosis.
    """
    findings = [Finding("dataset", None, warning) for warning in dataset.warnings]
    if searches:
        findings.append(_corners(searches))
        dataset = with_corners(dataset, searches, orientation=residual == "pose")
    repeats = find_repeats(dataset)
    if repeats:
        findings.append(_repeats(dataset, repeats))
    calibration = diagnosis = None
    different = len(np.unique(np.round(dataset.poses.q[~dataset.poses.is_test], 9), axis=0))
    knowable = structural_rank(dataset.robot)
    if 3 * different - 6 <= knowable:
        findings.append(
            Finding(
                "fit",
                None if repeats else False,
                f"not tried: {different} different training poses cannot settle {knowable} knowable parameters",
            )
        )
    else:
        calibration = calibrate(dataset, residual=residual)
        findings += _fit(calibration, max_test_rmse_mm)
        try:
            diagnosis = diagnose(dataset, on_step=on_step)
            findings.append(Finding("diagnosis", None, verdict_words(diagnosis).removeprefix("Verdict: ")))
        except FitError as error:  # a fit that leaves no equation to judge by is told of, it is no failure
            findings.append(Finding("diagnosis", None, f"not tried: {error}"))
    return Check(dataset, tuple(findings), calibration, repeats, diagnosis)


def _corners(searches: Mapping[str, CornerSearch]) -> Finding:
    failed = failed_searches(searches)
    if failed:
        first, reason = next(iter(failed.items()))
        words = f"{len(failed)} of {len(searches)} scans have none; the first, {first}: {reason}"
        return Finding("corners", False, words)
    sigmas = [search.corner.sigma_mm() for search in searches.values() if search.corner is not None]
    return Finding(
        "corners", True, f"found in all {len(searches)} scans, median sigma {float(np.median(sigmas)):.4f} mm"
    )


def _repeats(dataset: Dataset, repeats: tuple[Repeats, ...]) -> Finding:
    sigma_mm = pooled_sigma_mm(repeats)
    words = f"{len(repeats)} places measured again and again: one coordinate's sigma is {sigma_mm:.4f} mm"
    hopeless = is_declared(dataset) and sigma_mm > HOPELESS * declared_sigma_mm(dataset)
    if hopeless:
        words += f", {sigma_mm / declared_sigma_mm(dataset):.3g} times the declared: these are not points of one place"
    return Finding("repeats", False if hopeless else None, words)


def _fit(calibration: Calibration, max_test_rmse_mm: float | None) -> list[Finding]:
    fit = calibration.fit
    findings = [Finding("fit", fit.converged, fit.summary())]
    findings += [Finding("fit", None, note) for note in calibration.after.notes]
    train, test, before = calibration.after.train, calibration.after.test, calibration.before.test
    if test is None or before is None:
        words = "no pose has the role test, so nothing says how good this is away from the training poses"
        findings.append(Finding("test poses", False if max_test_rmse_mm is not None else None, words))
        return findings
    fall = (
        f"RMSE {before.rmse_mm:.4g} -> {test.rmse_mm:.4g} mm, max {before.max_mm:.4g} -> {test.max_mm:.4g} mm"
    )
    if max_test_rmse_mm is None:
        findings.append(Finding("test poses", test.rmse_mm < before.rmse_mm, fall))
    else:
        good = test.rmse_mm <= max_test_rmse_mm
        findings.append(Finding("test poses", good, f"{fall}; {max_test_rmse_mm:g} mm was asked for"))
    if train is not None and train.rmse_mm > 0.0:
        ratio = test.rmse_mm / train.rmse_mm
        meaning = (
            "" if ratio < 1.5 else ": too many parameters for the poses, or physics that is not in the model"
        )
        findings.append(
            Finding("test against training", None, f"{ratio:.2f} times the training error{meaning}")
        )
    if np.isfinite(fit.noise):
        meaning = ""
        declared = is_declared(calibration.dataset)
        ratio_words = f", {fit.noise:.3g} times the declared sigma" if declared else "; no sigma is declared"
        doubt = does_not_belong(calibration)
        if not doubt and declared and fit.noise > HOPELESS:
            doubt = (
                "the model does not describe these data; check joint signs, units and the order of the poses"
            )
        if doubt:
            meaning = f": {doubt}"
        elif declared and fit.noise > 1.5:
            meaning = ": more than noise is left; something is missing from the model, or sigma was declared too small"
        findings.append(
            Finding(
                "residual",
                False if doubt else None,
                f"{calibration.sigma_mm:.4g} mm a coordinate{ratio_words}{meaning}",
            )
        )
    return findings
