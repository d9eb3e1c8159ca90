"""The words of a verdict and of an advice: the terminal, the page, the report and the JSON documents take them from here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from calib.diagnosis.words import conclusions as facts
from calib.diagnosis.words.noise_text import noise_text
from calib.diagnosis.words.phrases import capitalised, curves_text, fault_text, input_text, listed

_SHOWN_INPUTS = 3


def verdict_text(verdict: facts.VerdictSentence, *, reasons: str = "above", tied: str = "") -> str:
    """The verdict alone, a sentence or two.

    Args:
        reasons: where the reader finds what led to it, "above" or "below".
        tied: how a list of effects that cannot be told apart is told ("a, b or c"), where the reader has not seen it.
    """
    named = " and ".join(verdict.effects) if not isinstance(verdict, facts.Adequate) else ""
    several = not isinstance(verdict, facts.Adequate) and len(verdict.effects) > 1
    match verdict:
        case facts.Adequate():
            return f"adequate. {_adequate(verdict)}, and {_nothing_else(verdict.test_excess)}."
        case facts.Named():
            return (
                f"{named} {'were' if several else 'was'} missing, and with {'them' if several else 'it'} "
                f"{_nothing_else(verdict.test_excess)}.{_contradiction(verdict.contradicting_points)}"
            )
        case facts.Ambiguous():
            after = f" after {named}" if named else ""
            which = f"These data cannot tell which: {tied}. This set" if tied else f"The set {reasons}"
            return (
                f"ambiguous{after}. {which} holds the cause if the catalogue does."
                f"{suspicion_text(verdict.suspected)}"
            )
        case facts.Unexplained(reason="implausible"):
            return f"unexplained. {capitalised(verdict.doubt)}."
        case facts.Unexplained():
            begin = (
                f"{named} {'help' if several else 'helps'}, yet "
                if named
                else "No effect of the catalogue fits: "
            )
            left = _unexplained(verdict.reason, reasons)
            return f"unexplained. {begin}{left}{suspicion_text(verdict.effects)}"
        case facts.Outliers():
            missing = f"{named} {'were' if several else 'was'} missing; " if named else ""
            return (
                f"outliers. {missing}apart from single poses nothing is left. Measure those poses again before you leave "
                "them out."
            )


def suspicion_text(effects: Sequence[str]) -> str:
    """A further sentence on effects that were added and are not claimed; "" where there are none."""
    if not effects:
        return ""
    several = len(effects) > 1
    return (
        f" {listed(effects)} {'are' if several else 'is'} suspected, not shown: what causes the rest may cause "
        f"{'their' if several else 'its'} part too. Do not open a gear for {'them' if several else 'it'}."
    )


def _adequate(verdict: facts.Adequate) -> str:
    """What `adequate` covers: a family that these data cannot test is not found absent."""
    if not verdict.any_tested:
        return "These data can test none of the catalogue's effects; what is left is no more than noise"
    names = ", ".join(verdict.untestable)
    covers = f", as far as these data can tell ({names}: not testable)" if names else ""
    return f"Nothing in the catalogue is missing beyond noise{covers}"


def _nothing_else(test_excess: float | None) -> str:
    """Whether the test poses, too, are off by noise alone."""
    if test_excess is None:
        return "nothing else shows"
    return (
        f"nothing else shows at the training poses; but the test poses are off by {test_excess:.2g} times what noise "
        "leaves there: they were measured in another way, on another day, or they show what the training poses do not"
    )


def _contradiction(points: int | None) -> str:
    """A warning where the test poses, within their scatter, speak against what was named."""
    if points is None:
        return ""
    return (
        f" But the {points} test points do not confirm it: they got worse, though by no more than their scatter. Take it "
        "for a lead, and measure more poses."
    )


def _unexplained(reason: str, reasons: str) -> str:
    return {
        "fault": f"what is left tells of something else, said {reasons}. Look at that joint.",
        "order": (
            f"something with a pattern is left. Look at the inputs named {reasons}; a loose part or a hose would show so."
        ),
        "curves": f"what is left follows the learned curves that are told {reasons}; no effect of the catalogue makes them.",
        "size": "more than noise is left, without a pattern against any input.",
        "wander": (
            "a slow wander of the instrument explains it as well. Measure one pose again and again through the session."
        ),
        "refused": "what was found makes the test poses worse.",
    }[reason]


def advice_text(sentences: Iterable[facts.AdviceSentence]) -> str:
    """What is left, and what to do next."""
    return " ".join(map(_advice_sentence, sentences))


def _advice_sentence(sentence: facts.AdviceSentence) -> str:
    match sentence:
        case facts.ResidualSummary():
            return residual_summary_text(sentence)
        case facts.AddEffect(effect, log_evidence, lead):
            leads = "" if lead is None else f" and leads the next by {lead:.0f}"
            return (
                f"{effect} explains it best: its evidence is {log_evidence:.0f} (3 would do){leads}. Add it; it is the "
                "cause if noise alone is left in the end."
            )
        case facts.AddCurves(effect, joints, inputs, log_evidence):
            return (
                f"{curves_text(joints, inputs, log_evidence)} {effect} adds what was learned; it names no cause. "
                "Watch whether the test poses follow."
            )
        case facts.RemoveEffect(effect):
            return f"{effect} is superfluous now: the other effects explain what it does. Remove it."
        case facts.WeighNoise(noise, effects):
            return f"What is left is noise of a shape of its own{_beside(effects)}. {noise_text(noise)}"
        case facts.LeaveOut(poses, effects):
            return (
                f"Without {listed(poses)} nothing but noise is left{_beside(effects)}. Leave {_them(poses)} out, and measure "
                f"{_them(poses)} again."
            )


def _beside(effects: tuple[str, ...]) -> str:
    return f" beside {listed(effects)}" if effects else ""


def _them(poses: tuple[str, ...]) -> str:
    return "them" if len(poses) > 1 else "it"


def residual_summary_text(summary: facts.ResidualSummary) -> str:
    """ "What is left: noise." """
    return f"What is left: {_summarised(summary)}."


def _summarised(summary: facts.ResidualSummary) -> str:
    """What a fit leaves, in a few words: noise, a pattern and against what, or more than noise."""
    if summary.fault is not None:
        return fault_text(summary.fault)
    if summary.inputs:
        more = len(summary.inputs) - _SHOWN_INPUTS
        named = ", ".join(input_text(name) for name in summary.inputs[:_SHOWN_INPUTS])
        return f"a pattern against {named}" + (f" and {more} more" if more > 0 else "")
    if summary.too_large:
        return "more than noise, without a pattern"
    if summary.outlier_poses:
        return f"noise, apart from single poses ({', '.join(summary.outlier_poses)})"
    return "noise"
