"""Criterion: least variance of the coefficients of suspected effects (`--for EFFECT,...`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.effects.catalogue import descriptions
from calib.effects.effect import Description
from calib.errors import CalibError
from calib.planning.criterion import BaseCriterion, DesignProblem, with_varied_conditions
from calib.planning.exchange import best_poses
from calib.planning.outcome import CoefficientSigma, EffectOutcome
from calib.planning.question import OptimalityCriterion, inverse
from calib.planning.start import Start
from calib.planning.unknowns import Unknowns
from calib.workcell.pose_conditions import PAYLOAD_KG, WantedConditions, conditions_for


@dataclass(frozen=True)
class ForEffects(BaseCriterion):
    """Criterion: least sum of variances of suspected effects' coefficients, each in units of its usual size."""

    effects: tuple[str, ...]
    payload_kg: float | None = None  # payload that the arm may carry at some poses

    @property
    def name(self) -> str:
        """Names of the suspected effects, separated by commas."""
        return ",".join(self.effects)

    @property
    def _described(self) -> list[Description]:
        """Descriptions of the suspected effects that are in the catalogue."""
        return [described for described in descriptions() if described.name in self.effects]

    @property
    def _wanted(self) -> WantedConditions:
        """Conditions (such as payload) under which the suspected effects show; none for a user's own effects."""
        wanted = conditions_for(self._described, payload_kg=self.payload_kg or PAYLOAD_KG)
        without = "payload_kg" in wanted.helpful and self.payload_kg is None
        return replace(wanted, payloads_kg=()) if without else wanted

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses with conditions that vary like the measured ones, and as the suspected effects need."""
        poses = with_varied_conditions(start, offered, self._described)
        wanted, rng = self._wanted, np.random.default_rng(0)
        if wanted.both_sides and poses.approach is None:
            poses = replace(poses, approach=rng.choice([-1.0, 1.0], poses.q.shape))
        if wanted.payloads_kg and not _varies(poses.payload_kg):
            poses = replace(poses, payload_kg=rng.choice(wanted.payloads_kg, len(poses)))
        if wanted.temperatures_c and not _varies(poses.temperature_c):
            poses = replace(poses, temperature_c=rng.choice(wanted.temperatures_c, len(poses)))
        return poses

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the A-optimal candidates. Raises CalibError where no candidate shows the effects."""
        targets = problem.unknowns.of_parameters()[:, self._coefficients(problem.unknowns)]
        if not np.any(problem.rows @ targets):
            raise CalibError(f"{self.name} shows at no pose that can be measured, so none can be planned for it")
        return best_poses([OptimalityCriterion(problem.rows, problem.unknowns.prior_information, targets)], count).rows

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> EffectOutcome:
        """Sigmas of the effects' coefficients before and after the planned poses, and the poses' conditions."""
        unknowns, measured, wanted = problem.unknowns, problem.start.measured, self._wanted
        none = np.zeros(0, dtype=np.int64)
        before, after = (
            np.sqrt(np.diag(inverse(problem.information(rows))))[: len(unknowns.scales)] * unknowns.scales
            for rows in (none, chosen)
        )
        parameters = unknowns.model.parameters
        varied = {
            "approach": wanted.both_sides,
            "payload_kg": wanted.payloads_kg,
            "temperature_c": wanted.temperatures_c,
        }
        conditions = tuple(name for name, values in varied.items() if values)
        return EffectOutcome(
            tuple(
                CoefficientSigma(parameters[k].name, parameters[k].unit, float(before[k]), float(after[k]))
                for k in self._coefficients(unknowns)
            ),
            conditions,
            tuple(name for name in conditions if measured is not None and getattr(measured, name) is None),
        )

    def _coefficients(self, unknowns: Unknowns) -> list[int]:
        """Indices of the unknowns that are coefficients of the suspected effects."""
        families = tuple(f"{name}." for name in self.effects)
        return [k for k, name in enumerate(unknowns.parameter_names) if name.startswith(families)]


def _varies(values: Array | None) -> bool:
    """Whether a condition of poses (such as payload) is recorded and varies."""
    return values is not None and bool(np.ptp(values) > 0.0)
