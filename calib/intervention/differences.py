"""Differences of paired poses: what measured points and predicted effects do between the poses of one place.

At a place every error of geometry is the same under each condition, so the mean over the place's poses is taken away
from the residual and from each effect's columns: for two poses that is their difference over sqrt(2), for more it
counts none twice. Between conditions the instrument may have been moved and the tool put on anew. Each run under equal
conditions therefore has a rigid motion of the instrument's frame and a shift of the tool of its own, nine unknowns,
which are projected out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect
from calib.effects.state import RobotState, Seen
from calib.fitting.model import effect_columns, geometric_model, place_of_target, point_by_state
from calib.fitting.observations import Observations, predict_points, with_scanner_frames
from calib.fitting.scanner_frame import fit_scanner_frame, whitener
from calib.frames import frames_by_name
from calib.intervention.pairs import APPROACH, PairedPoses
from calib.kinematics.robot import Robot
from calib.statistics import group_numbers

_FEWEST_OF_RUN = 6
"""Points from which a run gets a motion of the instrument and a shift of the tool of its own."""
_LEVER_MM = 1000.0  # that makes the unknowns of a turn as large as those of a shift
_SAME = 1e-6  # share of a column that is rounding
_HIDDEN = 0.02  # share of a column that projection has to leave: below it, the instrument and the tool do the same


@dataclass(frozen=True)
class Differences:
    """Whitened points of paired poses, less the mean of their place. M points, R = 3 M rows."""

    paired: PairedPoses
    states: Mapping[str, RobotState]  # by target, of the used poses, with the joints of their place
    by_state: Mapping[str, Array]  # by target (N, 3, S): derivative of the point by the state
    target: Mapping[str, BoolArray]  # masks (M,)
    row: IndexArray  # (M,) used pose of each point
    pose: IndexArray  # (M,) index of each point's pose in the dataset
    xyz_mm: Array  # (M, 3) measured, in the scanner's frame
    scanner_R_base: Array  # (M, 3, 3) of the run of each point
    place: IndexArray  # (N,) number of the place of each used pose
    whiten: Array  # (M, 3, 3) from the base frame to sigmas
    cell: IndexArray  # (M,) number of the place and target, of which the mean is taken away
    train: BoolArray  # (R,) rows of the pairs that are fitted; the others are held out
    residual: Array  # (R,) measured minus predicted
    nuisance: Array  # (R, K) the instrument's motions and the tool's shifts
    basis: Array  # (R_train, rank) orthonormal, of the nuisance at the fitted pairs
    dof: int  # degrees of freedom of the fitted pairs

    @property
    def pairs(self) -> int:
        """Number of fitted pairs, neighbouring levels at each place."""
        train = self.train[::3]
        return len(np.unique(self.row[train])) - len(np.unique(self.place[self.row[train]]))

    def simulated(self, explained: Array, noise: Array) -> Differences:
        """The same differences with other measurements: what a cause adds (R,), and white noise (M, 3), in sigmas."""
        return replace(self, residual=explained + without_mean(noise[:, :, None], self.whiten, self.cell).reshape(-1))

    @property
    def visible_residual(self) -> Array:
        """The residual (R_train,) of the fitted pairs with the nuisance projected out."""
        return self._projected(self.residual[self.train])

    def columns(self, member: Effect, least: float = 0.0) -> Array:
        """Derivative (R, K) of the whitened points by an effect's parameters per usual size, less the place's mean.

        Zero where the mean is all but a share `least`, or rounding.
        """
        values = np.zeros(len(member.parameters))
        out = np.empty((len(self.row), 3, len(values)))
        for target, state in self.states.items():
            by_value = effect_columns(self.by_state[target], member, state, values)
            out[self.target[target]] = by_value[self.row[self.target[target]]]
        raw = self.whiten @ (out * np.array([p.scale for p in member.parameters]))
        moved = without_mean(raw, self.whiten, self.cell)
        raw = raw.reshape(-1, len(values))
        moved = moved.reshape(-1, len(values))
        moved[:, np.linalg.norm(moved, axis=0) <= max(least, _SAME) * np.linalg.norm(raw, axis=0)] = 0.0
        return np.asarray(moved)

    def visible(self, columns: Array) -> Array:
        """Columns (R, K) at the fitted pairs (R_train, K), nuisance projected out; zero where hardly any is left."""
        of_train = columns[self.train]
        visible = self._projected(of_train)
        hidden = np.linalg.norm(visible, axis=0) <= _HIDDEN * np.linalg.norm(of_train, axis=0)
        visible[:, hidden] = 0.0
        return visible

    def held_out_square(self, columns: Array, coefficients: Array) -> float | None:
        """Squared error, in sigmas, of the held-out pairs with given coefficients (K,) of columns (R, K).

        The nuisance is that of the fitted pairs. None where nothing is held out, or under conditions of its own.
        """
        left = self.residual - columns @ coefficients
        test = ~self.train
        seen = np.linalg.norm(self.nuisance[self.train], axis=0) > 0.0
        test &= ~np.any(np.abs(self.nuisance[:, ~seen]) > 0.0, axis=1)
        if not test.any():
            return None
        amounts = np.linalg.lstsq(self.nuisance[self.train], left[self.train], rcond=1e-9)[0]
        error = left[test] - self.nuisance[test] @ amounts
        return float(error @ error)

    def _projected(self, values: Array) -> Array:
        return values - self.basis @ (self.basis.T @ values)


def without_mean(values: Array, whiten: Array, cell: IndexArray) -> Array:
    """Whitened values (M, 3, K) less what a common shift of all points of each cell would explain of them."""
    cells = int(cell.max(initial=-1)) + 1
    square, along = np.zeros((cells, 3, 3)), np.zeros((cells, 3, values.shape[2]))
    turned = np.swapaxes(whiten, 1, 2)
    np.add.at(square, cell, turned @ whiten)
    np.add.at(along, cell, turned @ values)
    return values - whiten @ np.linalg.solve(square, along)[cell]


def differences_of(dataset: Dataset, paired: PairedPoses, robot: Robot) -> Differences | None:
    """Differences of the paired poses of a dataset; None where too few are left to judge anything by.

    Args:
        dataset: with points at the paired poses.
        paired: the poses.
        robot: the calibrated arm, which gives the places.
    """
    model = geometric_model(robot)
    zero = np.zeros(len(model.parameters))
    chosen = np.isin(np.arange(len(dataset.poses)), paired.poses)
    observed = Observations.of(dataset, chosen)
    if dataset.poses.is_test[observed.points.pose].all():
        return None
    place = np.full(len(dataset.poses), -1)
    place[paired.poses] = paired.place
    observed, cell = _with_cells(observed, place)
    if not len(cell):
        return None
    run = _runs(dataset, paired, observed.points.pose)
    observed = with_scanner_frames(observed, model, zero)
    predicted_mm = predict_points(model, zero, observed)
    placed = _frames_of_runs(observed, predicted_mm, run)
    whiten = whitener(observed.covariance_mm2) @ placed[:, :3, :3]
    measured_mm = frames.apply(frames.invert(placed), observed.points.xyz_mm)
    residual = (whiten @ (measured_mm - predicted_mm)[:, :, None])[..., 0]
    states, row = _states_at_places(robot, observed, place)
    nuisance = _nuisance(states, row, observed, predicted_mm, run)
    held_out = np.zeros(len(dataset.poses), dtype=bool)
    held_out[paired.poses] = paired.is_held_out
    train = ~held_out[observed.points.pose]
    residual = without_mean(residual[:, :, None], whiten, cell).reshape(-1)
    nuisance = without_mean(whiten @ nuisance, whiten, cell).reshape(len(residual), -1)
    of_train = np.repeat(train, 3)
    u, s, _ = np.linalg.svd(nuisance[of_train], full_matrices=False)
    basis = u[:, s > 1e-9 * max(float(s.max(initial=0.0)), 1e-300)]
    dof = 3 * (int(np.count_nonzero(train)) - len(np.unique(cell[train]))) - basis.shape[1]
    if dof < 3:
        return None
    return Differences(
        paired=paired,
        states=states,
        by_state={target: point_by_state(state, target)[1] for target, state in states.items()},
        target=observed.targets,
        row=row,
        pose=observed.points.pose,
        xyz_mm=observed.points.xyz_mm,
        scanner_R_base=placed[:, :3, :3],
        place=place[np.unique(observed.points.pose)],
        whiten=whiten,
        cell=cell,
        train=of_train,
        residual=residual,
        nuisance=nuisance,
        basis=basis,
        dof=dof,
    )


def _with_cells(observed: Observations, place: IndexArray) -> tuple[Observations, IndexArray]:
    """Observations with the cell (M,), place and target, of each point; cells measured at one pose only are left out.

    Where no target was measured at two poses of a place, a cell is the place: the target itself was exchanged.
    """
    points = observed.points
    target = group_numbers(points.target)
    for keys in (np.column_stack([place[points.pose], target]), place[points.pose][:, None]):
        cell = group_numbers(keys)
        of_pose = np.unique(np.column_stack([cell, points.pose]), axis=0)[:, 0]
        several = np.bincount(of_pose, minlength=int(cell.max(initial=-1)) + 1) > 1
        if several.any():
            kept = several[cell]
            return observed.select(kept), group_numbers(cell[kept])
    return observed.select(np.zeros(len(points), dtype=bool)), np.zeros(0, dtype=np.int64)


def _runs(dataset: Dataset, paired: PairedPoses, pose: IndexArray) -> IndexArray:
    """Number (M,) of the run of each point: the poses under equal conditions, in one setup.

    Sides of approach that were drawn anew at each pose split the poses into runs of a few points each; no motion of the
    instrument goes with them, and they count for none.
    """
    level = np.zeros(len(dataset.poses), dtype=np.int64)
    level[paired.poses] = paired.level
    setup = group_numbers(dataset.poses.setup)
    keys = np.column_stack([setup, level])[pose]
    run = group_numbers(keys)
    if APPROACH in paired.conditions and np.bincount(run).min() < _FEWEST_OF_RUN:
        run = group_numbers(setup[pose])
    return np.asarray(run)


def _frames_of_runs(observed: Observations, predicted_mm: Array, run: IndexArray) -> Array:
    """Transform scanner_T_base (M, 4, 4) at each point, fitted to its run; that of its setup where a run is short."""
    assert observed.scanner_T_base is not None
    placed = frames_by_name(observed.scanner_T_base, observed.setup)
    for number in range(int(run.max()) + 1):
        rows = run == number
        if np.count_nonzero(rows) >= _FEWEST_OF_RUN:
            xyz_mm, covariance = observed.points.xyz_mm[rows], observed.covariance_mm2[rows]
            placed[rows] = fit_scanner_frame(predicted_mm[rows], xyz_mm, covariance)
    return placed


def _states_at_places(
    robot: Robot, observed: Observations, place: IndexArray
) -> tuple[dict[str, RobotState], IndexArray]:
    """States by target at the used poses, each with the joint values of its place's first, and the points' rows.

    So functions of the joints alone are the same at all poses of a place to the last bit. So are errors of an
    instrument that did not move: it sees the target where the robot should have it, not where noise put this point.
    """
    poses, row = observed.used_poses
    of_pose = place[np.unique(observed.points.pose)]
    first = np.unique(of_pose, return_index=True)[1][group_numbers(of_pose)]
    at_place = replace(poses, q=poses.q[first])
    scanner_T_base = observed.scanner_T_base_at(poses)[first]
    states = {}
    for name in observed.targets:
        state = RobotState.nominal(robot, at_place)
        seen_mm = frames.apply(scanner_T_base, place_of_target(state, name))
        states[name] = replace(state, seen=Seen(seen_mm, scanner_T_base))
    return states, row


def _nuisance(
    states: Mapping[str, RobotState], row: IndexArray, observed: Observations, predicted_mm: Array, run: IndexArray
) -> Array:
    """Columns (M, 3, 9 L) of the motions of the instrument's frame and the shifts of the tool, for each of L runs."""
    runs = int(run.max()) + 1
    out = np.zeros((len(row), 3, runs, 9))
    own = np.empty((len(row), 3, 9))
    own[..., :6] = frames.frame_motion(predicted_mm, predicted_mm.mean(axis=0))
    own[..., 3:6] /= _LEVER_MM
    for target, of_target in observed.targets.items():
        own[of_target, :, 6:] = states[target].attitude[row[of_target]]
    out[np.arange(len(row)), :, run] = own
    return out.reshape(len(row), 3, -1)


