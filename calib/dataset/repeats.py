"""Repeats: several measurements at the same joint values under the same conditions, which form a repeat group.

The repeats of one group share whatever a model of the arm lacks, so a fit takes their mean as one observation
(`average_repeats`). Their scatter measures the instrument's repeatability (`find_repeats`; Jang 2025, Table 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray, IndexArray
from calib.dataset.dataset import Dataset, Orientations, Points, Poses
from calib.dataset.further_columns import FurtherColumns, is_number
from calib.dataset.signals import is_signal, joints_of_other_bodies, named_temperatures
from calib.lazy_modules import pd
from calib.rendering import numbers
from calib.statistics import axis_variances, chi2_sf, group_means, group_numbers, group_sums, ranks

SAME_JOINT = 1e-6  # deg, or mm of a prismatic joint: joint values that differ by less are the same
SAME_TEMPERATURE_C = 0.2  # accuracy of a reading of the arm's temperature
SIGMA_DOUBT = 1.25  # a sigma that was declared, not measured, is taken as accurate to this factor
_TIME_MATTERS = 0.01  # p below which visits of one place differ by more than noise
SAME_DIGITS = 9  # decimals of mm: coordinates that agree in all of them were copied
_MOST_NAMED = 5  # poses named in a warning


def groups_by_condition(poses: Poses) -> IndexArray:
    """Number (N,) of each pose's group: equal joints of all bodies, setup, payload, approach and temperatures."""
    q_deg = np.degrees(poses.q)  # for a prismatic joint this only makes the comparison stricter
    columns = [ranks(values, SAME_JOINT) for values in q_deg.T]
    columns.append(group_numbers(poses.setup))
    if poses.payload_kg is not None:
        columns.append(ranks(poses.payload_kg, 1e-9))
    if poses.approach is not None:
        columns += [ranks(values, 0.5) for values in poses.approach.T]
    columns += [ranks(values, SAME_JOINT) for values in joints_of_other_bodies(poses).values()]
    alike = np.asarray(group_numbers(np.column_stack(columns)))
    own = [] if poses.temperature_c is None else [poses.temperature_c]
    for temperature_c in (*own, *named_temperatures(poses).values()):
        alike = _split_by_temperature(alike, temperature_c)
    return alike


def _split_by_temperature(group: IndexArray, temperature_c: Array) -> IndexArray:
    """Numbers (N,) of groups divided further, so that each part is of one temperature within `SAME_TEMPERATURE_C`."""
    order = np.lexsort((temperature_c, group))
    parts = np.empty(len(group), dtype=np.int64)
    part, last, start = -1, -1, 0.0
    for i in order:
        if group[i] != last or not temperature_c[i] - start <= SAME_TEMPERATURE_C:
            part, last, start = part + 1, group[i], temperature_c[i]
        parts[i] = part
    return parts


def repeat_groups(dataset: Dataset) -> IndexArray:
    """Number (N,) of each pose's repeat group, poses with equal joints and conditions (`groups_by_condition`).

    Where times are known and later visits to the same joint values differ beyond the declared noise (the arm or scanner
    has drifted), each visit is a group of its own.
    """
    group = groups_by_condition(dataset.poses)
    time_s = dataset.poses.time_s
    if time_s is None or dataset.points is None or dataset.points.lengths is not None:
        return group
    order = np.lexsort((np.arange(len(group)), time_s))
    visit = np.empty(len(group), dtype=np.int64)
    visit[order] = np.concatenate([[0], np.cumsum(np.diff(group[order]) != 0)])
    return visit if _visits_differ(dataset, group, visit) else group


