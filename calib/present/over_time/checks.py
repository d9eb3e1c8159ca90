"""Presentation of a check of a dataset: whether it passes, and the finding of each step."""

from __future__ import annotations

from typing import Any

from calib.calibration.held_out import HeldOutTest
from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.calibration.table_doubts import DoubtfulEntry
from calib.consistency.data_problem import DataProblem
from calib.dataset.repeats import repeats_frame
from calib.diagnosis.result import Diagnosis
from calib.fitting.tool_point import ToolShift
from calib.present.diagnosis.verdict import promise, verdict
from calib.present.fit.calibration import fit_sentence, outlier_hint, table_doubt, tool_shift_sentence
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Presentation, Section, Table, Verdict, plain
from calib.rendering.colours import BAD, DOUBT, GOOD
from calib.validation.acceptance import (
    COARSE_CORNER_MM,
    Check,
    CheckItem,
    ErrorRatio,
    ErrorsOfTestPoses,
    FoundCorners,
    MissingCorners,
    OutlyingPoses,
    RepeatScatter,
    ResidualOfDiagnosis,
    ResidualSigma,
    ThinScans,
    TooFewPoses,
)


@presentation.register
def _check(check: Check) -> Presentation:
    return Presentation(
        f"Check of {check.dataset.name}", check_head(check), [Section("Each step", [steps(check)], True)]
    )


@presentation.register
def _item(item: CheckItem) -> Presentation:
    return Presentation(item.name, [Verdict(item_sentence(item), _colour(item.passed is not False, item.warning))])


def check_head(check: Check) -> list[Block]:
    """Blocks with the verdict whether a dataset passes."""
    if (few := check.poses_missing) is not None:
        told = f"the scans are good enough; measure {few.needed} training poses at least, better 40 ({few.poses} now)"
        return [Verdict(f"{check.dataset.name}: {told}.", DOUBT)]
    count = len(check.warnings)
    more = f", with {numbers.count(count, 'warning')}" if count else ""
    verdict = f"{check.dataset.name}: {'passed' if check.passed else 'NOT GOOD ENOUGH'}{more}."
    return [Verdict(verdict, _colour(check.passed, bool(count)))]


def _colour(passed: bool, warned: bool) -> str:
    return BAD if not passed else DOUBT if warned else GOOD


def steps(check: Check) -> Table:
    """Table of the steps of a check, with the finding of each."""
    rows = [(item.status, item.name, item_sentence(item)) for item in check.items]
    return Table(("", "step", "found"), rows, left=(0, 1, 2))


def item_sentence(item: CheckItem) -> str:
    """Sentence with the finding of one step of a check."""
    return _sentence(item.evidence)


