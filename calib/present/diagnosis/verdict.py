"""Sentences of a diagnosis' verdict and of the advice on a model."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from calib.calibration.held_out import HeldOutTest
from calib.calibration.result import Calibration
from calib.diagnosis.advice import Advice
from calib.diagnosis.causes import AtPose, Cause, cause_of, worst_pose
from calib.diagnosis.decision_rules import untestable_names
from calib.diagnosis.headline import HeldOutError
from calib.diagnosis.moves import AddCurves, AddEffect, DropEffect, LeaveOutPoses, Move, ShapeNoise
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import descriptions
from calib.effects.effect import describe
from calib.present.diagnosis.noise import noise_sentences
from calib.present.effects import meaning, title, with_key
from calib.present.fit.calibration import leading_entry_sentence, table_doubts
from calib.present.fit.learned import law_phrase
from calib.present.names import input_name
from calib.rendering import numbers
from calib.rendering.blocks import Words, capitalised, effect, effects, joined, joint, listed, pose, spans
from calib.screening.curves.law_readings import law_readings
from calib.screening.curves.law_search import FoundLaws
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.residual_tests import ResidualTests
from calib.screening.smooth_motions import JointFault

SMALL_CHANGE = 0.03  # share of the test poses' error below which a change of it counts for nothing
_OTHER_POSES = (
    "They were measured in another way or on another day, or they show what the training poses do not. Measure "
    "training poses like them."
)
_SHOWN_INPUTS = 3
_SHOWN_POSES = 4
_SHOWN_UNTESTABLE = 5


# ---- the verdict ----------------------------------------------------------------------------------------------------


def verdict(diagnosis: Diagnosis) -> Words:
    """Sentence or two with the verdict alone, beginning with a small letter."""
    tell = {
        "adequate": _adequate,
        "named": _named,
        "ambiguous": _ambiguous,
        "unexplained": _unexplained,
        "outliers": _outliers,
    }[diagnosis.verdict]
    doubts = [f"{numbers.capitalised(doubt).removesuffix('.')}." for doubt in table_doubts(diagnosis.calibration)]
    leading = "" if doubts else leading_entry_sentence(diagnosis.calibration)
    moved = move_sentences(diagnosis)
    return spans(tell(diagnosis), *(f" {one}" for one in (*moved, *doubts)), f" {leading}" if leading else "")


def move_sentences(diagnosis: Diagnosis) -> list[str]:
    """Sentences on the moves of the instrument that a diagnosis claims, in the order in which they happened."""
    return [
        f"The instrument was moved between {move.after} and {move.before}: that is no error of the arm, and is kept "
        "out of tables and corrections."
        for move in diagnosis.instrument_moved
    ]


def _adequate(diagnosis: Diagnosis) -> Words:
    left = worst_pose(diagnosis.calibration)
    at_most = () if left is None else spans(": the largest error is ", _at_pose(left))
    names = numbers.in_short(untestable_names(diagnosis.untestable), _SHOWN_UNTESTABLE)
    covers = f", as far as these data can test ({names}: not testable)" if names else ""
    found = f"Nothing in the catalogue is missing beyond noise{covers}"
    if not diagnosis.candidates:
        found = "These data can test none of the catalogue's effects; what is left is no more than noise"
    return spans("adequate", at_most, f". {found}, and {_nothing_else(diagnosis)}.")


def _named(diagnosis: Diagnosis) -> Words:
    them = {1: "it", 2: "both"}.get(len(diagnosis.missing), "all of them")
    contradiction = ""
    first, last = diagnosis.steps[0].calibration.after.test, diagnosis.calibration.after.test
    if first and last and last.rmse_mm >= (1.0 + SMALL_CHANGE) * first.rmse_mm:
        contradiction = (
            f" But the {last.points} test points do not confirm it: they got worse, though by no more than their "
            "scatter. Treat it as a hypothesis, and measure more poses."
        )
    return spans(_missing(diagnosis), f". With {them} in the model {_nothing_else(diagnosis)}.{contradiction}")


def _ambiguous(diagnosis: Diagnosis) -> Words:
    open_causes = _causes(diagnosis, [confounded.effect for confounded in diagnosis.confounded_sets])
    first = next(iter(open_causes), None)
    left = worst_pose(diagnosis.calibration) if first is None else first.largest
    after = spans(" after ", effects(diagnosis.missing)) if diagnosis.missing else ()
    makes: Words = ()
    if left is not None:
        carriers = () if first is None or not first.joints else spans(" comes from ", _joints(first.joints))
        makes = spans(": an error of up to ", _at_pose(left), carriers)
    return spans(
        "ambiguous", after, makes, ". These data cannot tell which effect is the cause: ",
        effects(diagnosis.ambiguous_set, "or"), "; it is one of them if the catalogue has it at all.",
        _suspicion(diagnosis.suspected),
    )  # fmt: skip


def _outliers(diagnosis: Diagnosis) -> Words:
    poses = diagnosis.outlier_poses
    worst = worst_pose(diagnosis.calibration, poses)
    others = [pose(name) for name in poses if worst is None or name != worst.pose]
    stand = "stand" if len(others) > 1 else "stands"
    off: Words = ()
    if worst is None and others:  # they are left out of the fit, which has no errors there
        off = spans(": ", listed(others), f" {stand} out")
    elif worst is not None:
        more = spans(", and ", listed(others), f" {stand} out too") if others else ()
        off = spans(": pose ", pose(worst.pose), f" is off by {numbers.length(worst.size_mm)}", more)
    missing = spans(_missing(diagnosis), ". ") if diagnosis.missing else ()
    pairs = [f"{one} and {other}" for one, other in diagnosis.swapped]
    again = "Measure those poses again before you leave them out."
    if pairs:
        swapped = f"The measurements of {numbers.listing(pairs)} are swapped: each lies where the other has to be."
        rest = set(poses) - {name for pair in diagnosis.swapped for name in pair}
        again = f"{swapped} Exchange them, and diagnose again." + (f" {again}" if rest else "")
    return spans("outliers", off, ". ", missing, f"Apart from single poses nothing is left. {again}")


def _unexplained(diagnosis: Diagnosis) -> Words:
    if diagnosis.data_problem is not None:
        wrong = numbers.capitalised(diagnosis.data_problem.warning)
        return f"unexplained: the data or the table are wrong, not the arm. {wrong}."
    tests, last = diagnosis.residual_tests, diagnosis.calibration
    left = worst_pose(last if diagnosis.learned is None else diagnosis.learned.before)
    if diagnosis.conclusion.reason == "implausible":
        at_most = () if left is None else spans(": up to ", _at_pose(left), " is left")
        return spans("unexplained", at_most, f". {numbers.capitalised(diagnosis.implausible)}.")
    unknown: Words = ()
    if left is not None:
        number = tests.strongest_joint
        most = () if number is None else spans(", most of it in the motion of ", joint(number, f"joint {number}"))
        unknown = spans(": up to ", _at_pose(left), " has no known cause", most)
    begin: Words = "No effect of the catalogue fits: "
    if helping := diagnosis.suspected:
        begin = spans(effects(helping), " help" if len(helping) > 1 else " helps", ", yet ")
    return spans("unexplained", unknown, ". ", begin, _left_unexplained(diagnosis), _suspicion(diagnosis.suspected))


def _left_unexplained(diagnosis: Diagnosis) -> Words:
    """Sentence on the reason why a dataset is unexplained, by `Conclusion.reason`."""
    tests, reason, refused = diagnosis.residual_tests, diagnosis.conclusion.reason, diagnosis.refused
    match reason:
        case "fault" if tests.fault is not None:
            return spans("it looks as if ", fault(tests.fault), ". Look at that joint.")
        case "order":
            return spans(
                "the residual depends systematically on ", _inputs(tests.structured),
                "; a loose part or a hose would show so.",
            )  # fmt: skip
        case "curves" if diagnosis.learned is not None and diagnosis.learned.laws is not None:
            told = numbers.listing([law_phrase(one, begin="joint") for one in law_readings(diagnosis.learned.after)])
            return f"{told}, which no effect of the catalogue makes."
        case "curves" if diagnosis.learned is not None:
            return spans(
                "the residual follows learned curves of ", _joints(diagnosis.learned.joints),
                ", which no effect of the catalogue makes.",
            )  # fmt: skip
        case "size":
            return "more than noise is left, without a systematic dependence on any input."
        case "wander":
            return "a slow drift of the instrument explains it as well. Measure one pose again and again meanwhile."
        case "pose" if diagnosis.hanging is not None:
            return spans(
                "only pose ", pose(diagnosis.hanging.pose), f" speaks for {title(diagnosis.hanging.effect)}: without "
                "it nothing shows, or another cause explains as much. Measure it again, and poses like it.",
            )  # fmt: skip
        case "promise" if diagnosis.held_out is not None and diagnosis.held_out.shows_the_model_wrong:
            return promise(diagnosis.held_out)
        case "promise":
            shown = listed(numbers.first_of([pose(name) for name in diagnosis.far_test_poses], _SHOWN_POSES))
            beyond = "test poses are far more off than any training pose that is left out: "
            return spans(beyond, shown, f". {_OTHER_POSES}")
    if refused is not None and refused.why == "nature":
        return "what would explain it is larger than such a cause can be."
    return "what was found makes the test poses worse."


def promise(test: HeldOutTest) -> str:
    """Sentence on test poses whose error exceeds the model's predicted error, with possible reasons."""
    off = (
        f"the test poses are off by {numbers.length(test.rmse_mm)}, where noise and the uncertainty of the fit predict "
        f"{numbers.length(test.promised_mm)}"
    )
    if test.alone:
        alone = numbers.listing(test.alone)
        return f"{off}; that is {alone} alone, and the others are as promised. Measure again what is off."
    return f"{off}. {_OTHER_POSES}"


