"""Pairs of poses that can be measured under a change of one condition, chosen, and judged in simulation.

What they settle is found by simulation: the pairs of an arm with a drawn cause are measured with noise, and
`calib.intervention.proof.decided` judges them as it will judge the real ones.

A cause is proven where no other one explains the differences nearly as well (`calib.intervention.proof`). With S the
squared size of a cause's differences, in sigmas, of which the best rival explains the share R^2, the log likelihood
ratio has the mean d^2 / 2 and the standard deviation d, d^2 = S (1 - R^2). The probability that this ratio is above
`MIN_LEAD` is what the chosen pairs are worth; they are chosen by exp(-d^2 / 4), averaged over the causes that are
thought of, which falls from the first pair on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from calib import frames
from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset, Points, Poses
from calib.effects.effect import Effect, full_name
from calib.fitting.model import geometric_model
from calib.frames import frames_by_name
from calib.intervention.differences import Differences, differences_of
from calib.intervention.pairs import APPROACH, PAYLOAD, find_pairs
from calib.intervention.proof import FEWEST_PAIRS, MIN_LEAD, PairCandidate, candidates_of, decided
from calib.kinematics.robot import Robot
from calib.planning.exchange import OptimalityCriterion, best_poses

TEMPERATURE = "temperature_c"
ACTING = (APPROACH, PAYLOAD, TEMPERATURE)
"""Conditions that a change may be of."""
NEARLY = 0.9  # of what the most measurements reach, from which fewer are enough
_COUNTS = (8, 12, 20, 40)  # measurements that are tried, the fewest first
_FREE = 1e-7  # share of the nuisance's own information that keeps it invertible


@dataclass(frozen=True)
class ConditionChange:
    """A condition that is changed between the poses of a pair, as a column of poses.csv; None for sides of approach."""

    condition: str
    before: float | None
    after: float | None

    def other(self, values: Array) -> Array:
        """Values of the condition after the change, for those before it."""
        if self.before is None or self.after is None:
            return -values  # the other side
        return np.where(values < 0.5 * (self.before + self.after), self.after, self.before)


@dataclass(frozen=True)
class DrawnCause:
    """A cause that may be true: members of one effect with their coefficients."""

    effect: str
    coefficients: Mapping[Effect, Array]

    @property
    def carriers(self) -> set[tuple[str, int | None]]:
        """Effect and joint, counted from 1, of each member."""
        joints = [getattr(member, "joint", None) for member in self.coefficients]  # None for the whole arm
        return {(self.effect, None if joint is None else int(joint) + 1) for joint in joints}


@dataclass(frozen=True)
class Offer:
    """Pairs that can be measured under one change: before and after it, one row each."""

    change: ConditionChange
    before: Poses
    after: Poses
    is_again: bool
    assumed: bool = False

    @classmethod
    def of(cls, poses: Poses, change: ConditionChange, values: Array, *, again: bool, assumed: bool = False) -> Offer:
        """Pairs of poses with given values of the condition, and with those after the change."""
        plain = replace(poses, order=np.zeros(0), came_from=np.zeros((0, 0)), selected_from=None, time_s=None)
        before, after = (under(plain, change.condition, side) for side in (values, change.other(values)))
        return cls(change, before, after, again, assumed)

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
        points = self.dataset.points
        assert points is not None
        target = str(points.target[0])
        placed = frames_by_name(self.scanner_T_base, poses.setup)
        xyz_mm = frames.apply(placed, model.predict(np.zeros(len(model.parameters)), poses, target))
        covariance = np.tile(self.sigma_mm**2 * np.eye(3), (n, 1, 1))
        made = replace(self.dataset, poses=poses, points=Points(np.arange(n), xyz_mm, np.full(n, target), covariance))
        paired = next((one for one in find_pairs(made) if one.conditions[0] in ACTING), None)
        differences = None if paired is None else differences_of(made, paired, self.robot)
        return None if differences is None else MeasuredPairs(differences, candidates_of(differences, made))


@dataclass(frozen=True, kw_only=True)
class PairQuestion(OptimalityCriterion):
    """Which of C pairs prove one of T causes; its unknowns are the nuisance, then the candidates' parameters.

    The target combinations are the causes: coefficients (K, T), of one candidate each.
    """

    owner: IndexArray  # (K,) number of the candidate that has each parameter; -1 of instrument and tool

    @classmethod
    def of(cls, differences: Differences, candidates: Sequence[PairCandidate], causes: Array) -> PairQuestion:
        """The criterion whose pairs are the places of given differences, for causes (T, P) by the last P parameters."""
        columns = np.concatenate([differences.nuisance, *(c.columns for c in candidates)], axis=1)
        cell = np.repeat(differences.cell, 3)
        rows = np.stack([columns[cell == k] for k in range(int(cell.max()) + 1)])
        widths = [differences.nuisance.shape[1], *(c.columns.shape[1] for c in candidates)]
        owner, k = np.repeat(np.arange(-1, len(candidates)), widths), columns.shape[1]
        combinations = np.zeros((k, len(causes)))
        combinations[k - causes.shape[1] :] = causes.T
        return cls(rows=rows, prior_information=np.zeros((k, k)), target_combinations=combinations, owner=owner)

    def log_value(self, information: Array) -> float:
        """Log of the criterion for an information matrix (K, K)."""
        return float(self._log_confusion(information[None])[0])

    def log_values_with(self, information: Array) -> Array:
        """Log of the criterion (C,) with each one of the pairs added to an information matrix (K, K)."""
        return self._log_confusion(information + np.swapaxes(self.rows, 1, 2) @ self.rows)

    def probability_of(self, chosen: IndexArray) -> float:
        """Probability, nearly, that the true cause is proven by some of the pairs."""
        rows = self.rows[chosen].reshape(-1, len(self.owner))
        apart = np.sqrt(self._beyond_rivals((rows.T @ rows)[None])[0])
        return float(ndtr((0.5 * apart**2 - MIN_LEAD) / apart).mean())

    def _log_confusion(self, information: Array) -> Array:
        return np.asarray(np.log(np.exp(-0.25 * self._beyond_rivals(information)).mean(axis=1)))

    def _beyond_rivals(self, information: Array) -> Array:
        """Squared size d^2 (C, T), in sigmas, of what no rival explains of each cause."""
        visible, causes = self._visible(information), self.target_combinations[self.owner >= 0]
        owner = self.owner[self.owner >= 0]
        along = visible @ causes  # (C, P, T)
        square = np.einsum("kt,ckt->ct", causes, along)
        explained = np.zeros_like(square)
        own = owner[np.argmax(causes != 0.0, axis=0)]
        for number in range(int(owner.max()) + 1):
            k = np.flatnonzero(owner == number)
            block = visible[:, k[:, None], k]
            size = np.einsum("ckk->ck", block).mean(axis=1)[:, None, None]
            block = block + (1e-6 * size + 1e-12) * np.eye(len(k))
            by_rival = np.einsum("ckt,ckt->ct", along[:, k], np.linalg.solve(block, along[:, k]))
            explained = np.maximum(explained, np.where(own == number, 0.0, by_rival))
        return np.maximum(square - explained, 1e-9)

    def _visible(self, information: Array) -> Array:
        """Information (C, P, P) on the candidates' parameters, with the nuisance unknown."""
        n = int(np.sum(self.owner < 0))
        size = np.sqrt(np.maximum(np.einsum("ckk->ck", information[:, :n, :n]), 1e-12))
        own = information[:, :n, :n] / size[:, :, None] / size[:, None, :] + _FREE * np.eye(n)
        across = information[:, :n, n:] / size[:, :, None]
        return information[:, n:, n:] - np.swapaxes(across, 1, 2) @ np.linalg.solve(own, across)


