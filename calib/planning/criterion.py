"""Design criteria: what a plan's poses are optimised for, and the design problem that a criterion solves."""

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
from calib.planning.outcome import Outcome, ParameterReason, PoseReason
from calib.planning.prediction import Region
from calib.planning.purpose import CALIBRATION
from calib.planning.question import VARIANCE, VOLUME, OptimalityCriterion, condensed, inverse
from calib.planning.start import Start
from calib.planning.unknowns import Unknowns
from calib.workcell.pose_conditions import conditions_for

_NAMED = 3  # most parameters in a pose's reason
_MIN_GAIN = 0.01  # share by which a pose lowers a parameter's sigma, below which the parameter is no reason for it
_FAR_RAD, _FAR_MM = np.radians(25.0), 100.0  # distance from every measured pose in one joint, from which that is far


@dataclass(frozen=True)
class DesignProblem:
    """Candidate poses with their derivatives, the unknowns, and the region in which the model is to be accurate."""

    start: Start
    unknowns: Unknowns
    candidates: Poses  # (N,)
    rows: Array  # (N, r, K) `Unknowns.rows` at the candidates
    region: Region

    @cached_property
    def region_question(self) -> OptimalityCriterion:
        """Optimality question whose measure is the model's mean square error over the region, mm^2."""
        targets = condensed(self.region.target_combinations)
        return OptimalityCriterion(self.rows, self.unknowns.prior_information, targets, VARIANCE)

    def information(self, chosen: IndexArray) -> Array:
        """Information matrix (K, K) of the unknowns after the chosen candidates are measured."""
        rows = self.rows[chosen].reshape(-1, self.rows.shape[-1])
        return self.unknowns.prior_information + rows.T @ rows


class DesignCriterion(Protocol):
    """Criterion by which the poses of a plan are chosen."""

    @property
    def name(self) -> str:
        """Name of the criterion, as the option --for takes it."""
        ...

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of effects whose coefficients become unknowns in addition to those of the fit."""
        ...

    @property
    def is_own_dataset(self) -> bool:
        """Whether the poses are a dataset of their own, whose first is its reference, not more of a measured one."""
        ...

    @property
    def keeps_temperature(self) -> bool:
        """Whether the poses keep a temperature that all share, as where it is what was changed."""
        ...

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses with the conditions (payload, temperature) under which they are to be measured."""
        ...

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the best candidates, the most informative first."""
        ...

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[PoseReason, ...]:
        """Reason for which each candidate was chosen."""
        ...

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> Outcome | None:
        """What the chosen candidates achieve by this criterion; None if that is only the predicted error."""
        ...


@dataclass(frozen=True)
class PlanTask:
    """What `calib.planning.plan.plan_poses` is to do for a purpose: how many poses from where, by which criterion."""

    start: Start
    count: int
    criterion: DesignCriterion


class BaseCriterion:
    """Base of criteria that take the candidates as offered and explain a pose by the parameters it determines."""

    is_own_dataset: bool = False
    keeps_temperature: bool = False

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses unchanged."""
        return offered

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[PoseReason, ...]:
        """Per chosen candidate: the parameters whose sigma it lowers most, and a joint far from all measured poses."""
        whole = problem.information(chosen)
        p = len(problem.unknowns.scales)
        with_all = np.diag(inverse(whole))[:p]
        names = [name.rpartition(".")[0] or name for name in problem.unknowns.parameter_names]  # without the symbol
        reasons = []
        for candidate in chosen:
            rows = problem.rows[candidate]
            without = np.diag(inverse(whole - rows.T @ rows))[:p]
            gains = 1.0 - np.sqrt(with_all / without)
            best = [k for k in np.argsort(-gains)[:_NAMED] if gains[k] > _MIN_GAIN]
            parameters = tuple(dict.fromkeys(names[k] for k in best))
            reasons.append(ParameterReason(parameters, _far_joint(problem, problem.candidates.q[candidate])))
        return tuple(reasons)

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> Outcome | None:
        """None, as these criteria achieve nothing beyond the predicted error."""
        return None


def _far_joint(problem: DesignProblem, q: Array) -> int | None:
    """Number from 1 of the joint that is farthest from all measured training poses, where that is far; else None."""
    measured = problem.start.measured
    if measured is None:
        return None
    trained = measured.q[~measured.is_test]
    revolute = problem.start.dataset.robot.is_revolute
    apart = np.abs(trained - q)
    apart = np.where(revolute, np.minimum(apart % (2 * np.pi), -apart % (2 * np.pi)), apart)
    far = apart.min(axis=0) / np.where(revolute, _FAR_RAD, _FAR_MM)
    joint = int(np.argmax(far))
    return joint + 1 if far[joint] > 1.0 else None


@dataclass(frozen=True)
class ForCalibration(BaseCriterion):
    """Criterion of a calibration: least error over a region (I-optimal), or best known parameters (D-optimal)."""

    optimality: str = "I"
    name = CALIBRATION
    effects: tuple[str, ...] = ()

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses, with conditions that vary like the measured ones if the model's effects depend on them."""
        return with_varied_conditions(start, offered)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the I-optimal or D-optimal candidates, the most informative first."""
        unknowns = problem.unknowns
        if self.optimality == "D":
            parameters = OptimalityCriterion(problem.rows, unknowns.prior_information, unknowns.of_parameters(), VOLUME)
            return best_poses([parameters], count).rows
        return best_poses([problem.region_question], count).rows


def with_varied_conditions(start: Start, offered: Poses, effects: Sequence[Description] = ()) -> Poses:
    """Candidate poses, with conditions that vary like the measured ones if the fit or given effects need that.

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