def _missing(diagnosis: Diagnosis) -> Words:
    causes = [cause(one, diagnosis.calibration) for one in _causes(diagnosis, diagnosis.missing)]
    named = joined(causes, "; and ") if causes else listed(map(with_key, diagnosis.missing))
    return spans("What is missing is ", named)


def _causes(diagnosis: Diagnosis, keys: Sequence[str]) -> list[Cause]:
    """Causes (joints, size, worst pose) of some effects on this arm, as in the last fit."""
    return [
        cause_of(after.effect, before.calibration, after.calibration)
        for before, after in pairwise(diagnosis.steps)
        if after.effect is not None and after.effect in keys
    ]


def cause(found: Cause, calibration: Calibration) -> Words:
    """Text on an effect: its noun and joints, its size, and the pose where it is largest."""
    noun = "" if found.leading is None else describe(found.leading).noun
    named_by_key = not noun and title(found.effect) == found.effect
    key: Words = () if named_by_key else spans(" (", effect(found.effect), ")")
    noun = noun or title(found.effect) + (" of joint" if found.joints else "")
    named: Words = noun
    if noun.endswith(" joint"):
        rest, preposition = noun.removesuffix(" joint").rsplit(" ", 1)
        if len(found.joints) > 1:
            main, *others = found.joints
            also = listed([joint(number) for number in sorted(others)])
            named = spans(f"{rest}, mainly {preposition} ", joint(main, f"joint {main}"), ", also ", also)
        elif found.joints:
            named = spans(f"{rest} {preposition} ", joint(found.joints[0], f"joint {found.joints[0]}"))
        else:
            named = rest
    facts: list[Words] = []
    if (value := found.main) is not None and found.leading is not None:
        # At its leading joint: an amplitude, or the meaning of its surest value on the arm.
        means = value.parameter and meaning(found.leading, value.parameter, value.value, calibration)
        facts.append(means or numbers.size(value.value, value.unit))
    if found.largest is not None:
        facts.append(spans("up to ", _at_pose(found.largest)))
    return spans(named, key, ": " if facts else "", joined(facts, ", "))