def _sentence(evidence: object) -> str:
    match evidence:
        case str() as text:
            return text
        case ThinScans() as thin:
            return (
                f"{thin.count} of {thin.scans} lose more than half of their points, which have no value; the worst, "
                f"{thin.worst}, {thin.dropped:,} of {thin.points:,}; where the jig should be among them, look at the "
                "exposure, the distance and glare"
            )
        case MissingCorners() as missing:
            return f"{missing.count} of {missing.scans} scans have none; the first, {missing.first}: {missing.reason}"
        case FoundCorners() as found:
            scans = f"all {found.scans} scans" if found.scans > 1 else "the scan"
            told = f"found in {scans}, median sigma {numbers.length(found.sigma_mm)}"
            if not found.is_coarse:
                return told
            better = "go nearer, take a larger jig, or scan each pose several times"
            return f"{told}, coarser than the {numbers.length(COARSE_CORNER_MM)} that tell much of an arm: {better}"
        case RepeatScatter() as scatter:
            return _scatter(scatter)
        case TooFewPoses() as few:
            return f"not tried: {few.poses} different training poses are measured, a fit takes at least {few.needed}"
        case Calibration() as calibration:
            return fit_sentence(calibration)
        case ToolShift() as shift:
            return tool_shift_sentence(shift)
        case DoubtfulEntry() as entry:
            return table_doubt(entry)
        case OutlyingPoses() as outlying:
            return outlier_hint(outlying.plain, outlying.robust)
        case ErrorsOfTestPoses() as errors:
            before, after = errors.before, errors.after
            if before is None or after is None:
                return "no pose has the role test, so nothing says how good this is away from the training poses"
            asked = "" if errors.asked_mm is None else f"; {errors.asked_mm:g} mm was asked for"
            return (
                f"RMSE {numbers.length_change(before.rmse_mm, after.rmse_mm)}, "
                f"maximum {numbers.length_change(before.max_mm, after.max_mm)}{asked}"
            )
        case ErrorRatio() as ratio:
            told = f"{ratio.ratio:.2f} times the training error"
            if ratio.expected is None:
                return told
            told += f", noise explains {ratio.expected:.2f}"
            if ratio.moved is not None:
                return f"{told}: {ratio.moved.words}"
            return (
                f"{told}: expect the test error elsewhere; too few poses, physics that is not in the model, or wrong "
                f"test points, the worst at {ratio.worst_pose} with {numbers.length(ratio.worst_mm)}"
            )
        case ResidualSigma() as residual:
            return _residual_sigma(residual)
        case ResidualOfDiagnosis() as left:
            model = "the links with all that was found" if left.effects else "the links"
            return (
                f"{model} leave {numbers.length(left.sigma_mm)} per coordinate, {numbers.times(left.ratio)} the "
                "declared sigma: the arm is not calibrated to what was measured, or sigma was declared far too small"
            )
        case DataProblem() as problem:
            return problem.warning
        case Diagnosis() as diagnosis:
            return plain(verdict(diagnosis))
        case HeldOutTest() as test:
            if test.is_broken:
                return promise(test)
            off, promised = numbers.length(test.rmse_mm), numbers.length(test.promised_mm)
            return f"the test poses are off by {off}, where {promised} were to be expected"
    raise TypeError(f"nothing is told of a {type(evidence).__name__}")


def _scatter(scatter: RepeatScatter) -> str:
    places = numbers.count(scatter.places, "place")
    told = f"{places} measured several times: sigma of {numbers.length(scatter.sigma_mm)} per coordinate"
    if scatter.declared_ratio is not None:
        told += f", {numbers.times(scatter.declared_ratio)} the declared: these are not points of one place"
    if scatter.covariance_ratio is not None:
        told += f"; they lie {numbers.times(scatter.covariance_ratio)} as far apart as their covariances say"
    if scatter.doubtful:
        told += ": what changes from repeat to repeat is not in them; declare it as correlated_sigma_mm of [scanner]"
    return told


def _residual_sigma(residual: ResidualSigma) -> str:
    level = residual.level
    if level.is_declared:
        against = f"{numbers.times(residual.ratio)} the declared sigma"
    elif level.source == FIT:
        against = f"{level.name}; no sigma is declared"
    else:
        noise = numbers.length(level.sigma_mm)
        against = f"{numbers.times(residual.ratio)} the {level.name}, {noise}; no sigma is declared"
    wrong = "the model does not describe these data; check joint signs, units and the order of the poses"
    meaning = {
        "": "",
        "implausible": residual.doubt or wrong,
        "excess": "more than noise is left; something is missing from the model, or sigma was declared too small",
        "below": "clearly less than was declared; sigma was declared too large, and small effects are doubted for it",
    }[residual.meaning]
    return f"{numbers.length(residual.sigma_mm)} per coordinate, {against}{f': {meaning}' if meaning else ''}"


@document.register
def _item_document(item: CheckItem) -> dict[str, Any]:
    return {"name": item.name, "passed": item.passed, "words": item_sentence(item), "warning": item.warning}


@document.register
def _check_document(check: Check) -> dict[str, Any]:
    return {
        "dataset": check.dataset.name,
        "passed": check.passed,
        "reasons": [named(item) for item in check.failed],
        "warnings": [named(item) for item in check.warnings],
        "findings": check.items,
        "repeats": repeats_frame(check.repeats),
        "calibration": None if check.calibration is None else check.calibration.to_dict(),
        "diagnosis": None if check.diagnosis is None else check.diagnosis.to_dict(),
    }


def named(item: CheckItem) -> str:
    """Sentence with the finding of one step of a check, after the step's name."""
    return f"{item.name}: {item_sentence(item)}"
