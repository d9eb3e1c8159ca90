"""What is learned where no effect of the catalogue explains the residual: laws of joints, or curves.

Laws are looked for at every model that the search went through, as an effect may have been added that follows a part of
a law. They take the place of curves, and of the effects that came after that model, where they say as much.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.calibration.plausibility import beyond_nature, implausibility_reason
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import is_convincing, predicts_worse
from calib.diagnosis.effect_selection import FitStep, couplings_given, evidence_on_the_way, selected_curves
from calib.diagnosis.model_diagnosis import diagnosis_of_model, with_learned
from calib.diagnosis.moves import AddCurves, SearchEnd, Tell
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, step_after
from calib.effects.effect import full_name
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR
from calib.screening.curves.joint_curves import LearnedCurves, explains_as_much
from calib.screening.curves.law_search import MIN_FIRST_GAIN, MIN_FURTHER_GAIN, MIN_STANDARD_ERRORS, FoundLaws
from calib.screening.curves.smooth_joint_error import LEARNED, CouplingModes
from calib.screening.left_out import left_out_gain

MIN_FALL = 0.01  # of the RMS error of the test poses, by laws beside curves: less is the same
MIN_SIGMAS = 3.0  # of its own, that the largest amount of each law is from zero


@dataclass(frozen=True)
class _Laws:
    """Laws found at one of a search's models, with what the way there and they have in log evidence."""

    step: int
    found: FoundLaws
    log_evidence: float


def learned_to_add(space: SearchSpace, diagnosis: Diagnosis, tell: Tell) -> AddCurves | None:
    """Move that adds what is learned, laws or curves, where either is justified; else None."""
    if diagnosis.verdict not in ("unexplained", "ambiguous") or implausibility_reason(diagnosis.calibration):
        return None
    tell("looking for a law of what is left")
    laws = _laws(diagnosis)
    curves = _curves(diagnosis, tell)
    if laws is not None and _take_their_place(laws, curves, diagnosis):
        added = _with_laws(space, diagnosis, laws)
        if added is not None:
            return added
    return None if curves is None else _with_curves(space, diagnosis, curves)


# ---- laws -----------------------------------------------------------------------------------------------------------


def _laws(diagnosis: Diagnosis) -> _Laws | None:
    """The most likely laws at any model of a search, of the later model where they are about as likely; None for none.

    Laws do not come before an effect of the catalogue that explains as much of the same residual.
    """
    best: _Laws | None = None
    way = evidence_on_the_way(diagnosis.steps)
    for k in reversed(range(len(diagnosis.steps))):
        step = diagnosis.steps[k]
        found = step.laws
        if found is None or step.screening is None:
            continue
        in_catalogue = max((c.log_evidence for c in step.screening.candidates), default=0.0)
        if found.laws[0].gain < in_catalogue + MIN_LOG_BAYES_FACTOR:
            continue
        total = way[k] + found.log_evidence
        if best is None or total > best.log_evidence + MIN_LOG_BAYES_FACTOR:
            best = _Laws(k, found, total)
    return best if best is not None and best.log_evidence > way[-1] + MIN_FIRST_GAIN else None


def _take_their_place(laws: _Laws, curves: LearnedCurves | None, diagnosis: Diagnosis) -> bool:
    """Whether laws say as much as curves do with a third of their parameters; also where no curves were learned."""
    if curves is None:
        return True
    found = LearnedCurves(laws.found.members, laws.found.log_evidence)
    return explains_as_much(found, laws.log_evidence - evidence_on_the_way(diagnosis.steps)[-1], curves)


def _with_laws(space: SearchSpace, diagnosis: Diagnosis, laws: _Laws) -> AddCurves | None:
    """Move that adds laws to the model at which they were found; None where nature or poses left out speak against it.

    They have to predict the test poses no worse than the model at which the search ended, and to lower the error of all
    poses that were left out clearly.
    """
    learned = LearnedCurves(laws.found.members, laws.found.log_evidence, laws.found.left_out_mm, laws.found)
    last, step = diagnosis.calibration, diagnosis.steps[laws.step]
    selected = (*step.selected, selected_curves(learned))
    after = space.fit(selected, step.calibration)
    if beyond_nature(after) or predicts_worse(last, after, scatter=0.0) or not _are_known(learned, after):
        return None
    gain = left_out_gain(step.calibration, after)
    over_last = left_out_gain(last, after)
    if gain is None or gain.standard_errors < MIN_STANDARD_ERRORS or over_last is None or over_last.share <= 0.0:
        return None
    if last.after.train is None or after.after.train is None:
        return None
    if laws.step < len(diagnosis.steps) - 1:
        noise = diagnosis.noise
        diagnosis = diagnosis_of_model(space, diagnosis.steps[: laws.step + 1], SearchEnd())
        diagnosis = replace(diagnosis, noise=noise)
    added = step_after(diagnosis.steps[-1], LEARNED, selected, after, log_bayes_factor=learned.log_evidence)
    return AddCurves(with_learned(diagnosis, added, learned.members, laws.found), learned)