def _nothing_else(diagnosis: Diagnosis) -> str:
    """Clause that only noise is left, with a reservation where the test poses' error exceeds noise."""
    beyond = diagnosis.held_out_beyond_noise
    if beyond is None:
        return "only noise is left"
    off = f"{numbers.length(beyond.rmse_mm)}, {numbers.times(beyond.noise_ratio)} the noise"
    return (
        f"only noise is left at the training poses; the test poses are off by {off}, as they may be where the training "
        "poses say little about such poses"
    )


def _suspicion(keys: Sequence[str]) -> Words:
    """Sentence on effects that were added and are not claimed."""
    if not keys:
        return ()
    are, their, them = ("are", "their", "them") if len(keys) > 1 else ("is", "its", "it")
    described = {one.name: one for one in descriptions()}
    outside = all(key in described and described[key].of != "arm" for key in keys)
    leave = f"Do not dismantle anything because of {them}."
    advice = "Either way that would lie outside the arm: leave the arm closed." if outside else leave
    return spans(
        " ", effects(keys),
        f" {are} suspected, not confirmed: the unexplained rest may have caused {their} part. {advice}",
    )  # fmt: skip


def _at_pose(at: AtPose) -> Words:
    return spans(f"{numbers.length(at.size_mm)} at pose ", pose(at.pose))


def _joints(of: Sequence[int]) -> Words:
    return spans("joints " if len(of) > 1 else "joint ", listed(map(joint, of)))


def _inputs(keys: Sequence[str]) -> Words:
    return listed(numbers.first_of([input_name(key) for key in keys], _SHOWN_INPUTS))


def fault(found: JointFault) -> Words:
    """Text on one joint's apparent error motion that no effect describes, without a full stop."""
    number = found.joint + 1
    return spans(
        joint(number, f"joint {number}"),
        f" moves the tool by about {numbers.length(found.visible_mm)}, beyond what links could, in a way that changes "
        "smoothly with the arm's attitude",
    )


