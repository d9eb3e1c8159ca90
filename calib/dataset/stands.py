"""Stands: the measurements of one standing of the arm, at the same joint values under the same conditions.

Several shots of one stand share whatever a model of the arm lacks, so they are one observation of it, not several. A
fit takes their mean; their scatter tells the noise (`calib.dataset.repeats`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.dataset.dataset import Dataset, Orientations, Points, Poses
from calib.distributions import chi2_sf

SAME_JOINT = 1e-6  # deg, or mm of a prismatic joint: joint values that differ by less are the same
SAME_TEMPERATURE_C = 0.2  # what a reading of the arm's temperature is good for
SIGMA_DOUBT = 1.25  # a sigma that was declared, not measured, is believed to this factor
_TIME_MATTERS = 0.01  # p below which visits of one place differ by more than noise
SAME_DIGITS = 9  # behind the point, of mm: coordinates that agree in them were copied
_NAMED = 5  # poses in a warning


def stand_of(poses: Poses) -> IndexArray:
    """(N,) the number of each pose's stand: equal joints, setup, payload and approach, and temperature."""
    revolute_or_not = np.degrees(poses.q)  # of a slide this only makes the comparison stricter
    columns = [_levels(values, SAME_JOINT) for values in revolute_or_not.T]
    columns.append(np.unique(poses.setup, return_inverse=True)[1])
    if poses.payload_kg is not None:
        columns.append(_levels(poses.payload_kg, 1e-9))
    if poses.approach is not None:
        columns += [_levels(values, 0.5) for values in poses.approach.T]
    alike = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1)
    if poses.temperature_c is None:
        return np.asarray(alike)
    return _within(alike, poses.temperature_c, SAME_TEMPERATURE_C)


def _levels(values: Array, same: float) -> IndexArray:
    """(N,) ranks of values, those that follow each other by no more than `same` alike."""
    order = np.argsort(values, kind="stable")
    out = np.empty(len(values), dtype=np.int64)
    out[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > same)])
    return out


def _within(group: IndexArray, values: Array, width: float) -> IndexArray:
    """(N,) groups divided so that values of one part lie within `width` of its smallest."""
    order = np.lexsort((values, group))
    out = np.empty(len(group), dtype=np.int64)
    part, last, start = -1, -1, 0.0
    for i in order:
        if group[i] != last or not values[i] - start <= width:
            part, last, start = part + 1, group[i], values[i]
        out[i] = part
    return out


def stands_of(dataset: Dataset) -> IndexArray:
    """(N,) as `stand_of`; where times are known and visits of one place differ beyond noise, each visit is a stand.

    A place that is measured again later shows what time does to arm and scanner: its visits are kept apart only where
    they show it, else they share what the model lacks as the shots of one visit do.
    """
    stand = stand_of(dataset.poses)
    time_s = dataset.poses.time_s
    if time_s is None or dataset.points is None:
        return stand
    order = np.lexsort((np.arange(len(stand)), time_s))
    visit = np.empty(len(stand), dtype=np.int64)
    visit[order] = np.concatenate([[0], np.cumsum(np.diff(stand[order]) != 0)])
    return visit if _visits_differ(dataset, stand, visit) else stand