def _visits_differ(dataset: Dataset, group: IndexArray, visit: IndexArray) -> bool:
    """Whether the mean points of separate visits to one repeat group differ by more than the declared noise.

    False where no noise is declared. Tested by chi^2 of the visits' means about the mean of their group and target.
    """
    points, sigma_mm = dataset.points, dataset.scanner.point_sigma_mm
    assert points is not None
    if points.covariance_mm2 is not None:
        sigma2 = axis_variances(points.covariance_mm2)
    elif sigma_mm is not None:
        sigma2 = np.full(len(points), sigma_mm**2)
    else:
        return False
    target = group_numbers(points.target)
    keys, of_visit, repeats = np.unique(
        np.column_stack([visit[points.pose], group[points.pose], target]),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    place, of_place = np.unique(keys[:, 1:], axis=0, return_inverse=True)
    dof = 3 * (len(keys) - len(place))
    if dof == 0:
        return False
    mean_mm = group_sums(points.xyz_mm, of_visit.reshape(-1), len(keys)) / repeats[:, None]
    of_place = of_place.reshape(-1)
    weight = group_sums(sigma2, of_visit.reshape(-1), len(keys)) ** -1.0 * repeats**2
    centre_mm = (
        group_sums(weight[:, None] * mean_mm, of_place, len(place)) / group_sums(weight, of_place, len(place))[:, None]
    )
    square = float(np.sum(weight * np.sum((mean_mm - centre_mm[of_place]) ** 2, axis=1)))
    return chi2_sf(square / SIGMA_DOUBT**2, dof) < _TIME_MATTERS


def average_repeats(dataset: Dataset) -> Dataset:
    """The dataset with one point for each repeat group and target: the mean of the repeats, at the group's first pose.

    The dataset itself where no group has several repeats. Poses keep their numbers; those of further repeats have no
    point. A mean of k repeats counts as k measurements, but not as more than the median group has: the error of an
    incomplete model is not averaged away. Training and test repeats of one group are averaged apart, with a warning.
    """
    points, poses = dataset.points, dataset.poses
    if points is None or not len(points) or points.lengths is not None:
        return dataset
    all_groups = repeat_groups(dataset)
    sides = group_numbers(np.column_stack([all_groups, poses.is_test]))
    measured = np.unique(points.pose)
    if len(np.unique(sides[measured])) == len(measured) == len(points):
        return dataset  # the usual case at once
    target = group_numbers(points.target)
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
        warnings=(*dataset.warnings, *_warnings(poses, all_groups, measured)),
        notes=(*dataset.notes, RepeatCount.of(dataset).note),
    )


def _first_poses(poses: Poses, sides: IndexArray, measured: IndexArray) -> IndexArray:
    """Index (N,) of the pose that represents each pose's repeat group: the reference pose, else the first measured."""
    representative = np.arange(len(poses))
    by_first = {int(sides[i]): int(i) for i in measured[::-1]}
    if poses.reference in measured:
        by_first[int(sides[poses.reference])] = poses.reference
    for i in measured:
        representative[i] = by_first[int(sides[i])]
    return representative


def _mean_points(points: Points, group: IndexArray, first: IndexArray) -> Points:
    """Means of G groups of points, `group` (M,) the number of each point's group and `first` (G,) one point of each."""
    covariance = points.covariance_mm2
    # A row that was written twice is no second measurement and carries no information on the noise.
    keys = np.column_stack([group, np.round(points.xyz_mm, SAME_DIGITS)])
    different = np.sort(np.unique(keys, axis=0, return_index=True)[1])
    weights = np.ones(len(different)) if points.counts_as is None else points.counts_as[different]
    measured = group_sums(weights, group[different], len(first))
    weighed_mm = weights[:, None] * points.xyz_mm[different]
    mean_mm = group_sums(weighed_mm, group[different], len(first)) / measured[:, None]
    counts_as = np.minimum(measured, max(float(np.floor(np.median(measured))), 1.0))
    return Points(
        pose=points.pose[first],
        xyz_mm=mean_mm,
        target=points.target[first],
        covariance_mm2=None if covariance is None else group_means(covariance, group, len(first)),
        orientations=_mean_orientations(points.orientations, group, counts_as),
        counts_as=counts_as,
        shared=None if points.shared is None else group_means(points.shared, group, len(first)),
        shared_found=points.shared_found,
    )


