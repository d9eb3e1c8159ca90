"""What planned pairs of poses achieve: the change of a condition, and the probability that it proves a cause."""

from __future__ import annotations

from dataclasses import dataclass

from calib.planning.outcome import Outcome, PoseReason


@dataclass(frozen=True)
class PairReason(PoseReason):
    """Reason for a pose: it is measured under a changed condition, at the joints of another one."""

    again: str | None  # the pose measured before that it repeats; None where both are new
    condition: str  # column of poses.csv
    level: float | None  # its value; None for sides of approach


@dataclass(frozen=True)
class ProofOutcome(Outcome):
    """A change of one condition, and the probability that pairs of poses then prove which hypothesis is true."""

    hypotheses: tuple[str, ...]
    condition: str  # column of poses.csv; "approach" for those of all joints
    before: float | None  # None for sides of approach
    after: float | None
    again: tuple[str, ...]  # measured poses to measure again; () where all are new
    assumed: bool  # whether no column has the condition of the measured poses, which is taken for `before`
    pairs: int
    probability: float
    others: tuple[tuple[str, float | None, float | None, float], ...]
    """Other conditions with their values before and after, and nearly the probability that changing these reaches."""

    @property
    def power(self) -> float:
        """Probability that the pairs prove which hypothesis is true."""
        return self.probability
