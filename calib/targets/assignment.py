"""Assignment of the places found in scans to targets: by name or size where possible, else by the robot and all poses.

Targets on the tool are rigid to each other, and the nominal robot predicts where each of them should be up to the
scanner's frame. So one frame, the same at all poses of a setup, fits when all places have their right names, and none
fits when they have not. It is found by trials: two poses, named in every way, give a frame (Kabsch 1976), which names
all others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.kinematics import chain as kinematics
from calib.targets.protocol.finder import FoundPoint
from calib.targets.search import ScanSearch

_TRIALS = 600
_ROUNDS = 5
_JUDGED = 16  # poses by which a trial is judged
_MOST_NAMED = 4  # equal targets that can be identified
_PLACED_MM = 8.0  # by which nominal distances between targets may be off
_MOST_OFF_SHARE = 0.5  # of the misfit of the next-best naming, that the best may have
_RIGID_SIGMAS = 8.0
_RIGID_MM = 1.0  # a tool that bends, and a scanner whose scale is off
_LEAST_POSES = 3


@dataclass(frozen=True)
class Assignment:
    """Targets identified at each pose, and the reasons why other targets were refused."""

    points: Mapping[str, Mapping[str, FoundPoint]]  # pose id -> target -> its place
    refused: Mapping[str, Mapping[str, str]]  # pose id -> target -> the reason

    def lines(self) -> list[str]:
        """A line for each target that was refused at a pose where others were found."""
        return [
            f"{pose}: {name}: {why}"
            for pose, whys in self.refused.items()
            if pose in self.points
            for name, why in whys.items()
        ]


def assign_targets(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> Assignment:
    """Identified places of every target by pose, from the searches of `find_targets`."""
    points: dict[str, dict[str, FoundPoint]] = {}
    refused: dict[str, dict[str, str]] = {}
    open_: dict[tuple[str, ...], dict[str, Sequence[FoundPoint]]] = {}
    for pose_id in dataset.poses.ids:
        search = searches.get(pose_id)
        if not isinstance(search, ScanSearch):
            continue
        for found in search.found:
            if found.failure:
                refused.setdefault(pose_id, {}).update(dict.fromkeys(found.names, found.failure))
            for place in found.places:
                if place.name or len(found.names) == 1:
                    points.setdefault(pose_id, {})[place.name or found.names[0]] = place
            unnamed = [place for place in found.places if not place.name]
            if unnamed and len(found.names) > 1:
                open_.setdefault(found.names, {})[pose_id] = unnamed
    for names, places in open_.items():
        named, why = _named(dataset, names, places, points)
        for pose_id, of_pose in named.items():
            points.setdefault(pose_id, {}).update(of_pose)
        for pose_id, reasons in why.items():
            refused.setdefault(pose_id, {}).update(reasons)
        for pose_id, seen in places.items():
            missing = [n for n in names if n not in points.get(pose_id, {}) and n not in refused.get(pose_id, {})]
            lack = f"{len(seen)} of {len(names)} such targets are in view; clear the view to all"
            if missing:
                refused.setdefault(pose_id, {}).update(dict.fromkeys(missing, lack))
    _refuse_moved(dataset, points, refused)
    return Assignment({pose: found for pose, found in points.items() if found}, refused)


def _named(
    dataset: Dataset,
    names: tuple[str, ...],
    places: Mapping[str, Sequence[FoundPoint]],
    known: Mapping[str, Mapping[str, FoundPoint]],
) -> tuple[dict[str, dict[str, FoundPoint]], dict[str, dict[str, str]]]:
    """Look-alike targets at each pose, identified by the nominal robot, and the reasons why others are refused.

    `known` are places whose names are certain.
    """
    alike = f"{', '.join(names)} look alike"
    if dataset.robot.carries_scanner:
        reason = f"{alike}, and nothing distinguishes them where the arm carries the scanner; give them different sizes"
        return {}, {pose: dict.fromkeys(names, reason) for pose in places}
    if len(names) > _MOST_NAMED:
        reason = f"{alike}, and more than {_MOST_NAMED} cannot be distinguished; give them different sizes"
        return {}, {pose: dict.fromkeys(names, reason) for pose in places}
    named: dict[str, dict[str, FoundPoint]] = {}
    refused: dict[str, dict[str, str]] = {}
    expected = nominal_targets(dataset, names)
    others = list(dict.fromkeys(n for of in known.values() for n in of))
    expected_others = nominal_targets(dataset, others)
    for setup in np.unique(dataset.poses.setup):
        rows = [i for i in np.flatnonzero(dataset.poses.setup == setup) if dataset.poses.ids[i] in places]
        seen = []
        sure = []
        for row in rows:
            of_pose = places[dataset.poses.ids[row]]
            at = expected[:, row]
            xyz = np.array([place.xyz_mm for place in of_pose])
            seen.append(_Seen(dataset.poses.ids[row], xyz, at, _ways(xyz, at)))
            named_here = known.get(seen[-1].pose_id, {})
            sure += [(expected_others[k, row], named_here[n].xyz_mm) for k, n in enumerate(others) if n in named_here]
        frame = _best_frame(seen, sure)
        if frame is None:
            reason = f"{alike}, and {len(seen)} poses are too few to distinguish them; measure more poses"
            refused |= {one.pose_id: dict.fromkeys(names, reason) for one in seen}
            continue
        for one in seen:
            misfits = one.misfits(frame)
            order = np.argsort(misfits)
            best, second = misfits[order[0]], misfits[order[1]] if len(order) > 1 else np.inf
            if best > _MOST_OFF_SHARE * second:
                reason = (
                    f"{alike}: they are {best:.3g} mm from where the nominal robot predicts them, by another naming "
                    f"{second:.3g} mm; check their xyz_mm in robot.toml, or give them different sizes"
                )
                refused[one.pose_id] = dict.fromkeys(names, reason)
                continue
            way = one.ways[order[0]]
            named[one.pose_id] = {names[t]: places[one.pose_id][k] for k, t in enumerate(way)}
    return named, refused


@dataclass(frozen=True)
class _Seen:
    """Places of equal targets at one pose, and the possible ways to name them."""

    pose_id: str
    xyz_mm: Array  # (S, 3) scanner frame
    expected_mm: Array  # (T, 3) base frame
    ways: IndexArray  # (W, S) which target each place is

    def misfits(self, scanner_T_base: Array) -> Array:
        """RMS distance (W,), mm, of the places from the expected targets, for each possible assignment."""
        there = frames.apply(scanner_T_base, self.expected_mm)
        away = self.xyz_mm[: self.ways.shape[1], None] - there[None]  # (S, T, 3)
        squares = np.einsum("sti,sti->st", away, away)
        return np.sqrt(squares[np.arange(self.ways.shape[1]), self.ways].mean(axis=1))

    def pairs(self, way: IndexArray) -> tuple[Array, Array]:
        """Expected and measured places (S, 3) under one way of naming."""
        return self.expected_mm[way], self.xyz_mm[: len(way)]


def nominal_targets(dataset: Dataset, names: Sequence[str]) -> Array:
    """Nominal positions (T, N, 3) mm of targets at all poses, base frame; NaN where the robot does not define them."""
    robot = dataset.robot
    chain = kinematics.nominal_chain(robot, dataset.poses.q)
    targets_mm = np.full((len(names), len(dataset.poses), 3), np.nan)
    for k, name in enumerate(names):
        if name == "jig":
            targets_mm[k] = kinematics.tool_points(robot, chain)
            continue
        target = next((t for t in robot.targets if t.name == name), None)
        if target is not None and not target.in_world:
            targets_mm[k] = frames.apply(chain.base_T_link(target.joint), np.asarray(target.xyz_mm))
    return targets_mm


def _ways(xyz_mm: Array, expected_mm: Array) -> IndexArray:
    """Index (W, S) of each place's target, for every assignment that agrees with the distances between the targets."""
    count = min(len(xyz_mm), len(expected_mm))
    ways = np.array(list(permutations(range(len(expected_mm)), count)), dtype=np.int64)
    if count < 2:
        return ways
    i, j = np.triu_indices(count, 1)
    apart = np.linalg.norm(xyz_mm[i] - xyz_mm[j], axis=1)
    nominal = np.linalg.norm(expected_mm[ways[:, i]] - expected_mm[ways[:, j]], axis=2)  # (W, pairs)
    agree = np.all(np.abs(nominal - apart) < _PLACED_MM, axis=1)
    return ways[agree] if agree.any() else ways