def _visits_differ(dataset: Dataset, stand: IndexArray, visit: IndexArray) -> bool:
    """Whether means of visits to one place differ by more than the declared noise; False where none is declared.

    chi^2 of visit means about the mean of their place.
    """
    points, sigma_mm = dataset.points, dataset.scanner.point_sigma_mm
    assert points is not None
    if points.covariance_mm2 is not None:
        sigma2 = np.trace(points.covariance_mm2, axis1=1, axis2=2) / 3.0
    elif sigma_mm is not None:
        sigma2 = np.full(len(points), sigma_mm**2)
    else:
        return False
    target = np.unique(points.target, return_inverse=True)[1]
    keys, of_visit, shots = np.unique(
        np.column_stack([visit[points.pose], stand[points.pose], target]),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    place, of_place = np.unique(keys[:, 1:], axis=0, return_inverse=True)
    freedom = 3 * (len(keys) - len(place))
    if freedom == 0:
        return False
    mean_mm = _sums(points.xyz_mm, of_visit.reshape(-1), len(keys)) / shots[:, None]
    of_place = of_place.reshape(-1)
    weight = _sums(sigma2, of_visit.reshape(-1), len(keys)) ** -1.0 * shots**2
    centre_mm = _sums(weight[:, None] * mean_mm, of_place, len(place)) / _sums(weight, of_place, len(place))[:, None]
    square = float(np.sum(weight * np.sum((mean_mm - centre_mm[of_place]) ** 2, axis=1)))
    return chi2_sf(square / SIGMA_DOUBT**2, freedom) < _TIME_MATTERS


def _sums(values: Array, group: IndexArray, groups: int) -> Array:
    """Sums over each group, (M, ...) -> (G, ...)."""
    total = np.zeros((groups, *values.shape[1:]))
    np.add.at(total, group, values)
    return total


def on_stands(dataset: Dataset) -> Dataset:
    """The dataset with one point for each stand and target: the mean of its shots, at the stand's first pose.

    The dataset itself where no stand has several shots. Poses keep their numbers; those of further shots have no point.
    A mean of k shots counts as k measurements, but not as more than the median stand has: what the model lacks is not
    averaged away. Training and test shots of one stand are averaged apart, and a warning says so.
    """
    points, poses = dataset.points, dataset.poses
    if points is None or not len(points):
        return dataset
    stand = stands_of(dataset)
    sides = np.unique(np.column_stack([stand, poses.is_test]), axis=0, return_inverse=True)[1].reshape(-1)
    measured = np.unique(points.pose)
    if len(np.unique(sides[measured])) == len(measured) == len(points):
        return dataset  # the usual case at once
    target = np.unique(points.target, return_inverse=True)[1]
    key = np.column_stack([sides[points.pose], target])
    first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)[1:]
    if len(first) == len(points) and len(np.unique(sides[measured])) == len(measured):
        return dataset  # several targets, each once
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    averaged = _mean_points(points, rank[group.reshape(-1)], first[order])
    at = _first_poses(poses, sides, measured)
    averaged = replace(averaged, pose=at[averaged.pose])
    return replace(
        dataset,
        poses=_mean_conditions(poses, sides, measured, at),
        points=averaged,
        warnings=(*dataset.warnings, *_warnings(poses, stand, measured)),
        notes=(*dataset.notes, _note(ShotCount.of(dataset))),
    )


def _first_poses(poses: Poses, sides: IndexArray, measured: IndexArray) -> IndexArray:
    """(N,) for each pose the one that stands for its stand: the reference pose, else the first that was measured."""
    out = np.arange(len(poses))
    by_first = {int(sides[i]): int(i) for i in measured[::-1]}
    if poses.reference in measured:
        by_first[int(sides[poses.reference])] = poses.reference
    for i in measured:
        out[i] = by_first[int(sides[i])]
    return out


def _mean_points(points: Points, group: IndexArray, first: IndexArray) -> Points:
    """The means of groups of points; `first` (G,) is a point of each."""
    covariance = points.covariance_mm2
    # A row that was written twice tells nothing of the noise, and is no second measurement.
    keys = np.column_stack([group, np.round(points.xyz_mm, SAME_DIGITS)])
    different = np.sort(np.unique(keys, axis=0, return_index=True)[1])
    measured = np.bincount(group[different], minlength=len(first))
    mean_mm = _sums(points.xyz_mm[different], group[different], len(first)) / measured[:, None]
    counts_as = np.minimum(measured, max(int(np.median(measured)), 1)).astype(float)
    return Points(
        pose=points.pose[first],
        xyz_mm=mean_mm,
        target=points.target[first],
        covariance_mm2=None if covariance is None else _means(covariance, group, len(first)),
        orientations=_mean_orientations(points.orientations, group, counts_as),
        counts_as=counts_as,
    )


