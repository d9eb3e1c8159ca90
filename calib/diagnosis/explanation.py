"""A diagnosis in plain words, built from its numbers: what was compared, what is left, which cause, how sure, what next."""

from __future__ import annotations

import numpy as np

from calib.calibration.noise_check import is_declared
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import MIN_LEAD
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.parameter_meaning import meaning
from calib.diagnosis.pose_recommendation import in_words, splitting_poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import parameters_by_name
from calib.screening.candidates import Candidate, Screening
from calib.screening.residual_tests import ResidualTests

HARDLY = 0.03  # a change of the held-out error below this share is none to speak of


def explain(diagnosis: Diagnosis) -> str:
    """Several short paragraphs."""
    parts = [_compared(diagnosis.steps[0].calibration)]
    steps = zip(diagnosis.steps, diagnosis.steps[1:], diagnosis.screenings, strict=False)
    parts += [_step(before, after, screening) for before, after, screening in steps]
    if diagnosis.ambiguous_set:
        parts.append(_ambiguous(diagnosis))
    if diagnosis.refused:
        parts.append(
            f"{diagnosis.refused} explains the training poses well, but with it the test poses are predicted worse: it was "
            "not added. Either it stands in for another cause, or the test poses differ from the others."
        )
    if diagnosis.leading_fault is not None:
        parts.append(
            f"Outside the catalogue a simpler story says more than any effect in it, by {MIN_LEAD:g} in log evidence at least: "
            f"{diagnosis.leading_fault.words}. No effect was named in its place."
        )
    parts.append(remains_words(diagnosis.residual_tests))
    parts.append(verdict_words(diagnosis))
    return "\n\n".join(part for part in parts if part)


def _compared(calibration: Calibration) -> str:
    fit, dataset = calibration.fit, calibration.dataset
    train, test = calibration.after.train, calibration.after.test
    names = calibration.model.family_names
    with_effects = f" with {' and '.join(names)}" if names else ""
    words = (
        f"The five-parameter model{with_effects} was fitted to {train.points if train else 0} measured points of {dataset.robot.name} with the "
        f"scanner's place unknown. It leaves {calibration.sigma_mm:.4g} mm a coordinate"
    )
    words += (
        f", {fit.noise:.2g} times the declared noise" if is_declared(dataset) else "; no noise is declared"
    )
    if test is not None and train is not None:
        words += f"; the training poses are off by {train.rmse_mm:.4g} mm (3D RMSE), the test poses by {test.rmse_mm:.4g} mm"
    return f"{words}."


def _step(before: FitStep, after: FitStep, screening: Screening) -> str:
    candidate = after.candidate
    assert candidate is not None  # only the first step has none
    second = next((c for c in screening.candidates if c.name != candidate.name), None)
    words = f"Missing: {candidate.name}. It explains {100 * candidate.explained_share:.0f} % of what was left (p = {candidate.p_holm:.1g})"
    if second is not None and after.log_evidence_margin is not None:
        words += (
            f" and leads the next, {second.name}, by {after.log_evidence_margin:.0f} in log evidence "
            f"(more than 3 is asked for)"
        )
    old, new = before.calibration.after, after.calibration.after
    if old.test is not None and new.test is not None:
        change = new.test.rmse_mm / old.test.rmse_mm - 1.0 if old.test.rmse_mm > 0.0 else 0.0
        go = "hardly change," if abs(change) < HARDLY else ("fall" if change < 0.0 else "rise")
        words += f". With it the test poses, which it never saw, {go} from {old.test.rmse_mm:.4g} to {new.test.rmse_mm:.4g} mm"
    elif old.train is not None and new.train is not None:
        words += (
            f". With it the training poses fall from {old.train.rmse_mm:.4g} to {new.train.rmse_mm:.4g} mm; "
            "no test poses confirm it"
        )
    note = candidate.family.note
    return f"{words}. {_meaning(candidate, after.calibration)}{' Note: ' + note + '.' if note else ''}"


def _meaning(candidate: Candidate, calibration: Calibration) -> str:
    """The fitted parameters that matter, as an engineer would say them."""
    known = parameters_by_name(candidate.members)
    fitted = {
        p.name: (x, sigma)
        for p, x, sigma in zip(
            calibration.fit.parameters, calibration.fit.x, calibration.fit.sigma, strict=True
        )
    }
    rows = []
    for value in candidate.values:
        size, sigma = map(float, fitted.get(value.name, (0.0, np.inf)))
        if abs(size) > 2.0 * sigma:
            words = f"{value.name} = {size:.3g} +- {sigma:.1g} {value.unit}"
            means = meaning(*known[value.name], size, calibration)
            rows.append((abs(size) / sigma, f"{words} ({means})" if means else words))
    rows.sort(reverse=True)
    if not rows:
        return "None of its parameters is known to better than half its size by itself; together they are."
    more = f", and {len(rows) - 4} more" if len(rows) > 4 else ""
    return "Fitted: " + "; ".join(words for _, words in rows[:4]) + more + "."


def _ambiguous(diagnosis: Diagnosis) -> str:
    names = diagnosis.ambiguous_set
    ranking = diagnosis.screenings[-1].candidates
    first = ranking[0]
    overlap = ", ".join(f"{n}: {100 * s:.0f} %" for n, s in first.overlaps.items() if n in names)
    words = (
        f"Something is missing, and these data cannot tell which of {', '.join(names)}: their log evidences lie within 3 of "
        "each other."
    )
    if overlap:
        words += f" Of what {first.name} explains, others could explain as much ({overlap})."
    confirm = {c.name: c.family.description.confirm for c in ranking}
    advice = [f"for {name}, {confirm[name]}" for name in names if confirm.get(name)]
    words += f" To tell them apart, measure: {'; '.join(advice)}." if advice else ""
    poses = splitting_poses(diagnosis, count=3)
    if poses:
        robot = diagnosis.calibration.dataset.robot
        words += f" Poses at which they differ most, joints in degrees: {in_words(poses, robot.is_revolute)}."
    return words


