"""Why a diagnosis reached its verdict, as sentences: the model, each effect found, what is left, the verdict."""

from __future__ import annotations

import numpy as np

from calib.calibration.noise_check import is_declared
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import prediction_covariance
from calib.dataset.repeats import find_repeats, pooled_sigma_mm
from calib.diagnosis.decision_rules import untestable_names
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.findings import Findings, Learned, OpenSet
from calib.diagnosis.words.conclusions import (
    Adequate,
    Ambiguous,
    Named,
    Outliers,
    Unexplained,
    VerdictSentence,
)
from calib.diagnosis.words.noise_text import NoiseShaped
from calib.diagnosis.words.phrases import meaning
from calib.diagnosis.words.sentences import (
    SMALL_CHANGE,
    CurvesLearned,
    EffectFound,
    EffectRefused,
    EffectsTied,
    ErrorChange,
    Explanation,
    FaultSuspected,
    FittedValue,
    MassesOff,
    ModelFitted,
    PosesStandOut,
    Reason,
    ResidualOrder,
    ResidualSentence,
    ResidualSize,
    ResidualTooLarge,
    ResidualWithoutOrder,
    SetOpen,
)
from calib.distributions import chi2_ppf
from calib.effects.effect import parameters_by_name
from calib.effects.natural_bounds import exceeded_bound
from calib.errors import FitError
from calib.screening.candidates import Candidate, Screening
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.nuisance import TOLD_EVIDENCE
from calib.screening.residual_tests import ResidualTests

POSES_TOLD = 3
_PREDICTION_DOUBT = (
    2.0  # where training poses are alike, directions that they hardly tell count on their prior
)


def explain(findings: Findings) -> Explanation:
    """What led to a diagnosis, a paragraph each, and its verdict."""
    steps = zip(findings.steps, findings.steps[1:], findings.screenings, strict=False)
    first = findings.steps[0].calibration
    opening: tuple[Reason, ...] = (_model_fitted(first),)
    if first.tool_shift is not None:
        opening = (*opening, first.tool_shift)
    single: list[Reason] = [
        _effect_found(before, after, screening, _standing(findings, after.effect))
        for before, after, screening in steps
        if after.candidate is not None
    ]
    single += [_set_open(findings, found) for found in findings.open_sets]
    if findings.tied:
        single.append(_effects_tied(findings))
    if findings.refused:
        single.append(EffectRefused(findings.refused))
    paragraphs = [opening, *((reason,) for reason in single), residual_sentences(findings.residual_tests)]
    noise = noise_told(findings)
    if noise is not None:
        paragraphs.append((noise,))
    if findings.learned is not None:
        paragraphs.append((_curves_learned(findings.steps[-1], findings.learned),))
    return Explanation(tuple(paragraphs), _verdict(findings))


def _model_fitted(calibration: Calibration) -> ModelFitted:
    fit, dataset = calibration.fit, calibration.dataset
    train, test = calibration.after.train, calibration.after.test
    return ModelFitted(
        robot=dataset.robot.name,
        families=calibration.model.family_names,
        points=train.points if train else 0,
        sigma_mm=calibration.sigma_mm,
        noise_ratio=fit.noise if is_declared(dataset) else None,
        train_rmse_mm=train.rmse_mm if train and test else None,
        test_rmse_mm=test.rmse_mm if train and test else None,
        shots=calibration.shots,
    )


def _standing(findings: Findings, effect: str | None) -> str:
    if effect in findings.missing:
        return "claimed"
    return "suspected" if effect in findings.suspected else "open"


def _effect_found(before: FitStep, after: FitStep, screening: Screening, standing: str) -> EffectFound:
    candidate = after.candidate
    assert candidate is not None
    return EffectFound(
        effect=candidate.name,
        standing=standing,
        explained_share=candidate.explained_share,
        p_value=candidate.p_holm,
        runner_up=next((c.name for c in screening.candidates if c.name != candidate.name), ""),
        lead=after.log_evidence_margin,
        change=_error_change(before.calibration, after.calibration),
        values=_fitted_values(candidate, after.calibration),
        note=candidate.family.note,
        visible_mm=_visible_mm(candidate, before.calibration),
    )


def _curves_learned(step: FitStep, learned: Learned) -> CurvesLearned:
    return CurvesLearned(
        effect=LEARNED,
        joints=learned.joints,
        inputs=learned.inputs,
        formula=learned.formula,
        log_evidence=step.log_evidence_margin,  # over noise; not known of curves of a saved session
        change=_error_change(learned.before, learned.after),
    )


def _visible_mm(candidate: Candidate, before: Calibration) -> float | None:
    """RMS over the training poses of what an effect explains of the 3D errors that a fit left over."""
    train = before.after.train
    return None if train is None else train.rmse_mm * float(np.sqrt(max(candidate.explained_share, 0.0)))


def _error_change(before: Calibration, after: Calibration) -> ErrorChange | None:
    """That of the test poses where there are any, else that of the training poses."""
    if before.after.test is not None and after.after.test is not None:
        return ErrorChange(True, before.after.test.rmse_mm, after.after.test.rmse_mm)
    if before.after.train is not None and after.after.train is not None:
        return ErrorChange(False, before.after.train.rmse_mm, after.after.train.rmse_mm)
    return None