def curves(joints: Sequence[int], inputs: Sequence[str], log_evidence: float | None) -> Words:
    """Sentence on curves of joints (counted from 1) over inputs, and their log evidence."""
    worth = "" if log_evidence is None else f" (log evidence {log_evidence:.0f} over noise)"
    return _followed("curves" if len(joints) > 1 else "a curve", joints, inputs, worth)


def _followed(what: str, joints: Sequence[int], inputs: Sequence[str], worth: str) -> Words:
    over = listed(map(input_name, inputs))
    follows = f"The residual follows {what} of "
    return spans(follows, _joints(joints), " over ", over, f" that no effect of the catalogue makes{worth}.")


def laws(joints: Sequence[int], inputs: Sequence[str], found: FoundLaws) -> Words:
    """Sentence on laws of joints (counted from 1) over inputs, their log evidence, and how many were tried."""
    less = f", less the cost of choosing among {found.tried}"
    worth = f" (log evidence {found.log_evidence:.0f} over noise{less})"
    return _followed("laws" if len(found.laws) > 1 else "a law", joints, inputs, worth)


# ---- the residual in short, and the advice --------------------------------------------------------------------------


def residual(tests: ResidualTests, held_out: HeldOutError | None) -> Words:
    """Sentence on the residual of a fit: noise, a systematic dependence, or more than noise.

    held_out: of the test poses, where they are off by more than noise.
    """
    return spans("What is left: ", _residual(tests, held_out), ".")


def residual_of(diagnosis: Diagnosis) -> Words:
    """Sentence on the residual of the last fit of a diagnosis."""
    return residual(diagnosis.residual_tests, diagnosis.held_out_beyond_noise)


def _residual(tests: ResidualTests, held_out: HeldOutError | None) -> Words:
    if tests.fault is not None:
        return fault(tests.fault)
    if tests.structured:
        return spans("a systematic dependence on ", _inputs(tests.structured))
    if tests.too_large:
        return "more than noise, without a systematic dependence"
    if tests.outlier_poses:
        return spans("noise, apart from single poses (", listed(map(pose, tests.outlier_poses)), ")")
    if held_out is not None:
        ratio = f"{numbers.times(held_out.noise_ratio)} the noise"
        return f"noise at the training poses; {numbers.length(held_out.rmse_mm)} at the test poses, {ratio}"
    return "noise"


def advice(given: Advice) -> Words:
    """Sentences on the residual of a fit and on the next move."""
    return spans(residual(given.residual_tests, given.held_out), " ", move(given.move))


def move(made: Move) -> Words:
    """Sentence or two on the recommended next move and the reason for it."""
    match made:
        case AddEffect():
            factor = made.log_bayes_factor
            leads = "" if factor is None else f", log Bayes factor over the next {factor:.0f}"
            evidence = f"log evidence {made.candidate.log_evidence:.0f}{leads}"
            explains: Words = f" explains it best, by strong evidence ({evidence}). Add it"
            if made.instead_of:
                explains = spans(
                    " explains more than ", with_key(made.instead_of),
                    f" given all other effects ({evidence}). It takes that effect's place",
                )  # fmt: skip
            cause_if = "; it is the cause if noise alone is left in the end."
            return spans(capitalised(with_key(made.name)), explains, cause_if)
        case DropEffect(name=name):
            return spans(
                capitalised(with_key(name)), " is superfluous now: the other effects explain what it does. Remove it."
            )
        case LeaveOutPoses(poses=poses):
            them = "them" if len(poses) > 1 else "it"
            return spans(
                "Without ", listed(map(pose, poses)), " nothing but noise is left", _besides(made),
                f". Leave {them} out, and measure {them} again.",
            )  # fmt: skip
        case ShapeNoise():
            of_noise = noise_sentences(made.diagnosis)
            return spans("What is left is noise of a shape of its own", _besides(made), f". {of_noise}")
        case AddCurves(curves=learned) if learned.laws is not None:
            return spans(
                laws(learned.joints, learned.inputs, learned.laws), f" {LEARNED} adds it. Watch whether the test ",
                "poses follow.",
            )  # fmt: skip
        case AddCurves(curves=learned):
            return spans(
                curves(learned.joints, learned.inputs, learned.log_evidence), f" {LEARNED} adds what was learned; it ",
                "names no cause. Watch whether the test poses follow.",
            )  # fmt: skip


def _besides(made: LeaveOutPoses | ShapeNoise) -> Words:
    missing = made.diagnosis.missing
    return spans(" besides ", effects(missing)) if missing else ()
