"""Which physical effect is missing: step by step, each with its evidence, its doubt and its held-out gain.

A name is claimed only if its family beats noise (F test with Holm's correction, and the evidence floor), leads the
second by more than `MARGIN` in log evidence, says no less than a dent or a slip of one joint would, and does not make
the test poses worse. Otherwise the set within it is given. At the end the remains are judged, always: a cause outside
the catalogue shows there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from calib.blas_threads import one_blas_thread
from calib.calibration.plausibility import does_not_belong
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset, without_poses
from calib.diagnosis.decision_rules import (
    FLOOR,
    MARGIN,
    is_convincing,
    leader,
    predicts_worse,
    simpler_story,
    verdict_of,
)
from calib.diagnosis.effect_selection import Added, calibrate_with
from calib.diagnosis.fault_models import LocalFault
from calib.diagnosis.projected_residual import leftover_of
from calib.diagnosis.residual_tests import Remains, examine
from calib.diagnosis.screening import Candidate, Screening, Untestable, screen
from calib.effects.catalogue import effects_for, family_of
from calib.effects.effect import Family
from calib.options import FitOptions

FEW = 0.1  # share of poses that may stand out and still be called outliers
AHEAD = 4  # members of a tied set that are tried with a successor


@dataclass(frozen=True)
class Step:
    """One fit of the way: the geometric one (effect None), then one for each effect that was added."""

    effect: str | None
    calibration: Calibration
    p_value: float | None
    log_evidence_margin: float | None
    screening: Screening  # of everything not in this step's model
    candidate: Candidate | None = None  # the effect's case, as it stood before it was added
    inside: tuple[
        Candidate, ...
    ] = ()  # all that was added so far, with the members that show beside each other


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on a dataset and all that led to it."""

    verdict: str
    missing: tuple[str, ...]  # in the order added
    ambiguous_set: tuple[str, ...]
    steps: tuple[Step, ...]
    untestable: tuple[Untestable, ...]
    remains: Remains
    refused: str = ""  # an effect that would have been named, but made the test poses worse
    simpler: LocalFault | None = (
        None  # a story outside the catalogue that says more than the next effect would
    )

    @property
    def calibration(self) -> Calibration:
        """The last fit, all named effects in it."""
        return self.steps[-1].calibration

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The ranking that the first decision was taken by."""
        return self.steps[0].screening.candidates

    def to_frame(self) -> pd.DataFrame:
        """The steps: effect, errors on training and test poses, residual sigma."""
        rows = []
        for step in self.steps:
            after = step.calibration.after
            rows.append(
                {
                    "effect": step.effect or "link errors",
                    "train_rmse_mm": after.train.rmse_mm if after.train else float("nan"),
                    "test_rmse_mm": after.test.rmse_mm if after.test else float("nan"),
                    "sigma_mm": step.calibration.sigma_mm,
                    "p_value": step.p_value,
                    "margin": step.log_evidence_margin,
                }
            )
        return pd.DataFrame(rows).astype({"p_value": float, "margin": float})  # None is NaN


@dataclass(frozen=True)
class _Added:
    """An effect in the model: the case for it, and its lead."""

    candidate: Candidate
    margin: float | None

    @property
    def name(self) -> str:
        return self.candidate.name

    def step(self, calibration: Calibration, screening: Screening, added: Sequence[_Added]) -> Step:
        case, inside = self.candidate, tuple(one.candidate for one in added)
        return Step(self.name, calibration, case.p_value, self.margin, screening, case, inside)


@one_blas_thread()
def diagnose(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[str] = (),
    own: Sequence[Family] = (),
    max_steps: int = 3,
    on_step: Callable[[str], None] | None = None,
    _without: Sequence[str] = (),
) -> Diagnosis:
    """Find what is missing from the five-parameter model.

    Args:
        dataset: with measured points; test poses are used to confirm only.
        options: what is asked of every fit.
        effects: families that are taken as present from the start, all joints.
        own: families beyond the catalogue.
        max_steps: effects to add at the most.
        on_step: called with a line of words before each stage.

    Raises:
        FitError, CalibError: too few poses, an unknown name.
    """
    tell = on_step or (lambda words: None)
    families = (*effects_for(dataset), *own)
    given = [member for name in effects for member in family_of(dataset, name, own).members]

    def fit(added: Sequence[_Added]) -> Calibration:
        inside = [Added.of(one.candidate) for one in added]
        return calibrate_with(dataset, inside, options, effects=given, start=calibration)

    tell("fitting the geometry")
    calibration: Calibration | None = None  # each fit goes on from the last model that was taken
    calibration = fit(())
    added: list[_Added] = []
    screening = screen(calibration, families)
    steps = [Step(None, calibration, None, None, screening)]
    ambiguous: tuple[str, ...] = ()
    refused = ""
    simpler: LocalFault | None = None
    foreign = bool(does_not_belong(calibration))  # then any pattern is there, and no effect is its cause
    while len(added) < max_steps and not foreign:
        convincing = [c for c in screening.candidates if is_convincing(c)]
        if not convincing:
            break
        best, margin, tied = leader(screening)
        simpler = simpler_story(screening)
        if simpler is not None:
            break
        if tied:
            tell(f"looking one step ahead of {', '.join(c.name for c in tied)}")
            ahead = _look_ahead(tied, fit, added, families)
            if ahead is None:
                ambiguous = tuple(c.name for c in tied)
                break
            best, margin = ahead
        tell(f"adding {best.name}")
        one = _Added(best, margin)
        trial = fit([*added, one])
        if predicts_worse(calibration, trial):
            refused = best.name
            break
        added, calibration = _revised([*added, one], trial, fit)
        screening = screen(calibration, families)
        steps.append(one.step(calibration, screening, added))
    kept = _still_needed(added, fit, families)
    if len(kept) < len(added):
        tell("dropping what a later effect made superfluous")
        steps = [steps[0]]
        for k, one in enumerate(kept):
            calibration = fit(kept[: k + 1])
            steps.append(one.step(calibration, screen(calibration, families), kept[: k + 1]))
        added = kept
    tell("judging what is left")
    remains = examine(dataset, leftover_of(calibration))
    if ambiguous:  # then the residual holds the cause that was left open, and tells no story of its own
        remains = replace(remains, fault=None)
    found = Diagnosis(
        verdict=verdict_of(
            [one.name for one in added], ambiguous, bool(refused or simpler or foreign), remains
        ),
        missing=tuple(one.name for one in added),
        ambiguous_set=ambiguous,
        steps=tuple(steps),
        untestable=steps[0].screening.untestable,
        remains=remains,
        refused=refused,
        simpler=simpler,
    )
    few = 0 < len(remains.outlier_poses) <= max(2, FEW * len(np.unique(calibration.after.pose)))
    if not few or _without:
        return found
    # Only now, with the effects in: a few wrong points bend the fit and hide or feign a pattern in all others.
    tell("once more without the poses that stand out")
    rest = diagnose(
        without_poses(dataset, remains.outlier_poses),
        options,
        effects=effects,
        own=own,
        max_steps=max_steps,
        on_step=on_step,
        _without=remains.outlier_poses,
    )
    return _with_outliers(found, rest, remains.outlier_poses)


def _with_outliers(found: Diagnosis, rest: Diagnosis, outliers: tuple[str, ...]) -> Diagnosis:
    """The diagnosis of the other poses, where that is clean and loses no effect; else the first one."""
    clean = rest.verdict in ("adequate", "named", "outliers") and set(found.missing) <= set(rest.missing)
    if not clean:
        return found
    all_outliers = tuple(dict.fromkeys([*outliers, *rest.remains.outlier_poses]))
    return replace(rest, verdict="outliers", remains=replace(rest.remains, outlier_poses=all_outliers))


def _look_ahead(
    tied: Sequence[Candidate],
    fit: Callable[[Sequence[_Added]], Calibration],
    added: Sequence[_Added],
    families: Sequence[Family],
) -> tuple[Candidate, float] | None:
    """Whether one of a tied set leads clearly once the next effect is in too, as when two causes are hidden.

    The evidence of each with its best successor is compared; None where none leads by the margin, or where nothing
    convincing comes after any.
    """
    totals = []
    followed = False
    for candidate in tied[:AHEAD]:
        after = screen(fit([*added, _Added(candidate, None)]), families).candidates
        following = [c for c in after if is_convincing(c)]
        followed |= bool(following)
        totals.append(candidate.log_evidence + (following[0].log_evidence if following else 0.0))
    order = np.argsort(totals)[::-1]
    lead = totals[order[0]] - totals[order[1]]
    return (tied[int(order[0])], float(lead)) if followed and lead > MARGIN else None


def _revised(
    added: list[_Added], calibration: Calibration, fit: Callable[[Sequence[_Added]], Calibration]
) -> tuple[list[_Added], Calibration]:
    """Earlier effects with the members that show now: beside a cause not yet named, some of them had not shown."""
    out = list(added)
    for k in range(len(out) - 1):
        found = screen(fit([*out[:k], *out[k + 1 :]]), [out[k].candidate.family]).candidates
        if found and found[0].members and found[0].members != out[k].candidate.members:
            out[k] = replace(out[k], candidate=found[0])
    if all(one is before for one, before in zip(out, added, strict=True)):
        return added, calibration
    return out, fit(out)


def _still_needed(
    added: list[_Added], fit: Callable[[Sequence[_Added]], Calibration], families: Sequence[Family]
) -> list[_Added]:
    """Each effect judged beside all others: what a later one explains too is dropped, the weakest first."""
    kept = list(added)
    while len(kept) > 1:
        evidence = []
        for one in kept:
            others = [other for other in kept if other is not one]
            found = screen(fit(others), [one.candidate.family]).candidates
            evidence.append(found[0].log_evidence if found else -np.inf)
        weakest = int(np.argmin(evidence))
        if evidence[weakest] > FLOOR:
            break
        del kept[weakest]
    return kept
