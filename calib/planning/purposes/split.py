"""Poses that settle a set of causes which a diagnosis left open (`--for split`)."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.findings import Findings
from calib.diagnosis.open_sets import Doubt, doubts_of
from calib.errors import CalibError
from calib.planning.outcome import DiscriminationOutcome, SeparationReason
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

    def reasons(self, situation: Situation, chosen: IndexArray) -> tuple[SeparationReason, ...]:
        return tuple(SeparationReason(float(mm)) for mm in self._judged(situation, chosen).separation_mm)

    def outcome(self, situation: Situation, chosen: IndexArray) -> DiscriminationOutcome:
        found = self._judged(situation, chosen, look_on=True)
        weak = found.settles < ENOUGH
        hopeless = bool(found.twins) or (weak and found.enough is None)
        confirm = [(rival.name, str(getattr(rival.members[0], "confirm", ""))) for rival in self.doubt.rivals]
        return DiscriminationOutcome(
            hypotheses=found.rivals,
            power_by_count=found.curve,
            equivalent=found.twins,
            enough=found.enough if weak else None,
            enough_power=ENOUGH,
            payload_kg=PAYLOAD_KG if weak and self._helped_by_payload and not self.payload_kg else None,
            confirm=tuple((name, text) for name, text in confirm if text) if hopeless else (),
            untested=self.doubt.untested,
            would_help=self.doubt.would_help,
        )

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
