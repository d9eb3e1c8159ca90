"""Pairs of poses that can be measured under a change of one condition, chosen, and judged in simulation.

The pairs are chosen by `pair_design`. What they settle is found by simulation: the pairs of an arm with a drawn cause
are measured with noise, and `calib.intervention.proof.decided` judges them as it will judge the real ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset, Points, Poses
from calib.effects.effect import Effect, full_name
from calib.extras.proof_plan.pair_design import PairDesign, exchanged_pairs, greedy_pairs
from calib.fitting.model import geometric_model
from calib.frames import frames_by_name
from calib.intervention.differences import Differences, differences_of
from calib.intervention.pairs import APPROACH, PAYLOAD, find_pairs
from calib.intervention.proof import FEWEST_PAIRS, candidates_of, decided
from calib.kinematics.robot import Robot

TEMPERATURE = "temperature_c"
ACTING = (APPROACH, PAYLOAD, TEMPERATURE)
"""Conditions that a change may be of."""
NEARLY = 0.9  # of what the most measurements reach, from which fewer are enough
_COUNTS = (8, 12, 20, 40)  # measurements that are tried, the fewest first


@dataclass(frozen=True)
class ConditionChange:
    """A condition that is changed between the poses of a pair, as a column of poses.csv; None for sides of approach."""

    condition: str
    before: float | None
    after: float | None


@dataclass(frozen=True)
class DrawnCause:
    """A cause that may be true: members of one effect with their coefficients."""

    effect: str
    coefficients: Mapping[Effect, Array]

    @property
    def carriers(self) -> set[tuple[str, int | None]]:
        """Effect and joint, counted from 1, of each member."""
        return {(self.effect, _joint(member)) for member in self.coefficients}


@dataclass(frozen=True)
class Offer:
    """Pairs that can be measured under one change: before and after it, one row each."""

    change: ConditionChange
    before: Poses
    after: Poses
    is_again: bool
    assumed: bool = False

    def take(self, rows: IndexArray) -> Offer:
        return replace(self, before=self.before.select(rows), after=self.after.select(rows))

    @property
    def both(self) -> Poses:
        """Poses before the change, then those after it."""
        return joined_poses(self.before, self.after)

    @property
    def to_measure(self) -> Poses:
        """Poses to measure, the most informative first."""
        if self.is_again:
            return self.after
        return self.both.select(np.arange(2 * len(self.before)).reshape(2, -1).T.ravel())


def new_pairs(offered: Poses, change: ConditionChange) -> Offer:
    """Pairs of new poses, before and after a change."""
    n, rng = len(offered), np.random.default_rng(1)
    before = replace(offered, order=np.zeros(0), came_from=np.zeros((0, 0)), selected_from=None, time_s=None)
    if change.condition == APPROACH:
        side = rng.choice([-1.0, 1.0], offered.q.shape)
        sides = (side, -side)
    else:
        assert change.before is not None
        assert change.after is not None
        sides = (np.full(n, change.before), np.full(n, change.after))
    one, other = (under(before, change.condition, values) for values in sides)
    return Offer(change, one, other, is_again=False)


def under(poses: Poses, condition: str, values: Array | None) -> Poses:
    """Poses with other values of one condition."""
    if condition == APPROACH:
        return replace(poses, approach=values)
    return replace(poses, payload_kg=values) if condition == PAYLOAD else replace(poses, temperature_c=values)


def joined_poses(one: Poses, other: Poses) -> Poses:
    """Poses of two lists with the same conditions, the second's ids told apart from the first's."""

    def both(name: str) -> Array | None:
        first, second = getattr(one, name), getattr(other, name)
        return None if first is None or second is None else np.concatenate([first, second])

    return Poses(
        ids=(*one.ids, *(f"{name}'" for name in other.ids)),
        role=np.full(len(one) + len(other), "train", dtype="<U9"),
        q=np.concatenate([one.q, other.q]),
        setup=np.concatenate([one.setup, other.setup]),
        scan_names=(*one.scan_names, *(f"{name}'.ply" for name in other.ids)),
        payload_kg=both("payload_kg"),
        temperature_c=both("temperature_c"),
        approach=both("approach"),
    )


def chosen_from(
    cell: PairCell, offer: Offer, drawn: Sequence[DrawnCause], count: int | None
) -> tuple[float, Offer] | None:
    """The best pairs of an offer by number of measurements, with nearly their probability."""
    made = cell.measured(offer.both)
    found = None if made is None else design_of(made, drawn)
    if found is None:
        return None
    design, shown = found
    cost = 1 if offer.is_again else 2
    counts = [max(n // cost, FEWEST_PAIRS) for n in ((count,) if count is not None else _COUNTS)]
    greedy = greedy_pairs(design, counts[-1])
    reached = [design.probability_of(greedy[:n]) for n in counts]
    enough = next(n for n, probability in zip(counts, reached, strict=True) if probability >= NEARLY * max(reached))
    chosen = exchanged_pairs(design, greedy[:enough])
    return shown * design.probability_of(chosen), offer.take(chosen)


def design_of(made: MeasuredPairs, drawn: Sequence[DrawnCause]) -> tuple[PairDesign, float] | None:
    """Design for the causes drawn, each by the member that shows most, and the share of causes that show at all."""
    candidates = candidates_of(made.differences, made.dataset)
    names = [full_name(c.member, p) for c in candidates for p in c.parameters]
    column = {name: k for k, name in enumerate(names)}
    visible = np.concatenate(
        [np.zeros((int(made.differences.train.sum()), 0)), *(c.visible for c in candidates)], axis=1
    )
    causes = []
    for cause in drawn:
        parts = []
        for member, values in cause.coefficients.items():
            part = np.zeros(len(column))
            for parameter, value in zip(member.parameters, values, strict=True):
                if (name := full_name(member, parameter)) in column:
                    part[column[name]] = value / parameter.scale
            parts.append(part)
        causes.append(max(parts, key=lambda part: float(np.linalg.norm(visible @ part))))
    shown = [cause for cause in causes if cause.any()]
    if not shown:
        return None
    return PairDesign.of(made.differences, candidates, np.array(shown)), len(shown) / len(causes)


@dataclass(frozen=True)
class MeasuredPairs:
    """Pairs measured without any cause or noise."""

    dataset: Dataset
    differences: Differences


@dataclass(frozen=True)
class PairCell:
    """An arm before its instrument, in which pairs are measured by simulation."""

    dataset: Dataset
    robot: Robot  # calibrated
    scanner_T_base: Mapping[str, Array]
    sigma_mm: float

    def measured(self, poses: Poses) -> MeasuredPairs | None:
        """Poses measured without any cause or noise; None where they pair too few."""
        model, n = geometric_model(self.robot), len(poses)
        placed = frames_by_name(self.scanner_T_base, poses.setup)
        points = self.dataset.points
        assert points is not None
        target = str(points.target[0])
        xyz_mm = frames.apply(placed, model.predict(np.zeros(len(model.parameters)), poses, target))
        covariance = np.tile(self.sigma_mm**2 * np.eye(3), (n, 1, 1))
        made = replace(self.dataset, poses=poses, points=Points(np.arange(n), xyz_mm, np.full(n, target), covariance))
        paired = next((one for one in find_pairs(made) if one.conditions[0] in ACTING), None)
        differences = None if paired is None else differences_of(made, paired, self.robot)
        return None if differences is None else MeasuredPairs(made, differences)


def settled_share(made: MeasuredPairs | None, drawn: Sequence[DrawnCause], rng: np.random.Generator) -> float:
    """Share of drawn causes that are proven, and nothing else is, by pairs that are measured in simulation."""
    if made is None:
        return 0.0
    differences = made.differences
    candidates = candidates_of(differences, made.dataset)
    settled = 0
    for cause in drawn:
        explained = np.zeros(len(differences.residual))
        for member, values in cause.coefficients.items():
            explained += differences.columns(member) @ (values / np.array([p.scale for p in member.parameters]))
        noise = rng.standard_normal((len(differences.row), 3))
        found = decided(differences.simulated(explained, noise), candidates, name_open=False).proofs
        proven = {(proof.effect, proof.joint) for proof in found}
        settled += bool(proven) and proven <= cause.carriers
    return settled / len(drawn)


def _joint(member: Effect) -> int | None:
    """Joint of an effect's member, counted from 1; None for the whole arm."""
    joint = getattr(member, "joint", None)
    return None if joint is None else int(joint) + 1
