"""Design criteria: what a plan's poses are optimised for, the problem that each solves, and what the poses achieve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.effects.catalogue import descriptions
from calib.effects.effect import Description, describe
from calib.errors import CalibError
from calib.planning.exchange import OptimalityCriterion, best_poses, condensed, inverse
from calib.planning.prediction import Region
from calib.planning.purpose import CALIBRATION
from calib.planning.start import Start, under_conditions
from calib.planning.unknowns import Unknowns
from calib.workcell.pose_conditions import PAYLOAD_KG, WantedConditions, conditions_for


class PoseReason:
    """Base of reasons for which a pose is planned; `calib.present.plans.plans.reason_told` tells each kind."""


class Outcome:
    """Base of what poses achieve beyond the predicted error; `calib.present.plans.plans.told` tells each kind."""

    @property
    def power(self) -> float | None:
        """Probability that it is told which of some hypotheses is true; None where there are none."""
        return None


@dataclass(frozen=True)
class ParameterReason(PoseReason):
    """Reason for a pose: parameters that it determines better, and a joint taken far from its measured positions."""

    parameters: tuple[str, ...]  # without their symbols, the largest gain first
    far_joint: int | None  # from 1; None where each joint was measured near


@dataclass(frozen=True)
class SeparationReason(PoseReason):
    """Reason for a pose: the distance there between the predictions of the two least separated hypotheses."""

    separation_mm: float


@dataclass(frozen=True)
class CoefficientSigma:
    """Sigma of one coefficient of an effect before and after the planned poses."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True)
class EffectOutcome(Outcome):
    """Sigmas of the coefficients of suspected effects, and the conditions that the poses are measured under."""

    coefficients: tuple[CoefficientSigma, ...]  # in the model's order
    conditions: tuple[str, ...]  # fields of `Poses` that have to vary: "approach", "payload_kg", "temperature_c"
    unrecorded: tuple[str, ...]  # those of `conditions` that the measured poses have no values of


@dataclass(frozen=True)
class DiscriminationOutcome(Outcome):
    """Power with which the planned poses discriminate between hypotheses, and advice where it is low."""

    hypotheses: tuple[str, ...]
    power_by_count: tuple[float, ...]  # power of none, the first, the first two, ... of the poses
    equivalent: tuple[tuple[str, str], ...]  # pairs that no offered pose discriminates
    enough: int | None  # number of poses that reach `enough_power`, where these do not
    enough_power: float
    payload_kg: float | None  # a payload that would add power, where none was asked for
    confirm: tuple[tuple[str, str], ...]  # hypothesis and the experiment that shows it, where poses cannot
    untested: tuple[str, ...]  # hypotheses that the data cannot test
    would_help: str  # what would make these testable

    @property
    def power(self) -> float:
        """Probability that the planned poses discriminate the true hypothesis from all others."""
        return self.power_by_count[-1]


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
        return OptimalityCriterion(self.rows, self.unknowns.prior_information, targets)

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
    """Criterion of a calibration: least error over a region (I-optimal)."""

    name = CALIBRATION
    effects: tuple[str, ...] = ()

    def prepared(self, start: Start, offered: Poses) -> Poses:
        """Candidate poses, with conditions that vary like the measured ones if the model's effects depend on them."""
        return with_varied_conditions(start, offered)

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the I-optimal candidates, the most informative first."""
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
