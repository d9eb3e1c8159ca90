"""The words of a diagnosis: with `conclusion_text` the one place where facts become sentences.

The terminal, the page, the report and the JSON documents all take their sentences from here.
"""

from __future__ import annotations

from collections.abc import Sequence

from calib.diagnosis.words import sentences as facts
from calib.diagnosis.words.conclusion_text import verdict_text
from calib.diagnosis.words.noise_text import noise_text
from calib.diagnosis.words.phrases import (
    capitalised,
    curves_text,
    fault_text,
    listed,
    poses_text,
    repeats_text,
    times_text,
)
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR

_SHOWN_VALUES = 4  # fitted parameters of an effect that are told; the others are counted
_STANDING = {"claimed": "Missing", "suspected": "Suspected", "open": "Missing, it or what is like it"}
_REFUSALS = {
    "nature": "{}: it was not added. Something else makes what it would explain.",
    "test poses": (
        "with it the test poses, which the fit did not see, are predicted worse: it was not added. Either it stands in for "
        "another cause, or the test poses differ from the others."
    ),
    "no gain": (
        "poses that were left out, the test poses and the training poses one by one, are predicted no better with it "
        "beyond chance: it was not added."
    ),
}
_NOISE_SOURCES = {
    "repeats": "by repeated measurements",
    "dataset": "as dataset.toml declares it, believed to 25 %",
    "fit": "as the fit left it: not declared",
}


def explanation_text(explanation: facts.Explanation) -> str:
    """Several short paragraphs, the verdict last."""
    return "\n\n".join([*reason_texts(explanation), f"Verdict: {verdict_text(explanation.verdict)}"])


def reason_texts(explanation: facts.Explanation) -> list[str]:
    """What led to the verdict, a paragraph each."""
    return [" ".join(map(reason_text, paragraph)) for paragraph in explanation.reasons]


def reason_text(reason: facts.Reason) -> str:
    """One sentence or a few that led to a verdict."""
    match reason:
        case facts.ModelFitted():
            return _model_fitted(reason)
        case facts.DataWrong(words):
            return f"{capitalised(words)}. Signs, order, units, rows and tables come before any effect: none is named."
        case facts.ToolShift():
            return f"{capitalised(reason.words)}."
        case facts.EffectFound():
            return _effect_found(reason)
        case facts.CurvesLearned():
            named = f"Learned as {reason.effect}, " + (f"in short {reason.formula}, " if reason.formula else "")
            return f"{curves_text(reason.joints, reason.inputs, reason.log_evidence)} {named}{_learned(reason.change)}."
        case facts.SetOpen():
            return _set_open(reason)
        case facts.EffectsTied():
            return _effects_tied(reason)
        case facts.EffectRefused(effect, why, detail):
            return f"{effect} explains the training poses well, but {_REFUSALS[why].format(detail)}"
        case facts.ResidualSize(residual_mm, noise_mm, noise_from):
            return (
                f"What is left is {residual_mm:.4g} mm a coordinate; the noise is {noise_mm:.4g} mm, "
                f"{_NOISE_SOURCES[noise_from]}."
            )
        case facts.MassesOff(log_evidence):
            return (
                "Beside that, a part follows from masses or centres of mass that differ from robot.toml (log evidence "
                f"{log_evidence:.0f}): it was allowed for before anything else was looked for. Better masses in robot.toml "
                "would take it away."
            )
        case facts.NoiseShaped():
            return noise_text(reason)
        case facts.ResidualOrder(inputs, p_value, channel):
            axis, motion = f"the {channel.name} of the scanner's frame", f"the motion of {channel.name}"
            where = axis if channel.joint is None else motion
            return (
                f"It has order against {', '.join(inputs)} (p = {p_value:.2g}), most in {where} against {inputs[0]}: "
                "it is not noise."
            )
        case facts.ResidualWithoutOrder(count, closest, p_value):
            return f"It shows no order against any of {count} inputs (closest: {closest}, p = {p_value:.2g})."
        case facts.ResidualTooLarge():
            return "It is more than noise."
        case facts.FaultSuspected(fault):
            return f"It looks as if {fault_text(fault)} (log evidence {fault.log_evidence:.0f})."
        case facts.PosesStandOut(poses):
            return f"Single poses stand out: {', '.join(poses)}."


def _model_fitted(model: facts.ModelFitted) -> str:
    with_effects = f" with {' and '.join(model.families)}" if model.families else ""
    noise = (
        "; no noise is declared"
        if model.noise_ratio is None
        else f", {times_text(model.noise_ratio)} the declared noise"
    )
    errors = (
        f"; the training poses are off by {model.train_rmse_mm:.4g} mm (3D RMSE), the test poses by "
        f"{model.test_rmse_mm:.4g} mm"
        if model.train_rmse_mm is not None and model.test_rmse_mm is not None
        else ""
    )
    return (
        f"The five-parameter model{with_effects} was fitted to {model.points} measured points of {model.robot} with the "
        f"{model.instrument}'s place unknown. It leaves {model.sigma_mm:.4g} mm a coordinate{noise}{errors}.{repeats_text(model.repeats)}"
    )


