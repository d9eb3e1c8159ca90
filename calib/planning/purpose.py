"""What poses are wanted for: which candidates tell most of it, and how much that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.effects.effect import Description, describe
from calib.planning.exchange import best_poses
from calib.planning.offered_poses import under_conditions
from calib.planning.outcome import Outcome, PoseReason
from calib.planning.prediction import Region
from calib.planning.question import VARIANCE, VOLUME, Question, condensed
from calib.planning.start import Start
from calib.planning.unknowns import Unknowns
from calib.workcell.pose_conditions import conditions_for

CALIBRATION = "calibration"
WATCH = "watch"  # check poses: `calib.planning.purposes.watching`


@dataclass(frozen=True)
class Situation:
    """What a purpose may ask about."""

    start: Start
    unknowns: Unknowns
    candidates: Poses  # (N,)
    rows: Array  # (N, r, K) of `Unknowns.rows` at the candidates
    region: Region

    @cached_property
    def right_at_region(self) -> Question:
        """The model's mean square error over the region."""
        return Question(self.rows, self.unknowns.known, condensed(self.region.wanted), VARIANCE)

    def information(self, chosen: IndexArray) -> Array:
        """(K, K) what is known once these candidates are measured."""
        rows = self.rows[chosen].reshape(-1, self.rows.shape[-1])
        return np.asarray(self.unknowns.known + rows.T @ rows)


class Purpose(Protocol):
    """What a plan is for."""

    @property
    def name(self) -> str:
        """The purpose's name, as --for takes it."""
        ...

    @property
    def effects(self) -> tuple[str, ...]:
        """Families that the unknowns are to have beside those of the fit."""
        ...

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """The candidates under the conditions that they are to be measured under."""
        ...

    def choose(self, situation: Situation, count: int) -> IndexArray:
        """(count,) the candidates that tell most of what is asked, the most telling first."""
        ...

    def power(self, situation: Situation, chosen: IndexArray) -> float | None:
        """Probability that these candidates tell confounded effects apart; None where none are to be told apart."""
        ...

    def reasons(self, situation: Situation, chosen: IndexArray) -> tuple[PoseReason, ...]:
        """Why each candidate was chosen; () where that is the parameters it tells most of."""
        ...

    def outcome(self, situation: Situation, chosen: IndexArray) -> Outcome | None:
        """What the chosen candidates achieve for the purpose; None where the predicted error says it all."""
        ...


class PlainPurpose:
    """What most purposes have in common: poses as they were offered, with no confounded effects to tell apart."""

    def prepared(self, start: Start, offered: Poses) -> Poses:
        return offered

    def power(self, situation: Situation, chosen: IndexArray) -> float | None:
        return None

    def reasons(self, situation: Situation, chosen: IndexArray) -> tuple[PoseReason, ...]:
        return ()

    def outcome(self, situation: Situation, chosen: IndexArray) -> Outcome | None:
        return None


@dataclass(frozen=True)
class ForCalibration(PlainPurpose):
    """The model right over a region (I-optimal), or its parameters known (D-optimal)."""

    criterion: str = "I"
    name = CALIBRATION
    effects: tuple[str, ...] = ()

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Under conditions that vary as the measured ones do, where the model has effects that these may show."""
        return with_varied_conditions(start, offered)

    def choose(self, situation: Situation, count: int) -> IndexArray:
        unknowns = situation.unknowns
        if self.criterion == "D":
            known = Question(situation.rows, unknowns.known, unknowns.of_parameters(), VOLUME)
            return best_poses([known], count).rows
        return best_poses([situation.right_at_region], count).rows


def with_varied_conditions(start: Start, offered: Poses, effects: Sequence[Description] = ()) -> Poses:
    """The candidates under conditions that vary as the measured ones do, where the fit's or these effects need it.

    The others stay as they are: a pose need not be measured warm for a model that temperature does not touch.
    """
    if start.measured is None:
        return offered
    of_fit = [describe(effect) for effect in start.unknowns().model.added_effects]
    wanted, varied = conditions_for([*of_fit, *effects]), under_conditions(offered, start.measured)
    return replace(
        offered,
        payload_kg=varied.payload_kg if wanted.payloads_kg else offered.payload_kg,
        temperature_c=varied.temperature_c if wanted.temperatures_c else offered.temperature_c,
        approach=varied.approach if wanted.both_sides else offered.approach,
    )
