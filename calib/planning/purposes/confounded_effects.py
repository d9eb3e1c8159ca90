"""Poses that discriminate between the effects which a diagnosis left confounded (`--for split`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.planning.discrimination import ENOUGH_POWER, Discrimination, choose, evaluated
from calib.planning.effect_hypotheses import HypothesisPredictions, HypothesisSet, hypothesis_sets, predict
from calib.planning.offered_poses import under_conditions
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
        needs = [hypothesis.members[0] for hypothesis in self.hypothesis_set.hypotheses]
        wanted = conditions_for([str(getattr(member, "needs", "")) for member in needs])
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

    def why(self, situation: Situation, chosen: IndexArray) -> tuple[str, ...]:
        apart_mm = self._evaluated(situation, chosen).separation_mm
        return tuple(f"the rivals differ by {mm:.2g} mm here, refitted" for mm in apart_mm)

    def told(self, situation: Situation, chosen: IndexArray) -> tuple[str, ...]:
        found = self._evaluated(situation, chosen, look_on=True)
        curve = ", ".join(f"{k}: {100 * p:.0f} %" for k, p in enumerate(found.power_by_count) if k)
        names = " from ".join(found.hypotheses)
        return (
            f"to tell {names}; probability that they are, by the number of poses: {curve}",
            *self._what_would_help(found),
        )

    def _what_would_help(self, found: Discrimination) -> list[str]:
        """What would discriminate where these poses may not."""
        out = [
            f"{one} and {other} make the same of every pose of this kind: none tells them apart"
            for one, other in found.equivalent
        ]
        weak = found.power < ENOUGH_POWER
        if weak and found.enough is not None:
            out.append(f"{found.enough} poses of this kind would do in {100 * ENOUGH_POWER:.0f} % of such cases")
        if weak and self._helped_by_payload and not self.payload_kg:
            out.append(f"a known payload at some of the poses tells more (--payload-kg {PAYLOAD_KG:g} or above)")
        if found.equivalent or (weak and found.enough is None):
            confirm = {h.name: getattr(h.members[0], "confirm", "") for h in self.hypothesis_set.hypotheses}
            out += [f"what shows {name} alone: {text}" for name, text in confirm.items() if text]
        if self.hypothesis_set.untested:
            names, would_help = ", ".join(self.hypothesis_set.untested), self.hypothesis_set.would_help
            more = f"; {would_help}" if would_help else ""
            out.append(f"no pose tells of {names}, which these data cannot test{more}")
        return out

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
