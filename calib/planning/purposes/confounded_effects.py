"""Poses that discriminate between the effects which a diagnosis left confounded (`--for split`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import describe
from calib.errors import CalibError
from calib.planning.discrimination import ENOUGH_POWER, Discrimination, choose, evaluated
from calib.planning.effect_hypotheses import HypothesisPredictions, HypothesisSet, hypothesis_sets, predict
from calib.planning.offered_poses import under_conditions
from calib.planning.outcome import DiscriminationOutcome, SeparationReason
from calib.planning.purpose import Situation
from calib.planning.start import FromFit, Start
from calib.workcell.pose_conditions import PAYLOAD_KG, conditions_for

SPLIT = "split"


@dataclass(frozen=True, eq=False)
class ForDiscrimination:
    """The true hypothesis of a set told from the others; the plan goes on from the fit that left the set open."""

    hypothesis_set: HypothesisSet
    payload_kg: float | None = None  # that the arm may carry at some poses, where the data have none
    name = SPLIT
    effects: tuple[str, ...] = ()
    _kept: list[tuple[Poses, HypothesisPredictions]] = field(default_factory=list, init=False, repr=False)

    @property
    def start(self) -> FromFit:
        """The fit that the plan goes on from."""
        return FromFit(self.hypothesis_set.calibration)

    @property
    def _helped_by_payload(self) -> bool:
        """Whether a payload makes the hypotheses differ more, and the data have none that varies."""
        hypotheses = self.hypothesis_set.hypotheses
        wanted = conditions_for(describe(hypothesis.members[0]) for hypothesis in hypotheses)
        payload_kg = self.hypothesis_set.calibration.dataset.poses.payload_kg
        varies = payload_kg is not None and bool(payload_kg.min() < payload_kg.max())
        return bool(wanted.payloads_kg) and not varies

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """The poses under conditions that vary as the measured ones do, and with a payload where one is at hand."""
        payloads = (0.0, self.payload_kg) if self.payload_kg and self._helped_by_payload else ()
        return offered if start.measured is None else under_conditions(offered, start.measured, payloads)

    def choose(self, situation: Situation, count: int) -> IndexArray:
        return choose(self._predictions(situation.candidates), situation.candidates, count)

    def power(self, situation: Situation, chosen: IndexArray) -> float | None:
        return self._evaluated(situation, chosen).power

    def reasons(self, situation: Situation, chosen: IndexArray) -> tuple[SeparationReason, ...]:
        return tuple(SeparationReason(float(mm)) for mm in self._evaluated(situation, chosen).separation_mm)

    def outcome(self, situation: Situation, chosen: IndexArray) -> DiscriminationOutcome:
        found = self._evaluated(situation, chosen, look_on=True)
        weak = found.power < ENOUGH_POWER
        hopeless = bool(found.equivalent) or (weak and found.enough is None)
        hypotheses = self.hypothesis_set.hypotheses
        confirm = [(one.name, str(getattr(one.members[0], "confirm", ""))) for one in hypotheses if one.members]
        return DiscriminationOutcome(
            hypotheses=found.hypotheses,
            power_by_count=found.power_by_count,
            equivalent=found.equivalent,
            enough=found.enough if weak else None,
            enough_power=ENOUGH_POWER,
            payload_kg=PAYLOAD_KG if weak and self._helped_by_payload and not self.payload_kg else None,
            confirm=tuple((name, text) for name, text in confirm if text) if hopeless else (),
            untested=self.hypothesis_set.untested,
            would_help=self.hypothesis_set.would_help,
        )

    def _predictions(self, candidates: Poses) -> HypothesisPredictions:
        if not self._kept or self._kept[0][0] is not candidates:
            hypotheses = [hypothesis for hypothesis in self.hypothesis_set.hypotheses if hypothesis.members]
            self._kept[:] = [(candidates, predict(self.hypothesis_set.calibration, hypotheses, candidates))]
        return self._kept[0][1]

    def _evaluated(self, situation: Situation, chosen: IndexArray, *, look_on: bool = False) -> Discrimination:
        candidates = situation.candidates
        return evaluated(self._predictions(candidates), candidates, chosen, look_on=look_on)


def for_confounded(diagnosis: Diagnosis, payload_kg: float | None = None) -> ForDiscrimination:
    """The purpose of telling apart what a diagnosis left open: the first set that poses may tell anything of.

    Raises CalibError where it left none open, or poses can discriminate none.
    """
    sets = hypothesis_sets(diagnosis)
    name = diagnosis.calibration.dataset.name
    if not sets:
        raise CalibError(
            f"dataset {name}: its diagnosis left no set of causes open (verdict {diagnosis.verdict}), so there is "
            "nothing to settle; plan for calibration, or for an effect"
        )
    for one in sets:
        if sum(bool(hypothesis.members) for hypothesis in one.hypotheses) > 1:
            return ForDiscrimination(one, payload_kg)
    would_help = next((one.would_help for one in sets if one.would_help), "")
    raise CalibError(
        f"dataset {name}: no pose settles {', '.join(sets[0].names)}, which these data lack the means to tell apart"
        + (f"; {would_help}" if would_help else "")
    )
