"""Why a diagnosis reached its verdict, as sentences: the model, each effect found, what is left, the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from calib.dataset.repeats import find_repeats, pooled_sigma_mm
from calib.diagnosis.decision_rules import ranking_given_curves, untestable_names
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.verdict import Conclusion, ConfoundedSet, Findings, LearnedModel
from calib.diagnosis.words.causes import cause_of, worst_pose
from calib.diagnosis.words.conclusions import (
    Adequate,
    Ambiguous,
    Cause,
    Named,
    Outliers,
    Unexplained,
    VerdictSentence,
)
from calib.diagnosis.words.fit_facts import error_change, fitted_values, model_fitted, visible_mm
from calib.diagnosis.words.headline import held_out_beyond_noise
from calib.diagnosis.words.noise_text import NoiseShaped
from calib.diagnosis.words.sentences import (
    SMALL_CHANGE,
    CurvesLearned,
    DataWrong,
    DiscriminatingPose,
    EffectFound,
    EffectRefused,
    EffectsTied,
    Explanation,
    FaultSuspected,
    MassesOff,
    PosesStandOut,
    Reason,
    ResidualOrder,
    ResidualSentence,
    ResidualSize,
    ResidualTooLarge,
    ResidualWithoutOrder,
    SetOpen,
)
from calib.screening.candidates import Candidate, Screening
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.nuisance import REPORTED_EVIDENCE
from calib.screening.residual_tests import ResidualTests

POSES_TOLD = 3


def explain(
    findings: Findings,
    conclusion: Conclusion,
    next_poses: Sequence[DiscriminatingPose] = (),
    power: float | None = None,
) -> Explanation:
    """What led to a diagnosis, a paragraph each, and its verdict.

    Args:
        next_poses: that discriminate between undecided effects, those at which they differ most first.
        power: probability that they do.
    """
    steps = zip(findings.steps, findings.steps[1:], findings.screenings, strict=False)
    first = findings.steps[0].calibration
    opening: tuple[Reason, ...] = (model_fitted(first),)
    if first.tool_shift is not None:
        opening = (*opening, first.tool_shift)
    single: list[Reason] = [
        _effect_found(before, after, screening, conclusion.standing(after.effect or "") or "open")
        for before, after, screening in steps
        if after.candidate is not None
    ]
    single += [_set_open(findings, confounded) for confounded in findings.confounded_sets]
    if conclusion.undecided:
        single.append(_effects_tied(findings, conclusion.undecided, next_poses, power))
    if findings.refused is not None:
        refused = findings.refused
        single.append(EffectRefused(refused.effect, refused.why, refused.detail))
    wrong = findings.data_problem
    paragraphs: list[tuple[Reason, ...]] = [] if wrong is None else [(DataWrong(wrong.words),)]
    paragraphs += [opening, *((reason,) for reason in single), residual_sentences(findings.residual_tests)]
    noise = noise_told(findings)
    if noise is not None:
        paragraphs.append((noise,))
    if findings.learned is not None:
        paragraphs.append((_curves_learned(findings.learned),))
    return Explanation(tuple(paragraphs), _verdict(findings, conclusion))


def _effect_found(before: FitStep, after: FitStep, screening: Screening, standing: str) -> EffectFound:
    candidate = after.candidate
    assert candidate is not None
    return EffectFound(
        effect=candidate.name,
        standing=standing,
        explained_share=candidate.explained_share,
        p_value=candidate.p_holm,
        runner_up=after.runner_up,
        left_to_curves=_left_to_curves(before, screening, candidate),
        lead=after.log_bayes_factor,
        change=error_change(before.calibration, after.calibration),
        values=fitted_values(candidate, after.calibration),
        note=candidate.family.note,
        visible_mm=visible_mm(candidate, before.calibration),
    )


def _left_to_curves(before: FitStep, screening: Screening, chosen: Candidate) -> tuple[str, ...]:
    """Causes of one place or pose above the chosen one in the ranking, of which curves say clearly more."""
    above = [c for c in screening.candidates if c.family.sparse and c.log_evidence > chosen.log_evidence]
    if not above:
        return ()
    kept = {c.name for c in ranking_given_curves(screening, before.curves).candidates}
    return tuple(c.name for c in above if c.name not in kept)


def _curves_learned(learned: LearnedModel) -> CurvesLearned:
    return CurvesLearned(
        effect=LEARNED,
        joints=learned.joints,
        inputs=learned.inputs,
        formula=learned.formula,
        log_evidence=learned.log_evidence,
        change=error_change(learned.before, learned.after),
    )


def _set_open(findings: Findings, found: ConfoundedSet) -> SetOpen:
    confirm = {c.name: c.family.description.confirm for c in findings.candidates}
    alike = (found.effect, *found.equivalent) if found.equivalent else ()
    return SetOpen(
        effect=found.effect,
        twins=found.equivalent,
        untested=found.untested,
        would_help=found.would_help,
        confirm=tuple((name, confirm[name]) for name in alike if confirm.get(name)),
    )


def _effects_tied(
    findings: Findings, names: tuple[str, ...], next_poses: Sequence[DiscriminatingPose], power: float | None
) -> EffectsTied:
    ranking = findings.screenings[-1].candidates
    best = ranking[0]
    confirm = {c.name: c.family.description.confirm for c in ranking}
    return EffectsTied(
        effects=names,
        best=best.name,
        overlaps=tuple((name, share) for name, share in best.overlaps.items() if name in names),
        confirm=tuple((name, confirm[name]) for name in names if confirm.get(name)),
        poses=tuple(next_poses[:POSES_TOLD]),
        is_revolute=findings.calibration.dataset.robot.is_revolute,
        next_poses=len(next_poses),
        power=power,
    )


def noise_told(findings: Findings) -> NoiseShaped | None:
    """The shape of the noise, where it is not as declared."""
    shown = findings.noise
    if shown is None:
        return None
    size_mm = findings.residual_tests.residual_mm
    if shown.from_repeats:
        size_mm = pooled_sigma_mm(find_repeats(findings.calibration.dataset))
    return NoiseShaped(shown.shape, size_mm, shown.rival, shown.from_repeats)


def residual_sentences(tests: ResidualTests) -> tuple[ResidualSentence, ...]:
    """What a fit leaves, with the figures that it was judged by."""
    out: list[ResidualSentence] = [ResidualSize(tests.residual_mm, tests.noise_mm, tests.noise_from)]
    if tests.masses_evidence > REPORTED_EVIDENCE:
        out.append(MassesOff(tests.masses_evidence))
    if tests.structured:
        first = tests.inputs[0]
        out.append(ResidualOrder(tests.structured, first.p_value, first.channel))
    elif tests.inputs:
        closest = tests.inputs[0]
        out.append(ResidualWithoutOrder(len(tests.inputs), closest.input, closest.p_value))
    if tests.too_large:
        out.append(ResidualTooLarge())
    if tests.fault is not None:
        out.append(FaultSuspected(tests.fault))
    if tests.outlier_poses:
        out.append(PosesStandOut(tests.outlier_poses))
    return tuple(out)


def _verdict(findings: Findings, conclusion: Conclusion) -> VerdictSentence:
    verdict, missing, last = conclusion.verdict, conclusion.missing, findings.calibration
    noise_mm = findings.residual_tests.noise_mm
    beyond = held_out_beyond_noise(last, noise_mm)
    if verdict == "adequate":
        return Adequate(
            bool(findings.candidates),
            untestable_names(findings.untestable),
            beyond,
            worst_pose(last),
        )
    if verdict == "named":
        causes = _causes(findings, missing)
        return Named(
            missing,
            _contradicting_points(findings),
            beyond,
            causes,
        )
    if verdict == "ambiguous":
        first = next(iter(_causes(findings, [confounded.effect for confounded in findings.confounded_sets])), None)
        left = worst_pose(last) if first is None else first.largest
        joints = () if first is None else first.joints
        return Ambiguous(missing, conclusion.ambiguous_set, conclusion.suspected, left, joints)
    if verdict == "outliers":
        poses = findings.residual_tests.outlier_poses
        return Outliers(missing, poses, worst_pose(last, poses), _causes(findings, missing))
    if findings.data_problem is not None:
        return Unexplained((), "data", findings.data_problem.words)
    without_curves = last if findings.learned is None else findings.learned.before
    return Unexplained(
        conclusion.suspected,
        conclusion.reason,
        findings.implausible,
        worst_pose(without_curves),
        _joint_of_rest(findings.residual_tests),
        findings.held_out,
        None if findings.refused is None else findings.refused.why,
    )


def _causes(findings: Findings, effects: Sequence[str]) -> tuple[Cause, ...]:
    """What each of some effects does on this arm, as the last fit has them."""
    return tuple(
        cause_of(after.effect, before.calibration, after.calibration)
        for before, after in pairwise(findings.steps)
        if after.effect is not None and after.effect in effects
    )


def _joint_of_rest(tests: ResidualTests) -> int | None:
    """Counted from 1, the joint whose motion shows what is left the most; None where no joint does."""
    if tests.fault is not None:
        return tests.fault.joint + 1
    joint = tests.inputs[0].channel.joint if tests.structured else None
    return None if joint is None else joint + 1


def _contradicting_points(findings: Findings) -> int | None:
    """How many test points got worse with what was named, within their scatter; None where they did not."""
    first, last = findings.steps[0].calibration.after.test, findings.calibration.after.test
    if first is None or last is None or last.rmse_mm < (1.0 + SMALL_CHANGE) * first.rmse_mm:
        return None
    return last.points