def _effect_found(found: facts.EffectFound) -> str:
    lead = ""
    if found.runner_up and found.lead is not None:
        lead = f" and leads the next, {found.runner_up}, by {found.lead:.0f} in log evidence"
        # Claimed with less, it has no rival: the next would explain something else, and is tried again after it.
        no_rival = found.standing == "claimed" and found.lead <= MIN_LOG_BAYES_FACTOR
        lead += (
            ", which would explain something else"
            if no_rival
            else f" (more than {MIN_LOG_BAYES_FACTOR:g} is asked for)"
        )
    if found.left_to_curves:
        stand = "stand" if len(found.left_to_curves) > 1 else "stands"
        lead += f"; {listed(found.left_to_curves)} {stand} above it in the ranking, but curves of all joints explain clearly more"
    change = "" if found.change is None else f". {_error_change(found.change)}"
    note = f" Note: {found.note}." if found.note else ""
    size = "" if found.visible_mm is None else f", {found.visible_mm:.2g} mm rms at the tool"
    return (
        f"{_STANDING[found.standing]}: {found.effect}. It explains {100 * found.explained_share:.0f} % of what was left"
        f"{size} (p = {found.p_value:.1g}){lead}{change}. {_fitted_values(found.values)}{_doubts(found)}{note}"
    )


def _doubts(found: facts.EffectFound) -> str:
    """A further sentence on the value that is furthest beyond what such causes have; "" where none is."""
    beyond = [(abs(v.value) / v.bound.size, v) for v in found.values if v.bound is not None]
    if not beyond:
        return ""
    times, value = max(beyond, key=lambda one: one[0])
    assert value.bound is not None
    return (
        f" Doubt it: {value.name} is {times:.2g} times the most that such a cause has been known to have "
        f"({value.bound.size:g} {value.unit}; {value.bound.source}), so another cause may stand behind the name."
    )


def _error_change(change: facts.ErrorChange) -> str:
    before_mm, after_mm = change.before_mm, change.after_mm
    if not change.of_test_poses:
        return f"With it the training poses fall from {before_mm:.4g} to {after_mm:.4g} mm; no test poses confirm it"
    share = after_mm / before_mm - 1.0 if before_mm > 0.0 else 0.0
    go = "hardly change," if abs(share) < facts.SMALL_CHANGE else ("fall" if share < 0.0 else "rise")
    return f"With it the test poses, which it never saw, {go} from {before_mm:.4g} to {after_mm:.4g} mm"


def _fitted_values(values: Sequence[facts.FittedValue]) -> str:
    if not values:
        return "None of its parameters is known to better than half its size by itself; together they are."
    more = len(values) - _SHOWN_VALUES
    told = [
        f"{v.name} = {v.value:.3g} +- {v.sigma:.1g}{'' if v.unit == '1' else f' {v.unit}'}"
        f"{f' ({v.meaning})' if v.meaning else ''}"
        for v in values[:_SHOWN_VALUES]
    ]
    return f"Fitted: {'; '.join(told)}{f', and {more} more' if more > 0 else ''}."


def _learned(change: facts.ErrorChange | None) -> str:
    if change is None:
        return "it names no cause"
    poses = "test poses, which it never saw," if change.of_test_poses else "training poses"
    return f"it brings the {poses} from {change.before_mm:.4g} to {change.after_mm:.4g} mm; it names no cause"


def _set_open(found: facts.SetOpen) -> str:
    out = []
    if found.twins:
        out.append(
            f"{listed([found.effect, *found.twins])} make the same of these poses: {found.effect} stands in the model for "
            f"{'both' if len(found.twins) == 1 else 'all of them'}, and none is claimed."
        )
        if found.confirm:
            out.append(f"To tell them apart, measure: {'; '.join(f'for {e}, {how}' for e, how in found.confirm)}.")
    if found.untested:
        out.append(
            f"These data lack what would tell {found.effect} from {listed(found.untested)}: it stands in the model for all "
            f"of them, and none is claimed. To settle it, {found.would_help}."
        )
    return " ".join(out)


def _effects_tied(tied: facts.EffectsTied) -> str:
    words = (
        f"Something is missing, and these data cannot tell which of {', '.join(tied.effects)}: their log evidences lie "
        "within 3 of each other."
    )
    if tied.overlaps:
        overlaps = ", ".join(f"{effect}: {100 * share:.0f} %" for effect, share in tied.overlaps)
        words += f" Of what {tied.best} explains, others could explain as much ({overlaps})."
    if tied.confirm:
        measures = "; ".join(f"for {effect}, {measure}" for effect, measure in tied.confirm)
        words += f" To tell them apart, measure: {measures}."
    if tied.poses:
        poses = poses_text(tied.poses, tied.is_revolute)
        words += f" Poses at which they differ most, joints in degrees: {poses}."
    if tied.power is not None:
        words += f" {tied.next_poses} planned poses settle it with a probability of {100 * tied.power:.0f} %."
    return words
