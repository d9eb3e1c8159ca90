"""Criterion: power to discriminate between effects that a diagnosis left confounded (`--for split`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import describe
from calib.errors import CalibError
from calib.planning.criterion import BaseCriterion, DesignProblem, PlanTask
from calib.planning.discrimination import ENOUGH_POWER, Discrimination, choose, evaluated
from calib.planning.effect_hypotheses import HypothesisPredictions, HypothesisSet, hypothesis_sets, predict
from calib.planning.offered_poses import under_conditions
from calib.planning.outcome import DiscriminationOutcome, SeparationReason
from calib.planning.purpose import FURTHER, SPLIT
from calib.planning.start import FromFit, Start
from calib.workcell.pose_conditions import PAYLOAD_KG, conditions_for


@dataclass(frozen=True, eq=False)
class ForDiscrimination(BaseCriterion):
    """Criterion: discriminate between the hypotheses of one confounded set."""

    hypothesis_set: HypothesisSet
    payload_kg: float | None = None  # payload that the arm may carry at some poses, where the measured one is constant
    name = SPLIT
    effects: tuple[str, ...] = ()
    _predicted: list[tuple[Poses, HypothesisPredictions]] = field(default_factory=list, init=False, repr=False)

    @property
    def start(self) -> FromFit:
        """Start of the plan: the fit that left the hypotheses open."""
        return FromFit(self.hypothesis_set.calibration)

    @property
    def _helped_by_payload(self) -> bool:
        """Whether a varying payload would separate the hypotheses, and the data have no varying payload."""
        members = [hypothesis.members[0] for hypothesis in self.hypothesis_set.hypotheses]
        wanted = conditions_for(describe(member) for member in members)
        payload_kg = self.hypothesis_set.calibration.dataset.poses.payload_kg
        varies = payload_kg is not None and bool(payload_kg.min() < payload_kg.max())
        return bool(wanted.payloads_kg) and not varies

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses with conditions that vary like the measured ones, and with the payload where it helps."""
        payloads = (0.0, self.payload_kg) if self.payload_kg and self._helped_by_payload else ()
        return offered if start.measured is None else under_conditions(offered, start.measured, payloads)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the candidates that discriminate best, in the order chosen."""
        return choose(self._predictions(problem.candidates), problem.candidates, count)

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[SeparationReason, ...]:
        """For each chosen candidate, the distance between the hypotheses' predictions."""
        return tuple(SeparationReason(float(mm)) for mm in self._evaluated(problem, chosen).separation_mm)

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> DiscriminationOutcome:
        """Power by the number of poses, and advice where the power is low."""
        achieved = self._evaluated(problem, chosen, find_enough=True)
        weak = achieved.power < ENOUGH_POWER
        hopeless = bool(achieved.equivalent) or (weak and achieved.enough is None)
        hypotheses = self.hypothesis_set.hypotheses
        confirm = [(h.name, str(getattr(h.members[0], "confirm", ""))) for h in hypotheses if h.members]
        return DiscriminationOutcome(
            hypotheses=achieved.hypotheses,
            power_by_count=achieved.power_by_count,
            equivalent=achieved.equivalent,
            enough=achieved.enough if weak else None,
            enough_power=ENOUGH_POWER,
            payload_kg=PAYLOAD_KG if weak and self._helped_by_payload and not self.payload_kg else None,
            confirm=tuple((name, text) for name, text in confirm if text) if hopeless else (),
            untested=self.hypothesis_set.untested,
            would_help=self.hypothesis_set.would_help,
        )

    def _predictions(self, candidates: Poses) -> HypothesisPredictions:
        """Predictions of all hypotheses at the candidates, cached for one set of candidates."""
        if not self._predicted or self._predicted[0][0] is not candidates:
            hypotheses = [hypothesis for hypothesis in self.hypothesis_set.hypotheses if hypothesis.members]
            self._predicted[:] = [(candidates, predict(self.hypothesis_set.calibration, hypotheses, candidates))]
        return self._predicted[0][1]

    def _evaluated(self, problem: DesignProblem, chosen: IndexArray, *, find_enough: bool = False) -> Discrimination:
        """Power and separation of the chosen candidates."""
        candidates = problem.candidates
        return evaluated(self._predictions(candidates), candidates, chosen, find_enough=find_enough)


def for_confounded(diagnosis: Diagnosis, payload_kg: float | None = None) -> ForDiscrimination:
    """Criterion for the first set of effects, left confounded by a diagnosis, that poses can discriminate.

    Raises CalibError where no effects were left confounded, or the data lack the means to test them.
    """
    sets = hypothesis_sets(diagnosis)
    name = diagnosis.calibration.dataset.name
    if not sets:
        raise CalibError(
            f"dataset {name}: its diagnosis left no effects confounded (verdict {diagnosis.verdict}), so there is "
            "nothing to discriminate; plan for calibration, or for an effect"
        )
    for hypothesis_set in sets:
        if sum(bool(hypothesis.members) for hypothesis in hypothesis_set.hypotheses) > 1:
            return ForDiscrimination(hypothesis_set, payload_kg)
    would_help = next((each.would_help for each in sets if each.would_help), "")
    raise CalibError(
        f"dataset {name}: no pose discriminates between {', '.join(sets[0].names)}, which these data cannot test"
        + (f"; {would_help}" if would_help else "")
    )


def task_of_confounded(diagnosis: Diagnosis, payload_kg: float | None, count: int | None) -> PlanTask:
    """Poses that discriminate between effects left confounded by a diagnosis. Raises as `for_confounded`."""
    criterion = for_confounded(diagnosis, payload_kg)
    return PlanTask(criterion.start, FURTHER if count is None else count, criterion)
