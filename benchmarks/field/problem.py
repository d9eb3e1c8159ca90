"""What every tool of the comparison gets, what it gives back, and how that is judged; numpy alone.

A problem is a folder with problem.npz (below) and, for tools that read datasets of this project's form, the same data
as dataset/. **The places of the test poses in it are shuffled among themselves**: who fits to them, or chooses by
them, chooses by noise. A tool writes where it thinks the tool's point is at every pose, in any frame that stands still
within a setup. Each setup is then placed by a rigid motion that its training points choose (its own, where it has
none), the same for all tools, and the distance to what was measured at the test poses is its error.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

Array = np.ndarray
Z_90 = 1.6448536269514722


@dataclass(frozen=True)
class Problem:
    """Joints and measured points of N poses of an arm whose table is known; all lengths in mm, all angles in rad."""

    table: Array  # (n + 1, 4) a, alpha, d, theta of each joint's row, then of the tool's
    q: Array  # (N, n)
    points: Array  # (N, 3) in the frame of the instrument
    setup: Array  # (N,) name of the place at which instrument or target stood
    is_test: Array  # (N,)

    @property
    def training(self) -> tuple[Array, Array, Array]:
        """Joints, points and setups of the training poses."""
        train = ~self.is_test
        return self.q[train], self.points[train], self.setup[train]

    @classmethod
    def load(cls, folder: Path) -> Problem:
        """The problem in a folder."""
        with np.load(folder / "problem.npz") as file:
            return cls(**file)

    def save(self, folder: Path) -> None:
        """Write the problem into a folder."""
        np.savez(folder / "problem.npz", **vars(self))


@dataclass(frozen=True)
class Answer:
    """What a tool says: the tool's point at all poses, and what it promises, if it promises anything."""

    points: Array  # (N, 3) mm
    parameters: int
    note: str = ""  # how it ended
    cause: str = ""  # what it says the arm does beyond its table; "" where it says nothing of it
    sigma: Array | None = None  # (N, 3) standard deviation promised for each coordinate, mm
    version: str = ""
    seconds: float = 0.0  # of the processor, for the calibration alone

    @classmethod
    def load(cls, path: Path) -> Answer:
        """The answer in a file."""
        with np.load(path) as file:
            found = {name: value if value.ndim else value.item() for name, value in file.items()}
        return cls(**found)

    def save(self, path: Path) -> None:
        """Write the answer."""
        np.savez(path, **{name: value for name, value in vars(self).items() if value is not None})


def onto(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation and shift of the rigid motion that brings points (K, 3) nearest to others (Kabsch 1976)."""
    u, _, vt = np.linalg.svd((target - target.mean(0)).T @ (source - source.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn, target.mean(0) - turn @ source.mean(0)


def placed(points: Array, problem: Problem, measured: Array) -> Array:
    """Predicted points (N, 3) in the frames of the instrument."""
    out = np.empty_like(points)
    for name in np.unique(problem.setup):
        rows = problem.setup == name
        by = rows & ~problem.is_test
        turn, shift = onto(*((points[by], measured[by]) if by.any() else (points[rows], measured[rows])))
        out[rows] = points[rows] @ turn.T + shift
    return out


def judged(answer: Answer, problem: Problem, measured: Array) -> dict[str, float | int | None]:
    """Figures of an answer, by the true measurements (N, 3)."""
    at = placed(answer.points, problem, measured)
    error = measured - at
    distance = np.linalg.norm(error, axis=1)
    test, train = distance[problem.is_test], distance[~problem.is_test]
    coverage = None
    if answer.sigma is not None:  # which hardly depends on the frame, but is of the instrument's axes
        within = np.abs(error) <= Z_90 * answer.sigma
        coverage = float(np.mean(within[problem.is_test]))
    return {
        "held_out_rms_mm": float(np.sqrt(np.mean(test**2))),
        "held_out_median_mm": float(np.median(test)),
        "held_out_max_mm": float(test.max()),
        "training_rms_mm": float(np.sqrt(np.mean(train**2))),
        "coverage_90": coverage,
        "parameters": answer.parameters,
        "seconds": answer.seconds,
    }
