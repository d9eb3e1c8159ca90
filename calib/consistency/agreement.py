"""Misfit between a nominal arm and measured points, with free scanner frames and free tool point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset, Points
from calib.fitting.scanner_frame import orthonormal
from calib.frames import apply, best_fit_transform, frame_motion
from calib.kinematics.chain import Chain, nominal_chain, point_jacobian
from calib.kinematics.robot import TOOL_POINT, Robot
from calib.statistics import rms_length

LEAST_POSES = 16  # nine numbers are fitted; fewer poses agree with almost any arm
_MOST_POSES = 150  # more poses give the same result
_TURNS = 6  # alternating fits of frame and tool point
_HOPELESS = 0.4  # of the points' spread left after two turns: no agreement
_TOOL_REACH = 1.0  # of the points' spread that a tool point may be off
_FIT_STEPS = 4  # of entries of a table
_FEWEST_IN_GROUP = 4  # poses that were measured from one place; a frame takes three


@dataclass(frozen=True)
class Sample:
    """Joint values and points of poses with one measurement each of one target, with the scanner's stations."""

    q: Array  # (N, n) rad, mm
    points_mm: Array  # (N, 3)
    group: IndexArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (N,) station; (0,): one for all

    @property
    def groups(self) -> tuple[IndexArray, ...]:
        """Row numbers of the poses measured from each station of the scanner."""
        if len(self.group) != len(self.q):
            return (np.arange(len(self.q)),)
        return tuple(np.flatnonzero(self.group == name) for name in np.unique(self.group))

    @property
    def spread_mm(self) -> float:
        """Root mean square distance of the points from the centroid of their station's points, mm."""
        return rms_length(self.away_mm)

    @property
    def away_mm(self) -> Array:
        """Points (N, 3) relative to the centroid of their station's points, mm."""
        out = np.empty_like(self.points_mm)
        for rows in self.groups:
            out[rows] = self.points_mm[rows] - self.points_mm[rows].mean(axis=0)
        return out

    @property
    def is_enough(self) -> bool:
        """Whether the poses are enough, and spread enough, for a meaningful misfit."""
        return len(self.q) >= LEAST_POSES and self.spread_mm > 0.0


def sample_of(q: Array, points_mm: Array) -> Sample:
    """Sample of at most a fixed number of poses, evenly spread, from joint values q (N, n) and points (N, 3)."""
    known = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(points_mm).all(axis=1))
    known = thinned(known)
    return Sample(q[known], points_mm[known])


def thinned(rows: IndexArray) -> IndexArray:
    """Row numbers of at most `_MOST_POSES` poses, evenly spread over all."""
    if len(rows) <= _MOST_POSES:
        return rows
    return rows[np.linspace(0, len(rows) - 1, _MOST_POSES).astype(int)]


def main_target(points: Points) -> str:
    """Name of the most often measured target; the tool's point, jig, before others that were measured as often."""
    names, counts = np.unique(points.target, return_counts=True)
    return str(max(zip(counts, names == TOOL_POINT, names, strict=True))[2])


def points_of_poses(dataset: Dataset) -> tuple[IndexArray, Array]:
    """Indices (K,) of the poses with the most often measured target, and its first point (K, 3), mm, at each."""
    assert dataset.points is not None
    points = dataset.points
    rows = np.flatnonzero(points.target == main_target(points))
    poses, first = np.unique(points.pose[rows], return_index=True)
    return poses, points.xyz_mm[rows[first]]


def training_sample(dataset: Dataset) -> Sample | None:
    """Sample of the training poses, without stations of only a few poses; None where none are left.

    None, too, for an arm that carries the scanner.
    """
    if dataset.points is None or dataset.robot.carries_scanner:
        return None
    poses, points_mm = points_of_poses(dataset)
    train = ~dataset.poses.is_test[poses]
    poses, points_mm = poses[train], points_mm[train]
    setup = dataset.poses.setup[poses]
    names, group, counts = np.unique(setup, return_inverse=True, return_counts=True)
    rows = thinned(np.flatnonzero(counts[group] >= _FEWEST_IN_GROUP))
    # Thinning may leave a station with too few poses.
    rows = rows[np.bincount(group[rows], minlength=len(names))[group[rows]] >= _FEWEST_IN_GROUP]
    if not len(rows):
        return None
    return Sample(dataset.poses.q[poses[rows]], points_mm[rows], group[rows])


@dataclass(frozen=True)
class _Agreement:
    """The nominal arm brought to the points of a sample: by a frame of each station and a tool point."""

    misfit_mm: float
    off_mm: Array  # (N, 3) measured minus nominal, in the arm's frame
    place_mm: Array  # (N, 3) of that tool point in the arm's frame