def _fitted_values(candidate: Candidate, calibration: Calibration) -> tuple[FittedValue, ...]:
    """The fitted parameters that are known to better than half their size, the surest first."""
    parameters = parameters_by_name(candidate.members)
    fit = calibration.fit
    fitted = {p.name: (x, s) for p, x, s in zip(fit.parameters, fit.x, fit.sigma, strict=True)}
    out = []
    for value in candidate.values:
        size, sigma = map(float, fitted.get(value.name, (0.0, np.inf)))
        if abs(size) > 2.0 * sigma:
            means = meaning(*parameters[value.name], size, calibration)
            bound = exceeded_bound(*parameters[value.name], size, sigma)
            out.append(FittedValue(value.name, size, sigma, value.unit, means, bound))
    return tuple(sorted(out, key=lambda v: (abs(v.value) / v.sigma, v.name), reverse=True))


def _set_open(findings: Findings, found: OpenSet) -> SetOpen:
    confirm = {c.name: c.family.description.confirm for c in findings.candidates}
    alike = (found.effect, *found.twins) if found.twins else ()
    return SetOpen(
        effect=found.effect,
        twins=found.twins,
        untested=found.untested,
        would_help=found.would_help,
        confirm=tuple((name, confirm[name]) for name in alike if confirm.get(name)),
    )


def _effects_tied(findings: Findings) -> EffectsTied:
    names = findings.tied
    ranking = findings.screenings[-1].candidates
    best = ranking[0]
    confirm = {c.name: c.family.description.confirm for c in ranking}
    return EffectsTied(
        effects=names,
        best=best.name,
        overlaps=tuple((name, share) for name, share in best.overlaps.items() if name in names),
        confirm=tuple((name, confirm[name]) for name in names if confirm.get(name)),
        poses=findings.discriminating_poses[:POSES_TOLD],
        is_revolute=findings.calibration.dataset.robot.is_revolute,
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
    if tests.masses_evidence > TOLD_EVIDENCE:
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


def _verdict(findings: Findings) -> VerdictSentence:
    missing = findings.missing
    if findings.verdict == "adequate":
        return Adequate(
            bool(findings.candidates), untestable_names(findings.untestable), _test_excess(findings)
        )
    if findings.verdict == "named":
        return Named(missing, _contradicting_points(findings), _test_excess(findings))
    if findings.verdict == "ambiguous":
        return Ambiguous(missing, findings.ambiguous_set, findings.suspected)
    if findings.verdict == "outliers":
        return Outliers(missing, findings.residual_tests.outlier_poses)
    doubt = implausibility_reason(findings.steps[0].calibration)
    return Unexplained(findings.suspected, _what_is_unexplained(findings, doubt), doubt)


def _what_is_unexplained(findings: Findings, doubt: str) -> str:
    tests = findings.residual_tests
    if doubt:
        return "implausible"
    if tests.fault:
        return "fault"
    if findings.learned is not None:
        return "curves"
    if tests.structured:
        return "order"
    if findings.beaten and not tests.too_large:
        return "wander"
    return "size" if tests.too_large else "refused"


def _contradicting_points(findings: Findings) -> int | None:
    """How many test points got worse with what was named, within their scatter; None where they did not."""
    first, last = findings.steps[0].calibration.after.test, findings.calibration.after.test
    if first is None or last is None or last.rmse_mm < (1.0 + SMALL_CHANGE) * first.rmse_mm:
        return None
    return last.points


def _test_excess(findings: Findings) -> float | None:
    """The test poses' RMSE over what noise leaves there; None where it is no more than that may be by chance.

    Noise leaves the point's own and what it does to the fit's prediction, which is much where test poses are of another
    kind. A chi^2 with 3 degrees of freedom a point exceeds its 99.9 % quantile by chance once in a thousand; what the
    fit says of its own uncertainty is believed to `_PREDICTION_DOUBT`.
    """
    calibration, noise_mm = findings.calibration, findings.residual_tests.noise_mm
    after, poses = calibration.after, calibration.dataset.poses
    if after.test is None or not noise_mm > 0.0:
        return None
    rows = np.flatnonzero(after.is_test[after.pose])
    expected_mm2 = 3.0 * noise_mm**2 * len(rows)
    for setup in after.scanner_T_base:
        of_setup = after.pose[rows][poses.setup[after.pose[rows]] == setup]
        if len(of_setup):
            try:
                covariance_mm2 = prediction_covariance(calibration, poses.q[of_setup], setup)
            except FitError:  # it has no training pose: its frame is of the test poses themselves
                return None
            expected_mm2 += float(np.trace(covariance_mm2, axis1=1, axis2=2).sum())
    by_chance = float(np.sqrt(chi2_ppf(0.999, 3 * len(rows)) / (3 * len(rows))))
    ratio = float(np.sqrt(np.sum(after.error_mm[rows] ** 2) / expected_mm2))
    return ratio if ratio > _PREDICTION_DOUBT * by_chance else None
