"""The words of a verdict and of what a fit leaves: the terminal, the page, the report and the JSON documents take them from here."""

from __future__ import annotations

from collections.abc import Sequence

from calib.calibration.held_out import HeldOutTest
from calib.diagnosis.words import conclusions as facts
from calib.diagnosis.words.phrases import (
    capitalised,
    fault_text,
    input_text,
    length_text,
    listed,
    times_text,
)

_SHOWN_INPUTS = 3
_SHOWN_UNTESTABLE = 5


def verdict_text(verdict: facts.VerdictSentence, *, reasons: str = "above", tied: str = "") -> str:
    """The verdict alone, a sentence or two.

    Args:
        reasons: where the reader finds what led to it, such as "above", "below" or "by inspector diagnose".
        tied: how a list of effects that cannot be told apart is told ("a, b or c"), where the reader has not seen it.
    """
    match verdict:
        case facts.Adequate():
            return f"adequate{_at_most(verdict.left)}. {_adequate(verdict)}, and {_nothing_else(verdict)}."
        case facts.Named():
            them = "them" if len(verdict.effects) > 1 else "it"
            return (
                f"{missing_text(verdict.effects, verdict.causes)}. With {them} {_nothing_else(verdict)}."
                f"{_contradiction(verdict.contradicting_points)}"
            )
        case facts.Ambiguous():
            after = f" after {' and '.join(verdict.effects)}" if verdict.effects else ""
            which = f"These data cannot tell which: {tied}. This set" if tied else f"The set {reasons}"
            return (
                f"ambiguous{after}{_open(verdict)}. {which} holds the cause if the catalogue does."
                f"{suspicion_text(verdict.suspected)}"
            )
        case facts.Unexplained(reason="implausible"):
            return f"unexplained{_at_most(verdict.left)}. {capitalised(verdict.doubt)}."
        case facts.Unexplained(reason="data"):
            return f"unexplained: the data or the table are wrong, not the arm. {capitalised(verdict.doubt)}."
        case facts.Unexplained():
            begin = (
                f"{' and '.join(verdict.effects)} {'help' if len(verdict.effects) > 1 else 'helps'}, yet "
                if verdict.effects
                else "No effect of the catalogue fits: "
            )
            left = _unexplained(verdict, reasons)
            return f"unexplained{_left_over(verdict)}. {begin}{left}{suspicion_text(verdict.effects)}"
        case facts.Outliers():
            missing = f"{missing_text(verdict.effects, verdict.causes)}. " if verdict.effects else ""
            return (
                f"outliers{_standing_out(verdict)}. {missing}Apart from single poses nothing is left. Measure those poses "
                "again before you leave them out."
            )


def missing_text(effects: Sequence[str], causes: Sequence[facts.Cause] = ()) -> str:
    """ "What is missing is the compliance of joint 2 (joint_compliance): 0.051° at 63.3 Nm, 0.68 mm at pose p12"."""
    told = "; and ".join(map(cause_text, causes)) if causes else " and ".join(effects)
    return f"What is missing is {told}"


def cause_text(cause: facts.Cause) -> str:
    """Joint, name, size, and where it shows the most."""
    noun = cause.noun or (f"{cause.effect} of joint" if cause.joints else cause.effect)
    if noun.endswith("joint"):
        noun = f"{noun} {cause.joints[0]}" if cause.joints else noun.removesuffix(" of joint")
    rest = sorted(cause.joints[1:])
    more = f", less of {'joints' if len(rest) > 1 else 'joint'} {listed(list(map(str, rest)))}" if rest else ""
    name = f" ({cause.effect})" if cause.noun else ""
    facts_of_it = ", ".join(filter(None, [cause.size, at_pose_text(cause.largest)]))
    return f"{noun}{more}{name}{': ' if facts_of_it else ''}{facts_of_it}"


def at_pose_text(at: facts.AtPose | None) -> str:
    """ "0.68 mm at pose p12"; "" where it is not known."""
    return "" if at is None else f"{length_text(at.size_mm)} at pose {at.pose}"


def _at_most(left: facts.AtPose | None) -> str:
    return "" if left is None else f": at most {at_pose_text(left)} is left"


def _open(verdict: facts.Ambiguous) -> str:
    if verdict.left is None:
        return ""
    joints = verdict.joints
    of = f" of joint{'s' if len(joints) > 1 else ''} {listed(list(map(str, joints)))}" if joints else ""
    return f": something{of} makes up to {at_pose_text(verdict.left)}"


def _left_over(verdict: facts.Unexplained) -> str:
    if verdict.left is None:
        return ""
    most = "" if verdict.joint is None else f", most of it in the motion of joint {verdict.joint}"
    return f": up to {at_pose_text(verdict.left)} has no known cause{most}"


def _standing_out(verdict: facts.Outliers) -> str:
    if verdict.left is None:
        return ""
    others = [pose for pose in verdict.poses if pose != verdict.left.pose]
    more = f", and {listed(others)} {'stand' if len(others) > 1 else 'stands'} out too" if others else ""
    return f": pose {verdict.left.pose} is off by {length_text(verdict.left.size_mm)}{more}"


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
    more = len(verdict.untestable) - _SHOWN_UNTESTABLE
    names = ", ".join(verdict.untestable[:_SHOWN_UNTESTABLE]) + (f" and {more} more" if more > 0 else "")
    covers = f", as far as these data can tell ({names}: not testable)" if names else ""
    return f"Nothing in the catalogue is missing beyond noise{covers}"


def _nothing_else(verdict: facts.Adequate | facts.Named) -> str:
    """Whether the test poses, too, are off by noise alone."""
    held_out = verdict.held_out
    if held_out is not None:
        return (
            f"nothing else shows at the training poses; the test poses are off by {length_text(held_out.rmse_mm)}, "
            f"{times_text(held_out.noise_ratio)} the noise, as they may be where training poses tell little of such poses"
        )
    return "nothing else shows"


def _contradiction(points: int | None) -> str:
    """A warning where the test poses, within their scatter, speak against what was named."""
    if points is None:
        return ""
    return (
        f" But the {points} test points do not confirm it: they got worse, though by no more than their scatter. Take it "
        "for a lead, and measure more poses."
    )


def _unexplained(verdict: facts.Unexplained, reasons: str) -> str:
    if verdict.reason == "promise" and verdict.held_out is not None:
        return promise_text(verdict.held_out)
    if verdict.reason == "refused" and verdict.refusal == "nature":
        return "what would explain it is larger than such a cause can be."
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
    }[verdict.reason]


def promise_text(test: HeldOutTest) -> str:
    """A sentence on test poses that are off by more than was promised, and what may be behind it."""
    return (
        f"the test poses are off by {length_text(test.rmse_mm)}, where the noise and what the fit does not know promise "
        f"{length_text(test.promised_mm)}: they were measured in another way or on another day, or they show what the "
        "training poses do not. Measure training poses like them."
    )


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
    if summary.held_out is not None:
        held_out = summary.held_out
        return (
            f"noise at the training poses; {length_text(held_out.rmse_mm)} at the test poses, "
            f"{times_text(held_out.noise_ratio)} the noise"
        )
    return "noise"
