"""The rules by which an effect is named, left open, refused or doubted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.calibration.plausibility import beyond_nature
from calib.calibration.result import Calibration, is_declared
from calib.dataset.stands import stands_of
from calib.diagnosis.findings import Findings, Refusal
from calib.fitting.pose_means import mean_by_pose
from calib.screening.candidates import (
    MIN_LEAD,
    MIN_RIVAL_OVERLAP,
    Candidate,
    Screening,
    Untestable,
)
from calib.screening.curves.joint_curves import MIN_LOG_EVIDENCE as MIN_CURVE_EVIDENCE
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.fault_models import JointFault
from calib.screening.left_out import left_out_gain
from calib.screening.residual_tests import ResidualTests

MAX_P_VALUE = 0.01  # that the Holm-corrected p of an effect has to be below
MIN_LOG_EVIDENCE = 3.0
MAX_SIGMAS_LEFT = 1.4  # residual over noise beside an open set, up to which the effects named before it are claimed
TWIN_OVERLAP = 0.98  # share of what one explains that lies along what the other explains
TWIN_SPAN = 0.9995  # share of what the better one explains that the other could make; with less, data tell them apart
TWIN_LEAD = 8.0  # in log evidence, from which the worse one is no twin
TWIN_LEFT = 1.15  # times as much as the better one leaves, from which the worse one is no twin
CURVES_SHARE = 1.1  # how many times the evidence of a cause of one place or pose curves need to take its place
MAX_WORSENING = 0.5  # standard errors by which a first effect may not raise the test poses' squared error
MIN_GAIN = 1.0  # standard errors by which an effect has to lower the squared error of poses that no fit saw

VERDICTS = ("adequate", "named", "ambiguous", "unexplained", "outliers")


def is_convincing(candidate: Candidate) -> bool:
    """Whether a candidate beats noise: the F test over all that were tried, and the evidence floor."""
    return candidate.p_holm < MAX_P_VALUE and candidate.log_evidence > MIN_LOG_EVIDENCE


def rank_candidates(screening: Screening) -> tuple[Candidate, Candidate | None, tuple[Candidate, ...]]:
    """The best candidate, the best rival that it leads, and the set that cannot be told apart, () where it leads.

    A rival could explain most of what the best one explains. A candidate that explains something else is no rival: it
    may be a second cause, and is tested again in the next step.
    """
    best = screening.candidates[0]
    others = screening.candidates[1:]
    rivals = [c for c in others if best.overlaps.get(c.name, 0.0) > MIN_RIVAL_OVERLAP]
    nearest = (*rivals, *others)[:1]
    tied = [c for c in rivals if best.log_evidence - c.log_evidence <= MIN_LEAD and c.log_evidence > 0.0]
    return best, (nearest[0] if nearest else None), (best, *tied) if tied else ()


def are_twins(one: Candidate, other: Candidate, freedom: int) -> bool:
    """Whether two candidates make the same of a residual, and one of them hardly better.

    Their fits differ by less than noise decides, so that their sizes and the number of their parameters would.
    """
    if not one.members or not other.members:
        return False
    better, worse = sorted((one, other), key=lambda candidate: -candidate.log_evidence)
    if better.overlaps.get(worse.name, 0.0) < TWIN_SPAN:
        return False
    size = float(one.explained @ one.explained) * float(other.explained @ other.explained)
    alike = float(one.explained @ other.explained) ** 2 > TWIN_OVERLAP * size > 0.0
    left = sorted((max(1.0 - one.explained_share, 1e-300), max(1.0 - other.explained_share, 1e-300)))
    near = abs(one.log_evidence - other.log_evidence) < TWIN_LEAD
    fits_alike = freedom * np.log(left[1] / left[0]) < 2.0 * MIN_LEAD
    return bool(alike and near and left[1] < TWIN_LEFT * left[0] and fits_alike)


def can_stand_for(best: Candidate, others: Sequence[Candidate], freedom: int) -> bool:
    """Whether the best may stand in the model for all others of a tied set, which stay open (`open_sets`)."""
    return all(other.name in best.family.confounded_with or are_twins(best, other, freedom) for other in others)


def twins_of(name: str, screening: Screening | None) -> tuple[str, ...]:
    """The twins of a candidate in a screening."""
    one = next((c for c in screening.candidates if c.name == name), None) if screening is not None else None
    if screening is None or one is None:
        return ()
    freedom = screening.projected.freedom
    return tuple(c.name for c in screening.candidates if c is not one and are_twins(one, c, freedom))


def untestable_names(untestable: Sequence[Untestable]) -> tuple[str, ...]:
    """Families that a verdict does not cover, without those that no dataset can test (the scanner's scale)."""
    return tuple(family.name for family in untestable if not family.never)


def predicts_worse(before: Calibration, after: Calibration, *, scatter: float = MAX_WORSENING) -> bool:
    """Whether the test poses are predicted worse beyond their scatter, or the fit failed.

    Paired over test points: the mean change of the squared error against `scatter` standard errors of it.
    """
    if not after.fit.converged:
        return True
    rows = before.after.is_test[before.after.pose]
    if rows.sum() < 3:
        return False
    change = np.sum(after.after.error_mm[rows] ** 2, axis=1) - np.sum(before.after.error_mm[rows] ** 2, axis=1)
    if before.averaged is not None:  # shots of one standing pose change together
        stand = stands_of(before.dataset)[before.after.pose[rows]]
        change = mean_by_pose(change, np.unique(stand, return_inverse=True)[1], len(np.unique(stand)))
        if len(change) < 3:
            return False
    return bool(change.mean() > scatter * change.std(ddof=1) / np.sqrt(len(change)))


def refusal(
    candidate: Candidate, screening: Screening, before: Calibration, after: Calibration, *, further: bool
) -> Refusal | None:
    """Why a candidate of a screening is not to be added; None where it may be.

    Its size has to be one that such a cause can have. Poses that its fit did not see have to confirm it: a first effect
    may not raise the test poses' error beyond chance, and the error of all poses that were left out, the test poses and
    the training poses one by one, has to fall beyond chance. A further effect stands beside one whose own law may be a
    little off, which leaves order enough for a second name: it may not raise the test poses' error at all.

    Args:
        before: the fit that the screening is of.
        after: the fit with the candidate.
        further: whether an effect was found before.
    """
    beyond = beyond_nature(after)
    if beyond:
        return Refusal(candidate.name, "nature", beyond)
    if predicts_worse(before, after, scatter=0.0 if further else MAX_WORSENING):
        return Refusal(candidate.name, "test poses")
    gain = left_out_gain(before, after)
    helps_nowhere = gain is not None and gain.standard_errors < MIN_GAIN
    if helps_nowhere or (further and candidate.cv_rmse_mm >= screening.cv_rmse_mm):
        return Refusal(candidate.name, "no gain")
    return None


def verdict_of(
    named: Sequence[str],
    ambiguous: Sequence[str],
    doubted: bool,
    residual_tests: ResidualTests,
    *,
    stays_open: bool = False,
    promise_broken: bool = False,
) -> str:
    """One of `VERDICTS`.

    Args:
        named: effects in the model.
        ambiguous: a tied set, none of which is in the model.
        doubted: whether the only effect was refused, a fault has more evidence, or the data are implausible. Where a
            further effect was refused, what is left decides.
        residual_tests: of what the model leaves.
        stays_open: whether an effect in the model stands for a set.
        promise_broken: whether the test poses are off by more than was promised (`held_out_test`).
    """
    if ambiguous:
        return "ambiguous"
    if (
        promise_broken
        or doubted
        or residual_tests.fault is not None
        or residual_tests.structured
        or residual_tests.too_large
    ):
        return "unexplained"
    if stays_open:
        return "ambiguous"
    if residual_tests.outlier_poses:
        return "outliers"
    return "named" if named else "adequate"


def carries_its_names(verdict: str, beside_open_set: ResidualTests | None = None) -> bool:
    """Whether the effects that a search added are claimed; else they are only suspected.

    Where a cause stays unexplained, it may have made them look as they do. Where one of a tied set is the next cause,
    what is left with the best of that set in the model has to be noise.

    Args:
        beside_open_set: tests of what a fit leaves with the best of the tied set in the model, where there is one.
    """
    if verdict == "unexplained":
        return False
    if beside_open_set is None:
        return True
    tests = beside_open_set
    too_large = tests.noise_from != "fit" and tests.residual_mm > MAX_SIGMAS_LEFT * tests.noise_mm
    return not (tests.fault or tests.structured or too_large)


def may_be_curves(best: Candidate, calibration: Calibration, screening: Screening) -> bool:
    """Whether curves of the joints could say clearly more than the best candidate, one of one place or one pose.

    Curves that left the declared noise alone would have nu / 2 log(r^2 / nu) in log evidence, less what they cost.
    """
    if not best.family.sparse:
        return False
    if not is_declared(calibration.dataset):
        return True
    projected = screening.projected
    total = float(projected.residual @ projected.residual)
    least = min(projected.freedom, (1.0 - best.explained_share) * total)
    most = 0.5 * projected.freedom * float(np.log(total / max(least, 1e-300))) - MIN_CURVE_EVIDENCE
    return most > best.log_evidence + MIN_LEAD


def beside_curves(screening: Screening, curves: LearnedCurves | None) -> Screening:
    """The ranking without causes of one place or one pose that curves say clearly more than.

    Such a cause follows a corner of what the curves follow whole: nobody is sent to open a healthy gear.
    """
    least = -np.inf if curves is None else (curves.log_evidence - MIN_LEAD) / CURVES_SHARE
    kept = tuple(c for c in screening.candidates if not c.family.sparse or c.log_evidence >= least)
    return replace(screening, candidates=kept)


def curves_say_more(curves: LearnedCurves, fault: JointFault) -> bool:
    """Whether curves have clearly more evidence than a fault of one joint, and not by that joint's curve alone."""
    others = any(member.joint != fault.joint for member in curves.members)
    return others and curves.log_evidence > fault.log_evidence + MIN_LEAD


def noise_is_believed(before: Findings, again: Findings) -> bool:
    """Whether a search with the noise as it shows is clean, and loses no claim.

    An unknown cause may look like noise of a strange shape. As a shape keeps the declared size, its size gives it away:
    so a size has to be known where something was left without the shape.
    """
    if before.verdict == "unexplained" and again.residual_tests.lack_of_fit_p is None:
        return False
    return again.is_clean and set(before.missing) <= {*again.missing, *again.ambiguous_set}