def _means(values: Array, group: IndexArray, groups: int, used: BoolArray | None = None) -> Array:
    """Means over each group of the rows that are `used` (M,), all where None; nan where a group has none."""
    used = np.ones(len(group), dtype=bool) if used is None else used
    count = np.bincount(group[used], minlength=groups).astype(float)
    count[count == 0.0] = np.nan
    return _sums(values[used], group[used], groups) / count.reshape(-1, *[1] * (values.ndim - 1))


def _mean_orientations(given: Orientations | None, group: IndexArray, counts_as: Array) -> Orientations | None:
    """The rotation nearest to the sum (chordal mean) of the shots whose orientation is known; counts_as  # (G,)"""
    if given is None:
        return None
    known, groups = given.known, len(counts_as)
    total = _means(given.scanner_R_jig, group, groups, known)
    mean = np.full_like(total, np.nan)
    there = np.isfinite(total).all(axis=(1, 2))
    number = np.bincount(group[known], minlength=groups)
    u, _, vt = np.linalg.svd(total[there])
    u[..., -1] *= np.linalg.det(u @ vt)[:, None]
    mean[there] = u @ vt
    mean[number == 1] = total[number == 1]  # bit for bit
    covariance, cross = given.covariance_rad2, given.cross_mm_rad
    if covariance is not None:  # of fewer shots than the point's where some have no orientation
        fewer = counts_as / np.clip(number, 1, counts_as)
        covariance = fewer[:, None, None] * _means(covariance, group, groups, known)
    return replace(
        given,
        scanner_R_jig=mean,
        covariance_rad2=covariance,
        cross_mm_rad=None if cross is None else _means(cross, group, groups, known),
    )


def _mean_conditions(poses: Poses, sides: IndexArray, measured: IndexArray, at: IndexArray) -> Poses:
    """The poses, each that stands for a stand with the mean temperature and time of its shots."""

    def mean(values: Array | None) -> Array | None:
        if values is None:
            return None
        out = np.array(values, dtype=float)
        means = _means(out[measured], sides[measured], int(sides.max()) + 1)
        several = measured[np.bincount(sides[measured])[sides[measured]] > 1]
        out[at[several]] = means[sides[several]]
        return out

    return replace(poses, temperature_c=mean(poses.temperature_c), time_s=mean(poses.time_s))


@dataclass(frozen=True)
class ShotCount:
    """How many points were measured at how many standing poses."""

    stands: int
    shots: int

    @classmethod
    def of(cls, dataset: Dataset) -> ShotCount:
        """The number of repeat groups and of repeats in a dataset with points."""
        assert dataset.points is not None
        return cls(len(np.unique(stands_of(dataset)[dataset.points.pose])), len(dataset.points))


def _note(count: ShotCount) -> str:
    return (
        f"{count.shots} points were measured at {count.stands} standing poses: each standing pose counts once, by the "
        "mean of its shots"
    )


def _warnings(poses: Poses, stand: IndexArray, measured: IndexArray) -> tuple[str, ...]:
    is_test = poses.is_test[measured]
    both = np.intersect1d(stand[measured[is_test]], stand[measured[~is_test]])
    if not len(both):
        return ()
    ids = [poses.ids[int(np.flatnonzero(stand == s)[0])] for s in both[:_NAMED]]
    more = " ..." if len(both) > _NAMED else ""
    return (
        f"standing poses with shots for training and for test: {len(both)}, {', '.join(ids)}{more}; their test error "
        "is no prediction: give all shots of one standing pose one role",
    )


def without_poses(dataset: Dataset, pose_ids: Sequence[str]) -> Dataset:
    """The dataset without the measured points of some poses and of their stands; the poses themselves stay."""
    assert dataset.points is not None
    gone = [dataset.poses.ids[i] for i in np.flatnonzero(of_stands(dataset, pose_ids))]
    left_out = tuple(dict.fromkeys([*dataset.left_out, *gone]))
    return replace(dataset, left_out=left_out).with_points(dataset.points)


def of_stands(dataset: Dataset, pose_ids: Sequence[str]) -> BoolArray:
    """(N,) which poses are these, or stand as one of them does."""
    stand = stands_of(dataset)
    return np.isin(stand, stand[[dataset.poses.index(pose_id) for pose_id in pose_ids]])
