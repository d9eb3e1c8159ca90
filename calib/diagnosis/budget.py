"""Error budget: the squared held-out error of an arm as delivered, divided between the causes that removed it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.calibration.evaluation import evaluate_all
from calib.calibration.noise_level import FIT
from calib.calibration.result import Calibration
from calib.diagnosis.headline import ErrorStage, Headline, headline_of
from calib.effects.effect import full_name
from calib.screening.curves.fitted_curves import learned_members
from calib.screening.curves.smooth_joint_error import LEARNED

LINKS, NOISE, UNKNOWN = "geometry", "noise", "unknown"
CURVES = "curves_joint_"  # begins the cause of a learned curve, before the joint's number, counted from 1
TOGETHER = " + "  # between causes that one fit added, which nothing divides


@dataclass(frozen=True)
class BudgetShare:
    """Share of one cause in the squared error of the arm as delivered."""

    cause: str  # "geometry", an effect's key, "curves_joint_3", "noise", "unknown"; several joined by " + "
    share: float
    mm: float  # 3D RMS of that share alone; the squares of all add up to the squared error as delivered
    sigma_mm: float | None = None  # of `mm`, not estimated yet
    of: str = "arm"  # or "instrument", "target", "noise", "unknown"


@dataclass(frozen=True)
class ErrorBudget:
    """Shares of all causes, which sum to 1, in the order in which the causes were added; noise and unknown last."""

    shares: tuple[BudgetShare, ...]
    delivered_mm: float  # 3D RMSE of the arm as delivered
    of_test_poses: bool  # else there are none, and the errors are of the poses that were fitted
    noise_is_known: bool  # else the share of the noise is within that of the unknown
    reached_noise: bool = False  # whether what is left is within the scatter of noise at few poses
    raised: tuple[str, ...] = ()  # causes whose fit raised the error


def error_budget(calibrations: Sequence[Calibration]) -> ErrorBudget | None:
    """Error budget of a sequence of fits of one dataset; None where the arm as delivered has no error.

    Each cause has the fall of the mean squared error of the test poses (without any, of the training poses) at the fit
    that added it, so shares depend on the order of the fits. A rise takes away from the falls before it. What the last
    fit leaves is noise as far as noise explains it, and unknown beyond.
    """
    headline, last = headline_of(calibrations), calibrations[-1]
    budget = budget_of_stages(headline)
    if budget is None or not any(one.cause == LEARNED for one in budget.shares):
        return budget
    shares: list[BudgetShare] = []
    for one in budget.shares:
        shares += _by_joint(one, last, of_test_poses=budget.of_test_poses) if one.cause == LEARNED else [one]
    return replace(budget, shares=tuple(shares))


def budget_of_stages(headline: Headline) -> ErrorBudget | None:
    """Error budget by the stages of a headline, learned curves as one cause."""
    stages = headline.stages
    squared = np.array([stage.error_mm for stage in stages]) ** 2
    delivered = float(squared[0])
    if len(stages) < 2 or not np.isfinite(squared).all() or not delivered > 0.0:
        return None
    causes = [_cause(stage, with_links=k == 0) for k, stage in enumerate(stages[1:])]
    # Least decreasing sequence above the errors, so that no cause is credited with what a later one takes back.
    envelope = np.minimum(delivered, np.maximum.accumulate(squared[::-1])[::-1])
    falls = [delivered - float(envelope[1]), *(envelope[1:-1] - envelope[2:]).tolist()]
    end, floor_mm = float(envelope[-1]), headline.noise_mm
    is_known = headline.noise.source != FIT and floor_mm is not None
    noise = min(end, floor_mm**2) if is_known and floor_mm is not None else 0.0
    parts = ["arm" if k == 0 or stage.of == "load" else stage.of for k, stage in enumerate(stages[1:])]
    amounts = [*zip(causes, falls, parts, strict=True), (NOISE, noise, NOISE), (UNKNOWN, end - noise, UNKNOWN)]
    return ErrorBudget(
        tuple(_share(cause, mm2 / delivered, stages[0].error_mm, of) for cause, mm2, of in amounts if mm2 > 0.0),
        stages[0].error_mm,
        headline.of_test_poses,
        is_known,
        headline.reached_noise,
        tuple(
            cause
            for cause, before, after in zip(causes, squared, squared[1:], strict=False)
            if after > before and (headline.fits_links or cause != LINKS)
        ),
    )


def _cause(stage: ErrorStage, *, with_links: bool) -> str:
    return TOGETHER.join([*([LINKS] if with_links else []), *stage.effects])


def _share(cause: str, share: float, delivered_mm: float, of: str = "arm") -> BudgetShare:
    return BudgetShare(cause, share, math.sqrt(share) * delivered_mm, of=of)


def _by_joint(curves: BudgetShare, last: Calibration, *, of_test_poses: bool) -> list[BudgetShare]:
    """Share of the learned curves divided between joints by the rise of the squared error without each joint's curve.

    All else in the last fit keeps its values.
    """
    of_joint: dict[int, set[str]] = {}
    for member in learned_members(last):
        of_joint.setdefault(member.joint + 1, set()).update(full_name(member, p) for p in member.parameters)
    names = [p.name for p in last.fit.parameters]
    without = [np.where([name in gone for name in names], 0.0, last.fit.x) for gone in of_joint.values()]
    rises = []
    for evaluation in evaluate_all(last.model, [last.fit.x, *without], last.dataset, last.outliers):
        figures = evaluation.test if of_test_poses else evaluation.train
        rises.append(math.nan if figures is None else figures.rmse_mm**2)
    weights = np.maximum(np.nan_to_num(np.array(rises[1:]) - rises[0]), 0.0)
    weights = weights / weights.sum() if weights.sum() > 0.0 else np.full(len(weights), 1.0 / len(weights))
    mm = curves.mm / math.sqrt(curves.share)
    return [
        _share(f"{CURVES}{joint}", float(weight) * curves.share, mm)
        for joint, weight in sorted(zip(of_joint, weights, strict=True))
        if weight > 0.0
    ]