def misfit_mm(robot: Robot, sample: Sample, *, tool_is_known: bool = False) -> float:
    """Root mean square distance, mm, between the nominal arm's tool and the points of a sample.

    The scanner frames and the tool point, which users know least, are fitted in turn, each in closed form: minimise
    over R, s of each station and over t the sum of |R (p_i + A_i t) + s - m_i|^2, with p_i and A_i the nominal tool's
    position and attitude.

    tool_is_known: whether the tool point is where the table has it, so that only frames are fitted.
    """
    chain = nominal_chain(robot, sample.q)
    return _agreement(sample, chain, tool_is_known).misfit_mm


def nominal_places(robot: Robot, sample: Sample) -> tuple[float, Array]:
    """`misfit_mm`, and the points' places (N, 3), mm, in the base frame by the nominal arm with that tool point."""
    agreed = _agreement(sample, nominal_chain(robot, sample.q), False)
    return agreed.misfit_mm, agreed.place_mm


def misfit_columns(
    robot: Robot, sample: Sample, entries: Sequence[int], *, tool_is_known: bool = False
) -> tuple[Array, Array]:
    """Misfit (3 N,) of a sample and its derivative (3 N, K) by entries of the table, freed of what `misfit_mm` fits.

    entries: indices of the table's entries, row by row.
    """
    chain = nominal_chain(robot, sample.q)
    agreed = _agreement(sample, chain, tool_is_known)
    count = len(sample.q)
    by_table = point_jacobian(chain, agreed.place_mm).reshape(count, 3, -1)[..., list(entries)]
    attitude = chain.base_T_frame[:, -1, :3, :3]
    frames = np.zeros((count, 3, 6 * len(sample.groups)))
    for k, rows in enumerate(sample.groups):
        centre_mm = agreed.place_mm[rows].mean(axis=0)
        frames[rows, :, 6 * k : 6 * k + 6] = frame_motion(agreed.place_mm[rows], centre_mm)
    nuisance = frames if tool_is_known else np.concatenate([attitude, frames], axis=-1)
    free = orthonormal(nuisance.reshape(3 * count, -1))
    columns, off = by_table.reshape(3 * count, -1), agreed.off_mm.ravel()
    return off - free @ (free.T @ off), columns - free @ (free.T @ columns)


def _agreement(sample: Sample, chain: Chain, tool_is_known: bool) -> _Agreement:
    ends = chain.base_T_frame[:, -1]
    place, attitude = ends[:, :3, 3], ends[:, :3, :3]
    groups, away, spread = sample.groups, sample.away_mm, sample.spread_mm
    place_away, attitude_away = np.empty_like(place), np.empty_like(attitude)
    for rows in groups:
        place_away[rows] = place[rows] - place[rows].mean(axis=0)
        attitude_away[rows] = attitude[rows] - attitude[rows].mean(axis=0)
    steps = attitude_away.reshape(-1, 3)
    inverse = np.linalg.pinv(steps.T @ steps, rcond=1e-9, hermitian=True) @ steps.T
    offset, best = np.zeros(3), _Agreement(np.inf, np.empty_like(away), place)
    seen, off, back = np.empty_like(away), np.empty_like(away), np.empty_like(away)
    for turn in range(1 if tool_is_known else _TURNS):
        if turn == 2 and best.misfit_mm > _HOPELESS * spread:
            break
        mine = place + attitude @ offset
        for rows in groups:
            frame = best_fit_transform(mine[rows], sample.points_mm[rows])
            off[rows] = apply(frame, mine[rows]) - sample.points_mm[rows]
            seen[rows] = away[rows] @ frame[:3, :3]  # in the arm's frame
            back[rows] = -off[rows] @ frame[:3, :3]
        misfit = rms_length(off)
        if misfit < best.misfit_mm:
            best = _Agreement(misfit, back.copy(), mine)
        offset = inverse @ (seen - place_away).ravel()
        length = float(np.linalg.norm(offset))
        if length > _TOOL_REACH * spread:
            offset = offset * (_TOOL_REACH * spread / length)
    return best


def with_entries_fitted(robot: Robot, sample: Sample, entries: Sequence[int], *, tool_is_known: bool = False) -> Robot:
    """Robot with some entries of its table fitted to a sample, all others as they are, by Gauss-Newton steps."""
    for _ in range(_FIT_STEPS):
        off, columns = misfit_columns(robot, sample, entries, tool_is_known=tool_is_known)
        table = robot.table.ravel()
        table[list(entries)] += np.linalg.lstsq(columns, off, rcond=1e-9)[0]
        robot = robot.with_table(table.reshape(robot.table.shape))
    return robot