def _mean_orientations(orientations: Orientations | None, group: IndexArray, counts_as: Array) -> Orientations | None:
    """Chordal mean (rotation nearest to the sum) of each group's known orientations; `counts_as` (G,): repeats."""
    if orientations is None:
        return None
    known, groups = orientations.known, len(counts_as)
    total = group_means(orientations.scanner_R_jig[known], group[known], groups, empty=np.nan)
    mean = np.full_like(total, np.nan)
    there = np.isfinite(total).all(axis=(1, 2))
    number = np.bincount(group[known], minlength=groups)
    u, _, vt = np.linalg.svd(total[there])
    u[..., -1] *= np.linalg.det(u @ vt)[:, None]
    mean[there] = u @ vt
    mean[number == 1] = total[number == 1]  # bit for bit
    covariance, cross = orientations.covariance_rad2, orientations.cross_mm_rad
    if covariance is not None:  # from fewer repeats than the point's where some have no orientation
        fewer = counts_as / np.clip(number, 1, counts_as)
        covariance = fewer[:, None, None] * group_means(covariance[known], group[known], groups, empty=np.nan)
    return replace(
        orientations,
        scanner_R_jig=mean,
        covariance_rad2=covariance,
        cross_mm_rad=None if cross is None else group_means(cross[known], group[known], groups, empty=np.nan),
    )


def _mean_conditions(poses: Poses, sides: IndexArray, measured: IndexArray, at: IndexArray) -> Poses:
    """The poses, with the mean temperature, time and signals of the repeats at each pose that stands for its group."""

    def mean(values: Array | None) -> Array | None:
        if values is None:
            return None
        averaged = np.array(values, dtype=float)
        means = group_means(averaged[measured], sides[measured], int(sides.max()) + 1, empty=np.nan)
        several = measured[np.bincount(sides[measured])[sides[measured]] > 1]
        averaged[at[several]] = means[sides[several]]
        return averaged

    further = {
        name: mean(column) if is_signal(name) and is_number(column) else column
        for name, column in poses.extra.by_name.items()
    }
    return replace(
        poses,
        temperature_c=mean(poses.temperature_c),
        time_s=mean(poses.time_s),
        extra=FurtherColumns({name: column for name, column in further.items() if column is not None}),
    )


@dataclass(frozen=True)
class RepeatCount:
    """Number of measured points and of the repeat groups that they form."""

    groups: int
    repeats: int

    @classmethod
    def of(cls, dataset: Dataset) -> RepeatCount:
        """The number of repeat groups and of repeats in a dataset with points."""
        assert dataset.points is not None
        return cls(len(np.unique(repeat_groups(dataset)[dataset.points.pose])), len(dataset.points))

    @property
    def note(self) -> str:
        """Sentence with the numbers of measured points and repeat groups, which says that repeats are averaged."""
        return (
            f"{self.repeats} points were measured in {self.groups} repeat groups of equal joints and conditions: each "
            "group counts once, by the mean of its repeats"
        )


def _warnings(poses: Poses, group: IndexArray, measured: IndexArray) -> tuple[str, ...]:
    """A warning where training and test poses are repeats of one group; () where none are."""
    is_test = poses.is_test[measured]
    both = np.intersect1d(group[measured[is_test]], group[measured[~is_test]])
    if not len(both):
        return ()
    ids = [poses.ids[int(np.flatnonzero(group == g)[0])] for g in both]
    return (
        f"repeat groups with both training and test poses: {len(both)}, {numbers.in_short(ids, _MOST_NAMED)}; "
        "their test error is no prediction: give all repeats of one group the same role",
    )


def without_poses(dataset: Dataset, pose_ids: Sequence[str]) -> Dataset:
    """The dataset without the measured points of the given poses and all their repeats; the poses themselves stay."""
    assert dataset.points is not None
    gone = [dataset.poses.ids[i] for i in np.flatnonzero(in_repeat_groups_of(dataset, pose_ids))]
    left_out = tuple(dict.fromkeys([*dataset.left_out, *gone]))
    return replace(dataset, left_out=left_out).with_points(dataset.points)


def in_repeat_groups_of(dataset: Dataset, pose_ids: Sequence[str]) -> BoolArray:
    """Mask (N,) of the named poses and of all poses in the same repeat groups."""
    group = repeat_groups(dataset)
    return np.isin(group, group[[dataset.poses.index(pose_id) for pose_id in pose_ids]])


@dataclass(frozen=True)
class Repeats:
    """Mean and scatter of several measurements of one place."""

    label: str
    count: int
    mean_mm: Array  # (3,)
    sigma_mm: Array  # (3,) sample standard deviation of each axis
    offset_mm: float | None  # length of mean minus reference point, Jang's position error; None without one


