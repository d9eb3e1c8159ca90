"""A recording as one row a pose: where the arm stands, its joints and the measured point are averaged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.array_types import Array, BoolArray
from calib.consistency.agreement import misfit_mm, sample_of
from calib.dataset_import.columns import AS_MAPPED, Column, Meaning
from calib.dataset_import.markers import spread_of
from calib.dataset_import.plan import ImportSources
from calib.dataset_import.units import joint_units, length_unit
from calib.errors import DatasetError, visible
from calib.extras.logs.bags import is_bag, read_bag
from calib.extras.logs.chosen_series import arm_joints, measured_points, shown
from calib.extras.logs.clocks import offset_of_single_points, possible_offsets, settled_offset
from calib.extras.logs.import_source import is_recorded
from calib.extras.logs.means import Means, means_of
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, recording_file
from calib.extras.logs.standstill import LEAST_S, Standstill, approach_of, settled, standstill_of
from calib.extras.logs.table_logs import has_time, is_log, read_table_log
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.statistics import mad_sigmas, rms
from calib.text_files.column_names import ANGLES_RAD, LENGTHS_MM, split_unit
from calib.text_files.records import table_file
from calib.text_files.user_table import UserTable

_ONE_CLOCK_S = 10.0  # at most, by which clocks differ within one file
_SAME_S = 5e-3  # by which clocks of one file may seem to differ
_MARGIN_S = 0.1  # at both ends of a phase, in which points are not used
_DENSE = 5.0  # points a phase, from which their motion is recorded, too
_PATH_STEP_S = 0.01  # between the joints at which the tool's path is computed
_MOVED = 1e-3  # rad, or 0.1 mm, that a joint moves at least to come from a side
_MOVES = 0.02  # of the points' spread, by which they scatter in the stops where they are of other times
_NAMED = 8  # names or times that a sentence names
_FEW = 12  # poses, with which none is given up for its approach
_COMPUTED_MM = 1e-4  # misfit to the nominal arm, below which points were computed and not measured
_UNEVEN = 2.0  # ratio of the largest variance of a stop's point to the least, from which they weigh by it


def is_recording(path: Path | None, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a path is a log by time, and no table of poses, as a mapping of its time to `ignore` says."""
    if path is None:
        return False
    file, _ = recording_file(path)
    with suppress(DatasetError, OSError):
        return is_recorded(file) or (table_file(file)[0].is_file() and is_log(file, mapping))
    return False


def with_recorded_poses(sources: ImportSources) -> ImportSources:
    """Sources with tables in place of recordings, a row a pose at which the arm stood.

    A table of points without times is left as it is, its rows are of a pose each.

    Raises:
        RecordingError: no joints, no points, no standing phases, or clocks that cannot be set.
    """
    joints = sources.joints
    assert joints is not None
    robot, mapping = sources.robots[0].robot.robot, sources.mapping
    file, topic = recording_file(joints)
    read = _read(file, robot, mapping)
    notes, doubts = list(read.notes), list[str]()
    series, columns = arm_joints(file, read, topic, robot, mapping, notes)
    arm = _StoppedArm(robot, file, series, columns, _standstill(file, series), notes, doubts)
    notes.append(arm.told)
    other, wanted = (file, "") if sources.points is None else recording_file(sources.points)
    tables: dict[Path, UserTable] = {}
    if _has_time(other):
        is_same = other.resolve() == file.resolve()
        of_points = read if is_same else _read(other, robot, mapping)
        notes += [] if is_same else of_points.notes
        seen, offset_s = arm.its_point(other, measured_points(other, of_points, wanted, notes, doubts), is_same)
        path = sources.points or file.with_name(f"{file.name} (points)")
        kept, tables[path] = arm.kept_points(path, shown(other, seen), seen, offset_s, sources.point_sigma_mm)
        sources = replace(sources, points=path)
    else:
        kept = np.ones(len(arm.rest.phases), dtype=bool)
    tables[joints] = arm.table(joints, kept)
    return replace(
        sources, tables=tables, notes=tuple(notes), doubts=tuple(doubts), mapping=_mapped(mapping, columns),
        joint_unit_is_unknown=read.unit_is_unknown,
    )  # fmt: skip