@dataclass(frozen=True)
class PairDisplacements:
    """What a changed condition moved at P places, from its lowest level there to its highest.

    The motion of the instrument and the shift of the tool between the runs, as they were fitted, are taken away.
    """

    before: IndexArray  # (P,) index of the pose under the lowest level
    after: IndexArray  # (P,) and under the highest
    names: tuple[str, ...]  # (P,) ids of the poses under the highest level
    held_out: BoolArray  # (P,) whether the pair was not fitted
    place_mm: Array  # (P, 3) point measured before the change, in the scanner's frame
    moved_mm: Array  # (P, 3) measured, in that frame
    explained_mm: Array  # (P, 3) by the proven causes

    @property
    def longest_mm(self) -> float:
        """Length of the longest measured displacement."""
        return float(np.linalg.norm(self.moved_mm, axis=1).max(initial=0.0))


def displacements_of(differences: Differences, explained: Array) -> PairDisplacements:
    """Displacements at the places of some differences.

    Args:
        differences: of paired poses.
        explained: what the proven causes add to them (R,), in sigmas.
    """
    train = differences.train
    rest = (differences.residual - explained)[train]
    moved = np.linalg.lstsq(differences.nuisance[train], rest, rcond=1e-9)[0]
    measured = differences.residual - differences.nuisance @ moved
    in_mm = [np.linalg.solve(differences.whiten, part.reshape(-1, 3, 1))[..., 0] for part in (measured, explained)]
    first, last = _ends(differences)
    to_scanner = differences.scanner_R_base[first]
    moved_mm, explained_mm = ((to_scanner @ (part[last] - part[first])[:, :, None])[..., 0] for part in in_mm)
    ids = differences.paired.of.ids
    return PairDisplacements(
        before=differences.pose[first],
        after=differences.pose[last],
        names=tuple(ids[pose] for pose in differences.pose[last].tolist()),
        held_out=~train[::3][first],
        place_mm=differences.xyz_mm[first],
        moved_mm=moved_mm,
        explained_mm=explained_mm,
    )


def _ends(differences: Differences) -> tuple[IndexArray, IndexArray]:
    """Rows (P,) of the points under the lowest and the highest level of each place and target, where these differ."""
    level = dict(zip(differences.paired.poses.tolist(), differences.paired.level.tolist(), strict=True))
    of_point = np.array([level[pose] for pose in differences.pose.tolist()])
    order = np.lexsort((of_point, differences.cell))
    starts = np.flatnonzero(np.diff(differences.cell[order], prepend=-1))
    ends = np.append(starts[1:], len(order)) - 1
    first, last = order[starts], order[ends]
    differ = of_point[first] != of_point[last]
    return first[differ], last[differ]
