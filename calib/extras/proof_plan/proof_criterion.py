"""Criterion: pairs of poses that prove a cause by changing one condition (`--for prove`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import IndexArray
from calib.dataset.dataset import Poses
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.extras.proof_plan.plugin import PROVE
from calib.extras.proof_plan.proof_plan import NextChange, next_change
from calib.extras.proof_plan.simulated_pairs import joined_poses, under
from calib.intervention.pairs import APPROACH
from calib.planning.criterion import BaseCriterion, DesignProblem, PlanTask
from calib.planning.effect_hypotheses import hypothesis_sets
from calib.planning.outcome import PoseReason
from calib.planning.start import FromFit, Start


@dataclass(frozen=True)
class PairReason(PoseReason):
    """Reason for a pose: it is measured under a changed condition, at the joints of another one."""

    again: str | None  # the pose measured before that it repeats; None where both are new
    condition: str  # column of poses.csv
    level: float | None  # its value; None for sides of approach


@dataclass(frozen=True)
class ForProof(BaseCriterion):
    """Criterion: prove which hypothesis is true by pairs of poses, which are chosen already."""

    chosen: NextChange
    start: FromFit
    name = PROVE
    keeps_temperature = True
    effects: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of poses to measure."""
        return len(self.chosen.poses)

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """The chosen poses first, then candidates as offered, under the condition before the change."""
        change, poses, n = self.chosen.change, self.chosen.poses, len(offered)
        for name in ("payload_kg", "temperature_c", "approach"):
            values = getattr(poses, name)
            usual = None if values is None else np.repeat(values[:1], n, axis=0)
            if name == change.condition != APPROACH and change.before is not None:
                usual = np.full(n, change.before)
            offered = under(offered, name, usual)
        return joined_poses(self.chosen.poses, offered)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices of the chosen poses, which are the first of the candidates."""
        return np.arange(min(count, self.count))

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[PairReason, ...]:
        """For each pose, the measured pose that it repeats, and its condition."""
        again, condition = self.chosen.again, self.chosen.change.condition
        levels = None if condition == APPROACH else getattr(self.chosen.poses, condition)
        return tuple(
            PairReason(again[k] if again else None, condition, None if levels is None else float(levels[k]))
            for k in chosen.tolist()
        )

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> NextChange:
        """The change, and the probability that it proves which hypothesis is true."""
        return self.chosen


def task_of_diagnosis(diagnosis: Diagnosis, payload_kg: float | None, count: int | None) -> PlanTask:
    """Poses that prove one of the effects that a diagnosis left confounded; as many as it takes where none is given.

    Raises CalibError where nothing was left confounded, or no change moves any of it.
    """
    name, found = diagnosis.calibration.dataset.name, next_change(diagnosis, payload_kg=payload_kg, count=count)
    if found is not None:
        proof = ForProof(found, FromFit(found.calibration))
        return PlanTask(proof.start, proof.count, proof)
    sets = hypothesis_sets(diagnosis)
    if not sets:
        raise CalibError(
            f"dataset {name}: its diagnosis left no effects confounded (verdict {diagnosis.verdict}), so there is "
            "nothing to prove; plan for calibration, or for an effect"
        )
    raise CalibError(
        f"dataset {name}: neither a payload, nor the side of approach, nor the temperature moves any of "
        f"{', '.join(sets[0].names)}, so pairs of poses prove none; --for split plans other poses"
    )