@dataclass(frozen=True)
class MeasuredPairs:
    """Pairs measured without any cause or noise, and the members that may explain their differences."""

    differences: Differences
    candidates: Sequence[PairCandidate]

    def question(self, drawn: Sequence[DrawnCause]) -> tuple[PairQuestion, float] | None:
        """The criterion for the causes drawn, each by the member that shows most, and the share of causes that show."""
        names = [full_name(c.member, p) for c in self.candidates for p in c.parameters]
        hidden = np.zeros((int(self.differences.train.sum()), 0))
        visible = np.concatenate([hidden, *(c.visible for c in self.candidates)], axis=1)
        causes = []
        for cause in drawn:
            parts = []
            for member, values in cause.coefficients.items():
                of = {full_name(member, p): value / p.scale for p, value in zip(member.parameters, values, strict=True)}
                parts.append(np.array([of.get(name, 0.0) for name in names]))
            causes.append(max(parts, key=lambda part: float(np.linalg.norm(visible @ part))))
        shown = [cause for cause in causes if cause.any()]
        if not shown:
            return None
        return PairQuestion.of(self.differences, self.candidates, np.array(shown)), len(shown) / len(drawn)

    def settled_share(self, drawn: Sequence[DrawnCause], rng: np.random.Generator) -> float:
        """Share of drawn causes that are proven, and nothing else is, by these pairs measured with noise."""
        differences, settled = self.differences, 0
        for cause in drawn:
            explained = np.zeros(len(differences.residual))
            for member, values in cause.coefficients.items():
                explained += differences.columns(member) @ (values / np.array([p.scale for p in member.parameters]))
            noise = rng.standard_normal((len(differences.row), 3))
            found = decided(differences.simulated(explained, noise), self.candidates, name_open=False).proofs
            proven = {(one.effect, one.joint) for proof in found for one in (proof, *proof.alike)}
            settled += bool(proven) and proven <= cause.carriers
        return settled / len(drawn)


def chosen_from(
    cell: PairCell, offer: Offer, drawn: Sequence[DrawnCause], count: int | None
) -> tuple[float, Offer] | None:
    """The best pairs of an offer by number of measurements, with nearly their probability."""
    made = cell.measured(offer.both)
    found = None if made is None else made.question(drawn)
    if found is None:
        return None
    question, shown = found
    cost, most = (1 if offer.is_again else 2), len(question.rows)
    counts = [min(max(n // cost, FEWEST_PAIRS), most) for n in ((count,) if count is not None else _COUNTS)]
    greedy = best_poses([question], counts[-1], exchange=False).rows
    reached = [question.probability_of(greedy[:n]) for n in counts]
    enough = next(n for n, probability in zip(counts, reached, strict=True) if probability >= NEARLY * max(reached))
    chosen = best_poses([question], enough).rows
    return shown * question.probability_of(chosen), offer.take(chosen)
