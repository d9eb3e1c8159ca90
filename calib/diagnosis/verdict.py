"""The findings of a diagnosis, and `conclude`, the one function that decides the verdict from the findings."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import takewhile
from typing import Literal

from calib.calibration.held_out import HeldOutTest
from calib.calibration.result import Calibration
from calib.consistency.data_problem import DataProblem
from calib.diagnosis.effect_selection import FitStep
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR, Candidate, Screening, Untestable
from calib.screening.curves.law_search import FoundLaws
from calib.screening.curves.smooth_joint_error import LEARNED, SmoothJointError, inputs_of, joints_of
from calib.screening.noise_search import AddedEffect, EstimatedNoise
from calib.screening.residual_tests import ResidualTests, asked_of_joints
from calib.screening.smooth_motions import JointFault

VERDICTS = ("adequate", "named", "ambiguous", "unexplained", "outliers")
MAX_SIGMAS_LEFT = 1.4  # residual over noise with the best of a tied set in the model, up to which names are claimed

Standing = Literal["claimed", "suspected", "open", "refused"]


@dataclass(frozen=True)
class LearnedModel:
    """Learned curves of joints, used where no named effect explains the residual, with fits before and after."""

    members: tuple[SmoothJointError, ...]
    formula: str | None  # the curves with their values, where short formulas explain as much
    share: float  # of the training poses' squared error that the curves remove
    before: Calibration
    after: Calibration
    log_evidence: float | None  # over no curves; None where a saved session brought them
    laws: FoundLaws | None = None  # the search that found them, where they are laws of few parameters

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that carry a curve, counted from 1."""
        return joints_of(self.members)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that the learned curves depend on."""
        return inputs_of(self.members)

    def outweighs(self, fault: JointFault) -> bool:
        """Whether what was learned has clearly more evidence than an error motion of a single joint.

        A law of that joint tells more of the same; curves of that joint alone do not.
        """
        if self.laws is not None:
            return self.laws.log_evidence > fault.log_evidence + MIN_LOG_BAYES_FACTOR
        return self.log_evidence is not None and curves_outweigh(self.members, self.log_evidence, fault)


def curves_outweigh(members: tuple[SmoothJointError, ...], log_evidence: float, fault: JointFault) -> bool:
    """Whether curves have clearly more evidence than one joint's error motion, and include another joint's curve."""
    others = any(member.joint != fault.joint for member in members)
    return others and log_evidence > fault.log_evidence + MIN_LOG_BAYES_FACTOR


@dataclass(frozen=True)
class ConfoundedSet:
    """An effect in the model, with the effects that these data cannot distinguish from it."""

    effect: str
    # Effects with the same columns at these poses, or with about as much evidence:
    equivalent: tuple[str, ...] = field(metadata={"key": "twins"})
    untested: tuple[str, ...]  # effects that the data lack the means to test
    would_help: str = ""  # what to write down or measure so that those can be tested
    # Whether the effects explain different things, and none leads the others:
    is_undecided: bool = field(default=False, metadata={"key": None})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all effects of the set, the one in the model first."""
        return tuple(dict.fromkeys([self.effect, *self.equivalent, *self.untested]))


@dataclass(frozen=True)
class Refusal:
    """Reason why an effect with evidence at the training poses was not added."""

    effect: str
    why: str  # "nature", "test poses" or "no gain"
    detail: str = ""  # for "nature": the value and the bound that it exceeds, as a clause

    @property
    def leaves_doubt(self) -> bool:
        """Whether a refused effect points to an unknown cause, and did not merely fit noise."""
        return self.why != "no gain"


@dataclass(frozen=True)
class HangingEffect:
    """An effect of the model, and the pose (id) without which nothing speaks for it, or another effect does as well."""

    effect: str
    pose: str