def _are_known(learned: LearnedCurves, after: Calibration) -> bool:
    """Whether the fit of all parameters together leaves each law clearly away from zero."""
    fitted = {p.name: abs(x) / s for p, x, s in zip(after.fit.parameters, after.fit.x, after.fit.sigma, strict=True)}
    return all(
        max(fitted[full_name(member, parameter)] for parameter in member.parameters) > MIN_SIGMAS
        for member in learned.members
    )


# ---- curves ---------------------------------------------------------------------------------------------------------


def _curves(diagnosis: Diagnosis, tell: Tell) -> LearnedCurves | None:
    """Learned curves, where they are justified; else None.

    They are offered only if (1) the verdict is `unexplained`, or `ambiguous` and their log evidence exceeds twice that
    of the best candidate by `MIN_LOG_BAYES_FACTOR` (once that of the first effect that leads no others, beside which
    they explain the rest); (2) the only effect was not refused for a reason that leaves doubt,
    and points and poses belong together; (3) no further candidate is convincing, except where one of one place or one
    pose gives way to curves.
    """
    last, refused = diagnosis.steps[-1], diagnosis.refused
    if refused is not None and refused.leaves_doubt and not diagnosis.named:
        return None
    unnamed = not diagnosis.left_to_curves and refused is None and not diagnosis.ambiguous_set
    if unnamed and any(map(is_convincing, diagnosis.screenings[-1].candidates)):
        return None  # as many effects as were asked for, and one more has a name
    tell("learning what the joints' curves explain")
    curves = _or_couplings(last)
    if curves is None:
        return None
    least = 2.0 * max((c.log_evidence for c in diagnosis.screenings[-1].candidates), default=0.0)
    undecided = next((step.candidate for step in diagnosis.steps if step.on_behalf_of), None)
    if undecided is not None:
        least = undecided.log_evidence
    if diagnosis.ambiguous_set and curves.log_evidence < MIN_LOG_BAYES_FACTOR + least:
        return None
    return curves


def _or_couplings(step: FitStep) -> LearnedCurves | None:
    """Learned curves of a fit, or couplings of all joints that have clearly more evidence and stand in their place."""
    curves, couplings = step.curves, couplings_given(step.calibration)
    if couplings is None or (curves is not None and couplings.log_evidence < curves.log_evidence + MIN_FURTHER_GAIN):
        return curves
    return replace(couplings, alone=curves)


def _with_curves(space: SearchSpace, diagnosis: Diagnosis, curves: LearnedCurves) -> AddCurves | None:
    """Move that adds curves; None where they predict the test poses worse than the model without them.

    Laws stand beside curves, and couplings of all joints in their place, only where the test poses confirm them: they
    came in by what the training poses say, which do not tell laws from what poses of one place have in common.
    """
    last: FitStep = diagnosis.steps[-1]
    selected = (*last.selected, selected_curves(curves))
    after = space.fit(selected, last.calibration)
    if curves.alone is not None or any(isinstance(one.modes, CouplingModes) for one in curves.members):
        plain = None if curves.alone is None else _with_curves(space, diagnosis, curves.alone)
        without = last.calibration if plain is None else plain.diagnosis.calibration
        if not _confirm(without, after):
            return plain
    # A cause may be right and the test poses a little worse by chance; curves name none and have to earn their place.
    before = last.calibration
    if predicts_worse(before, after, scatter=0.0) or before.after.train is None or after.after.train is None:
        return None
    step = step_after(last, LEARNED, selected, after, log_bayes_factor=curves.log_evidence)
    return AddCurves(with_learned(diagnosis, step, curves.members), curves)


def _confirm(without: Calibration, after: Calibration) -> bool:
    """Whether the error of the test poses falls by `MIN_FALL` with laws beside curves; true without test poses."""
    before, now = without.after.test, after.after.test
    return before is None or now is None or now.rmse_mm < (1.0 - MIN_FALL) * before.rmse_mm
