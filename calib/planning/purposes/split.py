"""Poses that settle a set of causes which a diagnosis left open (`--for split`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.findings import Findings
from calib.diagnosis.open_sets import Doubt, doubts_of
from calib.errors import CalibError
from calib.planning.purpose import Situation
from calib.planning.start import FromFit, Start
from calib.screening.rivals.further_poses import under_conditions
from calib.screening.rivals.predictions import Predictions, predict
from calib.screening.rivals.split import ENOUGH, MOST_SHOTS, Split, choose, judged
from calib.workcell.pose_conditions import PAYLOAD_KG, conditions_for

SPLIT = "split"


@dataclass(frozen=True, eq=False)
class ForSplit:
    """One cause of an open set told from the others; the fit that is planned for is that beside the set."""

    doubt: Doubt
    payload_kg: float | None = None  # that the arm may carry at some poses, where the data have none
    most_shots: int = MOST_SHOTS  # measurements of a pose
    name = SPLIT
    effects: tuple[str, ...] = ()
    _kept: list[tuple[Poses, Predictions]] = field(default_factory=list, init=False, repr=False)

    @property
    def start(self) -> FromFit:
        """Where its plan begins."""
        return FromFit(self.doubt.calibration)

    @property
    def _helped_by_payload(self) -> bool:
        """Whether a payload makes the rivals differ more, and the data have none that varies."""
        needs = [rival.members[0] for rival in self.doubt.rivals]
        wanted = conditions_for([str(getattr(member, "needs", "")) for member in needs])
        payload_kg = self.doubt.calibration.dataset.poses.payload_kg
        varies = payload_kg is not None and bool(payload_kg.min() < payload_kg.max())
        return bool(wanted.payloads_kg) and not varies

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """The poses under conditions that vary as the measured ones do, and with a payload where one is at hand."""
        payloads = (0.0, self.payload_kg) if self.payload_kg and self._helped_by_payload else ()
        return offered if start.measured is None else under_conditions(offered, start.measured, payloads)

    def choose(self, situation: Situation, count: int) -> IndexArray:
        candidates = situation.candidates
        return choose(self._predictions(candidates), candidates, count, most_shots=self.most_shots)

    def settles(self, situation: Situation, chosen: IndexArray) -> float | None:
        return self._judged(situation, chosen).settles

    def shots(self, situation: Situation, chosen: IndexArray) -> int:
        return self._judged(situation, chosen).shots

    def why(self, situation: Situation, chosen: IndexArray) -> tuple[str, ...]:
        apart_mm = self._judged(situation, chosen).separation_mm
        return tuple(f"the rivals differ by {mm:.2g} mm here, refitted" for mm in apart_mm)

    def told(self, situation: Situation, chosen: IndexArray) -> tuple[str, ...]:
        found = self._judged(situation, chosen, look_on=True)
        curve = ", ".join(f"{k}: {100 * p:.0f} %" for k, p in enumerate(found.curve) if k)
        said = [f"to tell {' from '.join(found.rivals)}; probability that they are, by the number of poses: {curve}"]
        if found.shots > 1:
            said.append(f"measure each pose {found.shots} times; the mean counts")
        said += self._what_would(situation, found)
        return tuple(said)

    def _what_would(self, situation: Situation, found: Split) -> list[str]:
        """What would settle the set where these poses may not."""
        said = [
            f"{one} and {other} make the same of every pose of this kind: none tells them apart"
            for one, other in found.twins
        ]
        if found.settles < ENOUGH and found.enough is not None:
            said.append(f"{found.enough} poses of this kind would do in {100 * ENOUGH:.0f} % of such cases")
        if found.settles < ENOUGH and self._helped_by_payload and not self.payload_kg:
            said.append(f"a known payload at some of the poses tells more (--payload-kg {PAYLOAD_KG:g} or above)")
        if found.twins or (found.settles < ENOUGH and found.enough is None):
            confirm = {rival.name: getattr(rival.members[0], "confirm", "") for rival in self.doubt.rivals}
            said += [f"what shows {name} alone: {text}" for name, text in confirm.items() if text]
        if self.doubt.untested:
            names = ", ".join(self.doubt.untested)
            would = f"; {self.doubt.would_help}" if self.doubt.would_help else ""
            said.append(f"no pose tells of {names}, which these data cannot test{would}")
        return said

    def _predictions(self, candidates: Poses) -> Predictions:
        if not self._kept or self._kept[0][0] is not candidates:
            rivals = [rival for rival in self.doubt.rivals if rival.members]
            self._kept[:] = [(candidates, predict(self.doubt.calibration, rivals, candidates))]
        return self._kept[0][1]

    def _judged(self, situation: Situation, chosen: IndexArray, *, look_on: bool = False) -> Split:
        candidates = situation.candidates
        return judged(self._predictions(candidates), candidates, chosen, most_shots=self.most_shots, look_on=look_on)


def open_set_of(found: Findings, payload_kg: float | None = None) -> ForSplit:
    """What is to be settled after a diagnosis: the first of its open sets that poses may tell anything of.

    Raises CalibError where it left none open, or poses can settle none.
    """
    doubts = doubts_of(found)
    name = found.calibration.dataset.name
    if not doubts:
        raise CalibError(
            f"dataset {name}: its diagnosis left no set of causes open (verdict {found.verdict}), so there is nothing "
            "to settle; plan for calibration, or for an effect"
        )
    for doubt in doubts:
        if sum(bool(rival.members) for rival in doubt.rivals) > 1:
            return ForSplit(doubt, payload_kg)
    would = next((doubt.would_help for doubt in doubts if doubt.would_help), "")
    raise CalibError(
        f"dataset {name}: no pose settles {', '.join(doubts[0].names)}, which these data lack the means to tell apart"
        + (f"; {would}" if would else "")
    )
