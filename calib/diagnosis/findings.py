"""What a diagnosis found: the verdict on a dataset, and the fits and tests that led to it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from calib.calibration.held_out import HeldOutTest
from calib.calibration.result import Calibration
from calib.consistency.data_problem import DataProblem
from calib.diagnosis.effect_selection import FitStep
from calib.screening.candidates import Candidate, Screening, Untestable
from calib.screening.curves.smooth_joint_error import LEARNED, SmoothJointError, inputs_of, joints_of
from calib.screening.noise.shown_noise import Added, ShownNoise
from calib.screening.residual_tests import ResidualTests
from calib.screening.rivals.pose_recommendation import DiscriminatingPose, poses_of
from calib.screening.rivals.split import Split


@dataclass(frozen=True)
class Learned:
    """Curves of the joints that were learned where no named effect explains what is left."""

    members: tuple[SmoothJointError, ...]
    formula: str | None  # the curves with their values, where short formulas say as much
    share: float  # of the training poses' squared error before, that they take away
    before: Calibration
    after: Calibration

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that carry a curve, counted from 1."""
        return joints_of(self.members)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that the curves run over."""
        return inputs_of(self.members)


@dataclass(frozen=True)
class OpenSet:
    """An effect in the model, and those that could stand there as well."""

    effect: str
    twins: tuple[str, ...]  # that make the same of these poses
    untested: tuple[str, ...]  # that the data lack the means to tell from it
    would_help: str = ""  # what to write down or measure so that they can be tested

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all effects of the set, the one in the model first."""
        return tuple(dict.fromkeys([self.effect, *self.twins, *self.untested]))


@dataclass(frozen=True)
class Refusal:
    """Why an effect that the training poses speak for was not added."""

    effect: str
    why: str  # "nature", "test poses" or "no gain"
    detail: str = ""  # for "nature": what is beyond which bound, as a clause

    @property
    def leaves_doubt(self) -> bool:
        """Whether what the effect explains has some other cause; one that helps nowhere else was noise."""
        return self.why != "no gain"


@dataclass(frozen=True)
class Findings:
    """The verdict on a dataset and all that led to it; `Diagnosis` puts it into words."""

    verdict: str  # of decision_rules.VERDICTS
    missing: tuple[str, ...]  # effects that are claimed, in the order added
    ambiguous_set: tuple[str, ...]  # effects that these data cannot tell apart, those of open sets first
    steps: tuple[FitStep, ...]  # the link errors, then one for each effect that was added; each with its screening
    residual_tests: ResidualTests  # what the last fit left over
    refused: Refusal | None = None  # an effect that would have been named, and why it was not
    held_out: HeldOutTest | None = None  # the test poses against what the last fit promised
    left_to_curves: bool = False  # learned curves say more than the next effect, which is of one place or pose
    learned: Learned | None = None  # then its fit is the last step
    suspected: tuple[str, ...] = ()  # effects that were added and are not claimed, see `carries_its_names`
    open_sets: tuple[OpenSet, ...] = ()  # each with one effect in the model
    beaten: str = ""  # an effect that was added, and does not lead a slow wander of the instrument
    noise: ShownNoise | None = None  # where the noise has another shape than was declared
    data_problem: DataProblem | None = None  # signs, order, units, rows or the table are wrong: nothing is named then
    split: Split | None = None  # the next poses by which the first of the open sets is told apart

    @property
    def calibration(self) -> Calibration:
        """The last fit, all named effects in it."""
        return self.steps[-1].calibration

    @property
    def named(self) -> tuple[str, ...]:
        """The effects that the search added, claimed, suspected or open; learned curves are none."""
        return tuple(effect.name for effect in self.steps[-1].selected if effect.name != LEARNED)

    @property
    def is_clean(self) -> bool:
        """Whether noise alone is left, outliers apart, and an effect in the model stands for all that is open."""
        only_stood_for = bool(self.open_sets) and not self.suspected and not self.tied
        return self.verdict in ("adequate", "named", "outliers") or (self.verdict == "ambiguous" and only_stood_for)

    @property
    def tied(self) -> tuple[str, ...]:
        """Effects that cannot be told apart and of which none is in the model."""
        opened = {name for found in self.open_sets for name in found.names}
        return tuple(name for name in self.ambiguous_set if name not in opened)

    @property
    def added(self) -> tuple[Added, ...]:
        """Each effect that the search added, by which evidence, and what was left before it."""
        return tuple(
            Added(after.effect, after.candidate.log_evidence, before.screening.projected)
            for before, after in pairwise(self.steps)
            if after.effect and after.candidate is not None and before.screening is not None
        )

    @property
    def discriminating_poses(self) -> tuple[DiscriminatingPose, ...]:
        """The poses of `split`, those at which the rivals differ most first."""
        return () if self.split is None else poses_of(self.split, self.calibration)

    @property
    def screenings(self) -> tuple[Screening, ...]:
        """One a step: of every effect that is not in its model."""
        return tuple(step.screening for step in self.steps if step.screening is not None)

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The ranking that the first decision was taken by."""
        return self.screenings[0].candidates

    @property
    def untestable(self) -> tuple[Untestable, ...]:
        """Families that these data cannot test."""
        return self.screenings[0].untestable