@dataclass(frozen=True, eq=False)
class Findings:
    """All findings of a search on a dataset, without the verdict, which `conclude` derives."""

    steps: tuple[FitStep, ...]  # link errors, then one for each effect added (learned curves last), each screened
    all_tests: ResidualTests  # of the residual of the last fit without learned curves
    implausible: str = ""  # why points and poses do not belong together, as a clause; "" where they do
    confounded_sets: tuple[ConfoundedSet, ...] = ()  # each with one effect in the model
    refused: Refusal | None = None
    left_to_curves: bool = False  # whether learned curves explain more than the next effect, of one place or pose
    no_more_than_drift: AddedEffect | None = None  # first effect with no more evidence than a drift of the instrument
    hanging: HangingEffect | None = None  # first effect for which a single pose speaks alone
    held_out: HeldOutTest | None = None  # the test poses against the error that the last fit predicts for them
    far_test_poses: tuple[str, ...] = ()  # ids, off by more than any training pose left out
    noise: EstimatedNoise | None = None  # where the noise has another shape than was declared
    learned: LearnedModel | None = None  # then its fit is the last step
    data_problem: DataProblem | None = None  # wrong signs, order, units, rows or robot table
    swapped: tuple[tuple[str, str], ...] = ()  # pairs of outlying poses, each measured where the other has to be

    @property
    def calibration(self) -> Calibration:
        """Last fit of the search, with all effects that were added."""
        return self.steps[-1].calibration

    @property
    def named(self) -> tuple[str, ...]:
        """Names of all effects that the search added, whether claimed, suspected or open; without learned curves."""
        return tuple(effect.name for effect in self.steps[-1].selected if effect.name != LEARNED)

    @property
    def decided_steps(self) -> tuple[FitStep, ...]:
        """Steps up to the first effect that does not lead others, without learned curves."""
        led = takewhile(lambda step: not step.on_behalf_of, self.steps)
        return tuple(step for step in led if step.effect != LEARNED)

    @property
    def undecided(self) -> ConfoundedSet | None:
        """The first set of effects of which none leads the others; None where one led in every step."""
        return next((one for one in self.confounded_sets if one.is_undecided), None)

    @property
    def promise_is_broken(self) -> bool:
        """Whether the test poses are off by more than the fit predicts, or many by more than any training pose."""
        return bool(self.far_test_poses) or (self.held_out is not None and self.held_out.shows_the_model_wrong)

    @property
    def outlier_poses(self) -> tuple[str, ...]:
        """Poses that stand out: by their residual in the fit, or by a gross error beside test poses as promised."""
        of_test = () if self.held_out is None else self.held_out.alone
        return tuple(dict.fromkeys([*self.residual_tests.outlier_poses, *of_test]))

    @cached_property
    def residual_tests(self) -> ResidualTests:
        """Tests of the residual, patterns on joints of added effects first asked for on these joints alone.

        An error motion of one joint is kept only where that may be reported: not where an effect is fitted on behalf of
        others, whose part the residual may hold, nor where the data are wrong, nor where learned curves of other joints
        explain more.
        """
        added = [effect for effect in self.steps[-1].selected if effect.name != LEARNED]
        tests = asked_of_joints(self.all_tests, {joint for effect in added for joint in effect.joints})
        fault = tests.fault
        hidden = self.undecided is not None or self.data_problem is not None
        if fault is not None and (hidden or (self.learned is not None and self.learned.outweighs(fault))):
            return replace(tests, fault=None)
        return tests

    @property
    def unproven(self) -> str:
        """Name of an effect in the model that a correlated drift of the instrument explains as well; "" for none."""
        effect = "" if self.no_more_than_drift is None else self.no_more_than_drift.effect
        return effect if effect in self.named else ""

    @property
    def screenings(self) -> tuple[Screening, ...]:
        """Screening of each step: the evidence of every effect that is not in the step's model."""
        return tuple(step.screening for step in self.steps if step.screening is not None)

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Candidate effects as ranked before the first decision."""
        return self.screenings[0].candidates

    @property
    def untestable(self) -> tuple[Untestable, ...]:
        """Effects that these data cannot test, with the reasons."""
        return self.screenings[0].untestable


@dataclass(frozen=True)
class Conclusion:
    """The verdict, the standing of each effect (claimed, suspected, open, refused), and the reason."""

    verdict: str  # of VERDICTS
    missing: tuple[str, ...] = ()  # effects that are claimed, in the order added
    suspected: tuple[str, ...] = ()  # effects that were added and are not claimed
    ambiguous_set: tuple[str, ...] = ()  # effects that these data cannot tell apart, those with one in the model first
    refused: str = ""  # an effect that was not added in spite of its evidence
    reason: str = ""  # what keeps an unexplained dataset so: see `_reason`

    def standing(self, effect: str) -> Standing | None:
        """Standing of an effect: claimed, suspected, open or refused; None for an effect that was never considered."""
        if effect in self.missing:
            return "claimed"
        if effect in self.suspected:
            return "suspected"
        if effect in self.ambiguous_set:
            return "open"
        return "refused" if effect and effect == self.refused else None


def conclude(findings: Findings) -> Conclusion:
    """The verdict on a dataset and the standing of each effect: the only place where either is decided.

    The first of these that holds:

    1. `unexplained` where the data are wrong, or where curves had to be learned (no name explains what they follow).
    2. Where an effect has no more evidence than a correlated drift of the instrument, or only by a single pose,
       `ambiguous` if effects are confounded, else `unexplained`.
    3. `ambiguous` where effects are left of which none leads the others.
    4. `unexplained` where the residual is not noise, the test poses are off by more than predicted, or the only effect
       was refused for a reason that leaves doubt.
    5. `ambiguous` where an effect in the model is confounded with others.
    6. `outliers` where single poses stand out, else `named` where effects were added, else `adequate`.

    Effects in the model are claimed, but for confounded ones, unless the verdict is `unexplained` or an effect is
    unproven: what causes the rest may have made them look as they do. Where effects are left of which none leads, only
    those are claimed that were added before, and the residual with the best of the others has to be noise. An error
    that grows with the angle of a joint is not claimed beside an open cause that moves the same joint, as it may be a
    part of it.
    """
    confounded = tuple(dict.fromkeys(name for one in findings.confounded_sets for name in one.names))
    ambiguous_set = () if findings.learned is not None else confounded
    verdict = _verdict(findings, ambiguous_set)
    rest_is_noise = findings.undecided is None or _is_noise(findings.all_tests)
    claimed = verdict != "unexplained" and not (findings.unproven or findings.hanging) and rest_is_noise
    led = {effect.name for effect in findings.decided_steps[-1].selected} - _parts_of_open_ones(findings, confounded)
    undecided = {name for one in findings.confounded_sets if one.is_undecided for name in one.names}
    return Conclusion(
        verdict=verdict,
        missing=tuple(name for name in findings.named if name not in confounded and name in led) if claimed else (),
        suspected=tuple(n for n in findings.named if n not in (led.union(confounded) if claimed else undecided)),
        ambiguous_set=ambiguous_set,
        refused="" if findings.refused is None else findings.refused.effect,
        reason=_reason(findings) if verdict == "unexplained" else "",
    )


def _parts_of_open_ones(findings: Findings, confounded: Collection[str]) -> set[str]:
    """Names of effects that grow with the angle of a joint on which a confounded effect of the model acts, too."""
    last = [effect for effect in findings.steps[-1].selected if effect.name != LEARNED]
    joints = {joint for effect in last if effect.name in confounded for joint in effect.joints}
    return {effect.name for effect in last if effect.grows_with_angle and joints & effect.joints}


def _verdict(findings: Findings, ambiguous_set: tuple[str, ...]) -> str:
    tests, refused = findings.residual_tests, findings.refused
    if findings.data_problem is not None or findings.learned is not None:
        return "unexplained"
    if findings.unproven or findings.hanging is not None:
        return "ambiguous" if ambiguous_set else "unexplained"
    if findings.undecided is not None:
        return "ambiguous"
    only_refused = refused is not None and refused.leaves_doubt and not findings.named
    doubted = findings.implausible or only_refused or findings.left_to_curves or findings.promise_is_broken
    if doubted or not tests.is_noise:
        return "unexplained"
    if findings.confounded_sets:
        return "ambiguous"
    if findings.outlier_poses:
        return "outliers"
    return "named" if findings.named else "adequate"


def _is_noise(tests: ResidualTests) -> bool:
    """Whether a residual counts as noise: no pattern, no error motion of a joint, no excess over known noise."""
    too_large = tests.noise_from != "fit" and tests.residual_mm > MAX_SIGMAS_LEFT * tests.noise_mm
    return not (tests.fault or tests.structured or too_large)


def _reason(findings: Findings) -> str:
    """Reason why a dataset stays unexplained, the most definite first.

    "data" (wrong), "implausible", "fault" (of one joint), "curves" (learned), "order" (a systematic pattern), "wander"
    (an effect is no better than a correlated drift), "size" (more than noise), "promise" (broken at the test poses),
    "pose" (an effect hangs on a single one) or "refused".
    """
    tests = findings.residual_tests
    reasons = {
        "data": findings.data_problem is not None,
        "implausible": bool(findings.implausible),
        "fault": tests.fault is not None,
        "curves": findings.learned is not None,
        "order": bool(tests.structured),
        "wander": bool(findings.unproven) and not tests.too_large,
        "size": tests.too_large,
        "promise": findings.promise_is_broken,
        "pose": findings.hanging is not None,
    }
    return next((reason for reason, holds in reasons.items() if holds), "refused")