def input_in_words(name: str) -> str:
    """ "torque4" as one says it; a column of the user's own stays as it is."""
    stem = name.rstrip("0123456789")
    number = name.removeprefix(stem)
    if number and stem in ("q", "torque", "approach"):
        return {
            "q": f"joint {number} (q{number})",
            "torque": f"gravity's torque on joint {number}",
            "approach": f"the approach of joint {number}",
        }[stem]
    if name in ("x", "y", "z"):
        return f"{name} of the scanner's frame"
    return {
        "payload_kg": "the payload",
        "temperature_c": "the temperature",
        "time_s": "time",
        "order": "the order of measuring",
    }.get(name, name)


def left_in_short(residual_tests: ResidualTests) -> str:
    """What a fit leaves, in a few words: noise, a pattern and against what, or more than noise."""
    if residual_tests.fault is not None:
        return residual_tests.fault.words
    if residual_tests.structured:
        more = len(residual_tests.structured) - 3
        named = ", ".join(input_in_words(name) for name in residual_tests.structured[:3])
        return f"a pattern against {named}" + (f" and {more} more" if more > 0 else "")
    if residual_tests.too_large:
        return "more than noise, without a pattern"
    if residual_tests.outlier_poses:
        return f"noise, apart from single poses ({', '.join(residual_tests.outlier_poses)})"
    return "noise"


def remains_words(residual_tests: ResidualTests) -> str:
    """What a fit leaves, with the figures that it was judged by."""
    source = {
        "repeats": "by repeated measurements",
        "dataset": "as dataset.toml declares it, believed to 25 %",
        "fit": "which no one declared",
    }[residual_tests.noise_from]
    words = f"What is left is {residual_tests.residual_mm:.4g} mm a coordinate; the noise is {residual_tests.noise_mm:.4g} mm, {source}."
    if residual_tests.structured:
        first = residual_tests.inputs[0]
        place = (
            f"the motion of {first.where}"
            if first.where.startswith("joint")
            else f"the {first.where} of the scanner's frame"
        )
        words += (
            f" It has order against {', '.join(residual_tests.structured)} (p = {first.p_value:.2g}), most in {place} against "
            f"{first.input}: it is not noise."
        )
    elif residual_tests.inputs:
        closest = residual_tests.inputs[0]
        words += f" It shows no order against any of {len(residual_tests.inputs)} inputs (closest: {closest.input}, p = {closest.p_value:.2g})."
    if residual_tests.too_large:
        words += " It is more than noise."
    if residual_tests.fault is not None:
        words += f" It looks as if {residual_tests.fault.words} (log evidence {residual_tests.fault.log_evidence:.0f})."
    if residual_tests.outlier_poses:
        words += f" Single poses stand out: {', '.join(residual_tests.outlier_poses)}."
    return words


def _unconfirmed(diagnosis: Diagnosis) -> str:
    """A warning where the test poses, within their scatter, speak against what was named."""
    first, last = diagnosis.steps[0].calibration.after.test, diagnosis.calibration.after.test
    if first is None or last is None or last.rmse_mm < (1.0 + HARDLY) * first.rmse_mm:
        return ""
    return (
        f" But the {last.points} test points do not confirm it: they got worse, though by no more than their scatter. Take it "
        "for a lead, and measure more poses."
    )


def verdict_words(diagnosis: Diagnosis) -> str:
    """The verdict alone, a sentence or two."""
    named = " and ".join(diagnosis.missing)
    doubt = implausibility_reason(diagnosis.steps[0].calibration)
    were = "was" if len(diagnosis.missing) == 1 else "were"
    return {
        "adequate": f"Verdict: adequate. {_nothing(diagnosis)}, and nothing else shows.",
        "named": f"Verdict: {named} {were} missing, and with {'it' if were == 'was' else 'them'} nothing else shows."
        + _unconfirmed(diagnosis),
        "ambiguous": "Verdict: ambiguous"
        + (f" after {named}" if named else "")
        + ". The set above holds the cause if the catalogue does.",
        "unexplained": f"Verdict: unexplained. {doubt[:1].upper()}{doubt[1:]}."
        if doubt
        else "Verdict: unexplained. "
        + (
            f"{named} {'helps' if were == 'was' else 'help'}, yet "
            if named
            else "No effect of the catalogue fits: "
        )
        + (
            "what is left tells of something else, said above. Look at that joint."
            if diagnosis.leading_fault or diagnosis.residual_tests.fault
            else "something with a pattern is left. Look at the inputs named above; a loose part or a hose would show so."
            if diagnosis.residual_tests.structured
            else "more than noise is left, without a pattern against any input."
            if diagnosis.residual_tests.too_large
            else "what was found makes the test poses worse."
        ),
        "outliers": "Verdict: outliers. "
        + (f"{named} {were} missing; " if named else "")
        + "apart from single poses nothing is left. Measure those poses again before you leave them out.",
    }[diagnosis.verdict]


def _nothing(diagnosis: Diagnosis) -> str:
    """What `adequate` covers: a family that these data cannot test is not found absent."""
    if not diagnosis.candidates:
        return "These data can test none of the catalogue's effects; what is left is no more than noise"
    blind = [
        u.name for u in diagnosis.untestable if u.name != "scanner_scale"
    ]  # which hardly any data can test
    return "Nothing in the catalogue is missing beyond noise" + (
        f", as far as these data can tell ({', '.join(blind)}: not testable)" if blind else ""
    )