def repeats_of(label: str, xyz_mm: ArrayLike, reference_mm: ArrayLike | None = None) -> Repeats:
    """Mean, standard deviation and position error of measurements (R, 3) of one place, mm."""
    xyz = np.asarray(xyz_mm, dtype=float)
    mean = xyz.mean(axis=0)
    offset = None if reference_mm is None else float(np.linalg.norm(mean - np.asarray(reference_mm)))
    return Repeats(label, len(xyz), mean, xyz.std(axis=0, ddof=1), offset)


def find_repeats(dataset: Dataset) -> tuple[Repeats, ...]:
    """Mean and scatter of every repeat group in which a target was measured more than once."""
    points, poses = dataset.points, dataset.poses
    if points is None or points.lengths is not None:
        return ()
    return tuple(
        repeats_of(poses.ids[points.pose[rows[0]]], points.xyz_mm[rows]) for rows in _repeated_rows(dataset, points)
    )


def _repeated_rows(dataset: Dataset, points: Points) -> list[list[int]]:
    """Row numbers of the points of each repeat group and target that has more than one.

    A row with another's coordinates to the last digit was copied: it is no measurement, and is left out.
    """
    group = repeat_groups(dataset)
    keys: dict[tuple[int, str], list[int]] = {}
    for row, pose in enumerate(points.pose):
        keys.setdefault((int(group[pose]), str(points.target[row])), []).append(row)
    different = (_different(points.xyz_mm, rows) for rows in keys.values() if len(rows) > 1)
    return [rows for rows in different if len(rows) > 1]


def _different(xyz_mm: Array, rows: Sequence[int]) -> list[int]:
    """The given rows, without those whose coordinates equal an earlier row's."""
    first = np.unique(np.round(xyz_mm[rows], SAME_DIGITS), axis=0, return_index=True)[1]
    return [rows[k] for k in np.sort(first)]


@dataclass(frozen=True)
class ScatterOfRepeats:
    """Scatter of repeats relative to the covariances that are declared for the points."""

    ratio: float  # of standard deviations; 1 where the covariances describe what changes between repeats
    dof: int
    p_value: float  # of a ratio this large where the covariances are right


def scatter_against_covariances(dataset: Dataset) -> ScatterOfRepeats | None:
    """Chi-squared test of repeats against their points' covariances C; None without repeats or covariances.

    In each group sum (x_i - m) . C_i^-1 (x_i - m) about the weighted mean m is chi-squared of 3 (n - 1) degrees of
    freedom where the covariances are right. Errors common to all repeats of a group do not show.
    """
    points = dataset.points
    if points is None or points.covariance_mm2 is None:
        return None
    squared, dof = 0.0, 0
    for rows in _repeated_rows(dataset, points):
        xyz, covariance = points.xyz_mm[rows], points.covariance_mm2[rows]
        if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance).min() <= 0:
            continue
        weight = np.linalg.inv(covariance)
        mean = np.linalg.solve(weight.sum(axis=0), np.einsum("nij,nj->i", weight, xyz))
        squared += float(np.einsum("ni,nij,nj->", xyz - mean, weight, xyz - mean))
        dof += 3 * (len(rows) - 1)
    if not dof:
        return None
    return ScatterOfRepeats(float(np.sqrt(squared / dof)), dof, chi2_sf(squared, dof))


def pooled_sigma_mm(repeats: Sequence[Repeats]) -> float:
    """Standard deviation per coordinate, mm, pooled over all places: sqrt(sum (n_i - 1) s_i^2 / sum 3 (n_i - 1))."""
    dof = sum(3 * (r.count - 1) for r in repeats)
    return float(np.sqrt(sum((r.count - 1) * float(r.sigma_mm @ r.sigma_mm) for r in repeats) / dof))


def repeats_frame(repeats: Sequence[Repeats]) -> pd.DataFrame:
    """Table of repeatability with the columns of Jang 2025, Table 1, one row per place."""
    return pd.DataFrame(
        {
            "place": [r.label for r in repeats],
            "measured": [r.count for r in repeats],
            **{f"sigma_{axis}_mm": [float(r.sigma_mm[k]) for r in repeats] for k, axis in enumerate("xyz")},
            "position_error_mm": [float("nan") if r.offset_mm is None else r.offset_mm for r in repeats],
        }
    )