def _read(file: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    return read_bag(file) if is_bag(file) else read_table_log(file, robot, mapping)


def _has_time(path: Path) -> bool:
    with suppress(DatasetError, OSError):
        return is_recorded(path) or has_time(path)
    return False


def _mapped(mapping: Mapping[str, Meaning], columns: Sequence[Column]) -> dict[str, Meaning]:
    """Mapping with the joints' columns under the names that they have in the table."""
    of_joints = {column.name for column in columns}
    kept = {k: m for k, m in mapping.items() if k not in of_joints and not m.name.startswith(("q", "time_s"))}
    return kept | {
        _name(column): Meaning(f"q{k + 1}", column.unit, column.sign, column.offset, column.others)
        for k, column in enumerate(columns)
        if column.why == AS_MAPPED
    }


def _name(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit and not split_unit(column.name)[1] else column.name


def _standstill(file: Path, series: JointSeries) -> Standstill:
    try:
        return standstill_of(str(file), series.time_s, series.values)
    except RecordingError as error:
        if is_recorded(file):
            raise
        raise RecordingError(
            f"{error}; where its rows are poses, say so by --map with its column of time =ignore"
        ) from None


@dataclass(frozen=True)
class _StoppedArm:
    """An arm's joints by time with its K standing phases; what is found of it is told in notes and doubts."""

    robot: Robot
    file: Path
    series: JointSeries
    columns: list[Column]  # of the joints, in order
    rest: Standstill
    notes: list[str]
    doubts: list[str]

    @cached_property
    def spans_s(self) -> Array:
        """Times (K, 2) at which the phases begin and end."""
        return self.series.time_s[[(phase.start, phase.stop - 1) for phase in self.rest.phases]]

    @property
    def told(self) -> str:
        """How the joints were recorded, and how often and for how long the arm stands."""
        series, rest, spans = self.series, self.rest, np.diff(self.spans_s)
        brief = f"; {rest.brief} shorter than {LEAST_S:g} s are left out" if rest.brief else ""
        return (
            f"{self.file}: {len(series)} joint states of {series.source} in {np.ptp(series.time_s):.1f} s "
            f"({1.0 / np.median(np.diff(series.time_s)):.0f} Hz); the arm stands {len(spans)} times, for "
            f"{spans.min():.1f} to {spans.max():.1f} s{brief}"
        )

    @cached_property
    def q(self) -> Array:
        """Joint values (N, n), rad and mm, for the path of the tool; units that are not told are guessed by size."""
        units, _ = joint_units(self.robot, self.series.values, [column.unit for column in self.columns], None)
        scale = [(ANGLES_RAD | LENGTHS_MM)[unit] for unit in units]
        sign, offset = np.array([(column.sign, column.offset) for column in self.columns]).T
        return (sign * self.series.values + offset) * scale

    @cached_property
    def mean_q(self) -> Array:
        """Joint values (K, n) of each phase."""
        return self._mean(self.q)

    @cached_property
    def sides(self) -> Array:
        """Direction (K, n) from which each joint came to each phase, 1 or -1; 0 where it had not moved before.

        A joint that always comes from one side came so to the first phase, too.
        """
        least = np.where(self.robot.is_revolute, _MOVED, 100.0 * _MOVED)
        phases = zip(self.rest.phases, self.mean_q, strict=True)
        sides = np.array([approach_of(self.q, phase.start, mean, least) for phase, mean in phases])
        total = sides.sum(axis=0)
        only = np.where(np.abs(total) == np.abs(sides).sum(axis=0), np.sign(total), 0.0)
        return np.where(sides == 0.0, only, sides) * [column.sign for column in self.columns]

    def _mean(self, values: Array) -> Array:
        """Means (K, ...) over the phases, outlying rows left out, within which points are used."""
        rows = np.searchsorted(self.series.time_s, self._inner_s, "right")
        phases = zip(self.rest.phases, rows, strict=True)
        return means_of([values[first:last] if last > first else values[phase] for phase, (first, last) in phases]).mean

    @cached_property
    def _inner_s(self) -> Array:
        """Times (K, 2) of the phases without the margins in which points are not used."""
        margin = np.minimum(_MARGIN_S, 0.25 * np.diff(self.spans_s)[:, 0])
        return self.spans_s + np.outer(margin, [1.0, -1.0])

    # ---- points ------------------------------------------------------------------------------------------------------

    def its_point(self, file: Path, seen: Sequence[PointSeries], is_same: bool) -> tuple[PointSeries, float]:
        """First of several points that moves as the arm does, and its clock's offset, s.

        is_same: whether the points are of the joints' own recording. Raises RecordingError where none moves so.
        """
        errors: list[RecordingError] = []
        for each in seen:
            try:
                offset_s = self._offset_s(each, shown(file, each), is_same)
            except RecordingError as error:
                errors.append(error)
                continue
            others = [visible(other.name) for other in seen if other is not each]
            if others:
                self.notes.append(
                    f"{file}: {visible(each.name)} is the measured point, of those that move as the arm does the one "
                    f"seen most often; left out: {numbers.in_short(others, _NAMED)}; one of these by --points "
                    f"'{file}#{others[0]}'"
                )
            return each, offset_s
        raise errors[0]

    def _offset_s(self, seen: PointSeries, name: str, is_same: bool) -> float:
        """Time of the points' clock less that of the joints'. Raises RecordingError where it is ambiguous."""
        joint_s, (starts_s, ends_s), names = self.series.time_s, self.spans_s.T, (self.series.source, name)
        if len(seen) < _DENSE * len(starts_s) or np.median(np.diff(seen.time_s)) > 1.0:
            offset_s = offset_of_single_points(names, starts_s, ends_s, seen.time_s)
            self.notes.append(
                f"{name}: single points; offset of their clock to the joints': "
                f"{f'{offset_s:.3f} s' if offset_s else 'as recorded'}, by which they fall into stops"
            )
            return offset_s
        step = max(1, round(_PATH_STEP_S / float(np.median(np.diff(joint_s)))))
        path = (joint_s[::step], target_points(self.robot, self.q[::step]), seen.time_s, seen.xyz)
        possible = possible_offsets(*path, _ONE_CLOCK_S) if is_same else []
        possible = possible or possible_offsets(*path)  # of two machines' clocks
        if not possible and is_same:
            if self.point_means(seen, 0.0).scatter * np.sqrt(3.0) > _MOVES * spread_of(seen.xyz):
                raise RecordingError(
                    f"{name}: its points move while the arm stands, and at no offset of the clocks do both move at the "
                    "same times; give points of the same run"
                )
            self.doubts.append(
                f"{name}: its motion does not show the offset of its clock; its times are taken as the joints'"
            )
            return 0.0

        def misfit(offset_s: float) -> float:
            found = self.point_means(seen, offset_s).mean
            sample = sample_of(self.mean_q, found * self._unit_mm(seen, found))
            return misfit_mm(self.robot, sample) if sample.is_enough else np.inf

        offset_s, correlation = settled_offset(names, possible, misfit)
        size = f"{abs(offset_s):.3f} s"
        if is_same and abs(offset_s) < _SAME_S:
            self.notes.append(f"{name}: clocks of joints and points agree to {size}")
            return 0.0
        ahead = "behind" if offset_s < 0.0 else "ahead of"
        self.notes.append(
            f"{name}: its clock is {size} {ahead} the joints' (correlation of the speeds {correlation:.2f}); taken "
            "into account"
        )
        return offset_s

    def point_means(self, seen: PointSeries, offset_s: float) -> Means:
        """Means of the points in each phase, without its ends and without what still settles."""
        rows = np.searchsorted(seen.time_s - offset_s, self._inner_s)
        samples = [seen.xyz[first:last] for first, last in rows]
        spreads = [mad_sigmas(each) for each in samples if len(each) >= 8]
        if spreads:
            noise = np.maximum(np.median(spreads, axis=0), 1e-12)
            inner = [settled(each, slice(0, len(each)), noise) if len(each) >= 8 else None for each in samples]
            samples = [each if own is None else each[own] for each, own in zip(samples, inner, strict=True)]
        return means_of(samples)

    def _unit_mm(self, seen: PointSeries, points: Array) -> float:
        """Millimetres of the unit of points (K, 3), by its name or by their spread."""
        return LENGTHS_MM[seen.unit or length_unit(self.robot, self.mean_q, points)[0]]

    def kept_points(
        self, path: Path, name: str, seen: PointSeries, offset_s: float, sigma_mm: float | None
    ) -> tuple[BoolArray, UserTable]:
        """Phases (K,) to keep, and the table of their points. Raises RecordingError without points.

        sigma_mm: what changes from stop to stop, each axis; None where it is not known.
        """
        means = self.point_means(seen, offset_s)
        has_point = means.counts > 0
        if not has_point.any():
            raise RecordingError(f"{name}: no point was recorded while the arm stood; give points of the same run")
        missing = self.spans_s[~has_point, 0] - self.series.time_s[0]
        if len(missing):
            when = numbers.in_short([f"{each:.1f} s" for each in missing], _NAMED)
            self.notes.append(
                f"{name}: {len(missing)} of {len(has_point)} stops have no point and are left out (at {when})"
            )
        kept, unit_mm = self._with_known_sides(has_point), self._unit_mm(seen, means.mean)
        self.notes.append(_means_note(name, means, kept, unit_mm))
        sample = sample_of(self.mean_q[kept], means.mean[kept] * unit_mm)
        if sample.is_enough and misfit_mm(self.robot, sample) < _COMPUTED_MM:
            self.doubts.append(
                f"{name}: agrees with the nominal arm to {_COMPUTED_MM:g} mm: computed from the joints, not measured?"
            )
        variance = np.square(unit_mm * means.sigma[kept])
        variance += np.median(variance) if sigma_mm is None else sigma_mm**2  # from stop to stop as much, unless told
        unit = f" [{seen.unit}]" if seen.unit else ""
        table = {f"{axis}{unit}": values for axis, values in zip("xyz", means.mean[kept].T, strict=True)}
        if variance.max() > _UNEVEN * variance.min() > 0.0:
            self.notes.append(f"{name}: stops with fewer points weigh less (column counts_as)")
            table["counts_as"] = np.round(np.median(variance) / variance, 4)
        return kept, _table(path, table, kept)

    # ---- its table ---------------------------------------------------------------------------------------------------

    def _with_known_sides(self, kept: BoolArray) -> BoolArray:
        """Phases (K,) to keep: a few at the beginning are given up where those behind them have known approaches."""
        unknown = kept & (self.sides == 0.0).any(axis=1)
        if not unknown.any() or kept.sum() - unknown.sum() < max(_FEW, 0.8 * kept.sum()):
            return kept
        named = ", ".join(f"p{k + 1}" for k in np.flatnonzero(unknown))
        self.notes.append(
            f"{self.series.source}: {named} left out: not every joint had moved before, so from which side it came is "
            "not known"
        )
        return np.asarray(kept & ~unknown)

    def table(self, path: Path, kept: BoolArray) -> UserTable:
        """Table of the joints with time, approach and torques, a row a phase that is kept (K,)."""
        source = self.series.source
        table: dict[str, Array] = dict(zip(map(_name, self.columns), self._mean(self.series.values).T, strict=True))
        table["time_s"] = np.round(self.spans_s.mean(axis=1) - self.series.time_s[0], 3)
        if (self.sides[kept] != 0.0).all():
            table |= {f"approach{k + 1}": side.astype(int) for k, side in enumerate(self.sides.T)}
        else:
            self.notes.append(
                f"{source}: from which side the joints came is not known of all poses; columns approach are left out"
            )
        for k, column in enumerate(self.columns, start=1):
            values = self.series.efforts.get(column.name)
            if values is not None and np.isfinite(values).all():
                table[f"torque{k}_nm"] = column.sign * self._mean(values[:, None])[:, 0]
        if "torque1_nm" in table:
            self.notes.append(
                f"{source}: efforts are taken for torques in Nm, as sensor_msgs/JointState has them; where the driver "
                "writes currents, leave them out by --map 'torque*_nm=ignore'"
            )
        return _table(path, {name: values[kept] for name, values in table.items()}, kept)


def _table(path: Path, columns: Mapping[str, Array], kept: BoolArray) -> UserTable:
    """Table of numbers by column, a row a phase that is kept (K,), with the phase's number as its name and line."""
    lines = tuple(int(k) + 1 for k in np.flatnonzero(kept))
    rows = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    named = tuple((f"p{line}", *row) for line, row in zip(lines, rows, strict=True))
    return UserTable(path, ("pose", *columns), named, lines, has_header=True)


def _means_note(name: str, means: Means, kept: BoolArray, unit_mm: float) -> str:
    """How many points were averaged at each stop, and how exact the means are while the arm stands.

    This sigma is not declared as the dataset's noise: what changes from stop to stop is not in it, and with it as the
    noise arms that are only less repeatable by 0.03 mm would be told to have an unknown cause.
    """
    counts = means.counts[kept]
    of_each = f"{name}: {counts.min():.0f} to {counts.max():.0f} points a stop are averaged"
    if not means.scatter:
        return of_each
    return (
        f"{of_each}: one scatters by {unit_mm * means.scatter:.3g} mm, {means.tau:.1f} in a row tell as much as one, "
        f"so that a mean has sigma {unit_mm * rms(means.sigma[kept]):.2g} mm each axis; what changes from stop to stop "
        f"is not in it, so the noise stays undeclared (--sigma)"
    )