def _best_frame(seen: Sequence[_Seen], sure: Sequence[tuple[Array, Array]]) -> Array | None:
    """Frame scanner_T_base (4, 4) under which most places have a name; None where too few are seen.

    `sure` are pairs of base and scanner coordinates whose names are certain.
    """
    many = [one for one in seen if one.ways.shape[1] > 1] or (list(seen) if len(sure) >= _LEAST_POSES else [])
    if len(many) < _LEAST_POSES:
        return None
    rng = np.random.default_rng(0)
    judged = many[:: max(1, len(many) // _JUDGED)]
    some = sure[:: max(1, len(sure) // _JUDGED)]
    best, least = np.eye(4), np.inf
    for _ in range(_TRIALS):
        picked = [many[k] for k in rng.choice(len(many), 2, replace=False)]
        pairs = [one.pairs(one.ways[rng.integers(len(one.ways))]) for one in picked]
        frame = _frame_of([*pairs, *((b[None], s[None]) for b, s in some)])
        misfit = float(np.median([one.misfits(frame).min() for one in judged]))
        if misfit < least:
            best, least = frame, misfit
    for _ in range(_ROUNDS):  # all poses, named by the frame before
        pairs = [one.pairs(one.ways[np.argmin(one.misfits(best))]) for one in seen]
        best = _frame_of([*pairs, *((b[None], s[None]) for b, s in sure)])
    return best


def _frame_of(pairs: Sequence[tuple[Array, Array]]) -> Array:
    """Frame scanner_T_base (4, 4) that fits pairs of base and scanner coordinates best."""
    base, scanner = (np.vstack(column) for column in zip(*pairs, strict=True))
    return frames.best_fit_transform(base, scanner)


def _refuse_moved(
    dataset: Dataset, points: dict[str, dict[str, FoundPoint]], refused: dict[str, dict[str, str]]
) -> None:
    """Move to `refused` the places whose distance to other targets is unusual at a pose: foreign objects."""
    joint = {"jig": None} | {target.name: target.joint for target in dataset.robot.targets}
    names = list(dict.fromkeys(n for of in points.values() for n in of))
    if not dataset.robot.carries_scanner:
        names = [n for n in names if n in joint]
    blamed: dict[tuple[str, str], list[str]] = {}
    pairs: dict[str, int] = {}
    for a, b in combinations(names, 2):
        if joint.get(a) != joint.get(b):
            continue
        both = [i for i, of in points.items() if a in of and b in of]
        if len(both) < _LEAST_POSES:
            continue
        apart = np.array([np.linalg.norm(points[i][a].xyz_mm - points[i][b].xyz_mm) for i in both])
        usual = float(np.median(apart))
        for i, distance in zip(both, apart, strict=True):
            slack = _RIGID_MM + _RIGID_SIGMAS * float(np.hypot(points[i][a].sigma_mm(), points[i][b].sigma_mm()))
            pairs[i] = pairs.get(i, 0) + 1
            if abs(distance - usual) > slack:
                text = f"{a} and {b} are {distance:.4g} mm apart, at the other poses {usual:.4g} mm"
                blamed.setdefault((i, a), []).append(text)
                blamed.setdefault((i, b), []).append(text)
    for (i, name), texts in blamed.items():
        most = max(len(t) for (j, _), t in blamed.items() if j == i)
        if len(texts) == most:  # of three, the one that disagrees with both others
            points[i].pop(name, None)
            reason = f"{texts[0]}: one of them is something else; look at the scan"
            refused.setdefault(i, {})[name] = reason
