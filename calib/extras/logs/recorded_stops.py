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
from calib.consistency.own_pose import agreement_note, table_disagreement_mm
from calib.dataset_import.columns import AS_MAPPED, Column, Meaning
from calib.dataset_import.markers import spread_of
from calib.dataset_import.plan import ImportSources
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, joint_units, length_unit
from calib.errors import DatasetError, visible
from calib.extras.logs.bags import is_bag, read_bag
from calib.extras.logs.chosen_series import arm_joints, measured_points, shown
from calib.extras.logs.clocks import ClockOffset, offset_of_single_points, possible_offsets, refined, settled_offset
from calib.extras.logs.import_source import is_recorded
from calib.extras.logs.means import Means, means_of
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, recording_file
from calib.extras.logs.standstill import LEAST_S, Standstill, approach_of, settled, standstill_of
from calib.extras.logs.table_logs import has_time, is_log, read_table_log
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.statistics import mad_sigmas, rms
from calib.text_files.column_names import split_unit
from calib.text_files.records import table_file
from calib.text_files.user_table import UserTable

_ONE_CLOCK_S = 10.0  # at most, by which clocks differ within one file
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
        seen, clock = arm.its_points(other, measured_points(other, of_points, wanted, notes, doubts), is_same)
        path = sources.points or file.with_name(f"{file.name} (points)")
        kept, tables[path] = arm.kept_points(path, other, seen, clock, sources.point_sigma_mm)
        arm.compare_with_controller(read.points)
        sources = replace(sources, points=path)
    else:
        kept = np.ones(len(arm.rest.phases), dtype=bool)
    tables[joints] = arm.table(joints, kept)
    return replace(
        sources, tables=tables, notes=tuple(notes), doubts=tuple(doubts), mapping=_mapped(mapping, columns),
        joint_unit_is_unknown=read.unit_is_unknown,
    )  # fmt: skip


def _read(file: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    if is_bag(file):
        return read_bag(file)
    if not table_file(file)[0].exists():
        raise RecordingError(f"{file}: no such file; name a recording")
    return read_table_log(file, robot, mapping)


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
            f"{spans.min():.1f} to {spans.max():.1f} s, where no joint moves by more than "
            f"{100.0 * rest.threshold:.2g} % of its range within {rest.window_s:.2g} s{brief}"
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
        rows = np.searchsorted(self.series.time_s, self._inner_s(0.0), "right")
        phases = zip(self.rest.phases, rows, strict=True)
        return means_of([values[first:last] if last > first else values[phase] for phase, (first, last) in phases]).mean

    def _inner_s(self, sigma_s: float) -> Array:
        """Times (K, 2) of the phases without the margins that points of a clock with this sigma need."""
        margin = np.minimum(_MARGIN_S + 3.0 * sigma_s, 0.25 * np.diff(self.spans_s)[:, 0])
        return self.spans_s + np.outer(margin, [1.0, -1.0])

    # ---- points ------------------------------------------------------------------------------------------------------

    def its_points(self, file: Path, seen: list[PointSeries], is_same: bool) -> tuple[list[PointSeries], ClockOffset]:
        """Points from the first on that moves as the arm does, and its clock's offset. Raises RecordingError for none.

        is_same: whether the points are of the joints' own recording.
        """
        errors: list[RecordingError] = []
        for k, each in enumerate(seen):
            try:
                clock = self._clock(each, shown(file, each), is_same)
            except RecordingError as error:
                errors.append(error)
                continue
            if k:
                left_out = numbers.in_short([visible(point.name) for point in seen[:k]], _NAMED)
                self.notes.append(f"{file}: points that do not move as this arm does are left out: {left_out}")
            return seen[k:], clock
        raise errors[0]

    def _clock(self, seen: PointSeries, name: str, is_same: bool) -> ClockOffset:
        """Offset of the points' clock to that of the joints. Raises RecordingError where it is ambiguous."""
        joint_s, (starts, ends), names = self.series.time_s, self.spans_s.T, (self.series.source, name)
        if len(seen) < _DENSE * len(starts) or np.median(np.diff(seen.time_s)) > 1.0:
            clock = offset_of_single_points(names, starts, ends, seen.time_s)
            sigma = f"{clock.offset_s:.3f} s, sigma {1e3 * clock.sigma_s:.2g} ms"
            self.notes.append(
                f"{name}: single points; offset of their clock to the joints': "
                f"{sigma if clock.offset_s else 'as recorded'}, by which they fall into phases"
            )
            return clock
        step = max(1, round(_PATH_STEP_S / float(np.median(np.diff(joint_s)))))
        path = (joint_s[::step], target_points(self.robot, self.q[::step]), seen.time_s, seen.xyz)
        possible = possible_offsets(*path, _ONE_CLOCK_S) if is_same else []
        possible = possible or possible_offsets(*path)  # of two machines' clocks
        if not possible and is_same:
            if self.point_means(seen, ClockOffset()).scatter * np.sqrt(3.0) > _MOVES * spread_of(seen.xyz):
                raise RecordingError(
                    f"{name}: its points move while the arm stands, and at no offset of the clocks do both move at the "
                    "same times; give points of the same run"
                )
            self.doubts.append(
                f"{name}: its motion does not show the offset of its clock; its times are taken as the joints'"
            )
            return ClockOffset()

        def misfit(offset_s: float) -> float:
            found = self.point_means(seen, ClockOffset(offset_s)).mean
            sample = sample_of(self.mean_q, found * self._unit_mm(seen, found))
            return misfit_mm(self.robot, sample) if sample.is_enough else np.inf

        travels = np.column_stack([ends[:-1] - 0.4, starts[1:] + 0.4])
        rough = settled_offset(names, possible, misfit)
        clock = refined(*path, rough, travels[np.diff(travels)[:, 0] < 60.0])
        size, sigma = f"{abs(clock.offset_s):.3f} s", f"sigma {1e3 * clock.sigma_s:.2g} ms"
        if is_same and abs(clock.offset_s) <= max(3.0 * clock.sigma_s, 2e-3):
            self.notes.append(f"{name}: clocks of joints and points agree to {size}, {sigma}")
            return replace(clock, offset_s=0.0)
        ahead = "behind" if clock.offset_s < 0.0 else "ahead of"
        self.notes.append(
            f"{name}: its clock is {size} {ahead} the joints', {sigma}, by {clock.travels} travels (correlation of the "
            f"speeds {clock.correlation:.2f}); taken into account"
        )
        if clock.drift:
            self.doubts.append(
                f"{name}: its clock drifts against the joints' by {clock.drift * 1e6:.0f} ppm; the mean offset is taken"
            )
        return clock

    def point_means(self, seen: PointSeries, clock: ClockOffset) -> Means:
        """Means of the points in each phase, without its ends and without what still settles."""
        rows = np.searchsorted(seen.time_s - clock.offset_s, self._inner_s(clock.sigma_s))
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
        self, path: Path, file: Path, seen: Sequence[PointSeries], clock: ClockOffset, sigma_mm: float | None
    ) -> tuple[BoolArray, UserTable]:
        """Phases (K,) to keep, and the table of their points, a row a target. Raises RecordingError without points.

        sigma_mm: what changes from stop to stop, each axis; None where it is not known.
        """
        means = [self.point_means(each, clock) for each in seen]
        name, first = shown(file, seen[0]), means[0]
        has_point = first.counts > 0
        if not has_point.any():
            raise RecordingError(f"{file}: no point was recorded while the arm stood; give points of the same run")
        missing = self.spans_s[~has_point, 0] - self.series.time_s[0]
        if len(missing):
            when = numbers.in_short([f"{each:.1f} s" for each in missing], _NAMED)
            self.notes.append(
                f"{name}: {len(missing)} of {len(has_point)} stops have no point and are left out (at {when})"
            )
        kept, unit_mm = self._with_known_sides(has_point), self._unit_mm(seen[0], first.mean)
        self.notes.append(_means_note(name, first, kept, unit_mm))
        sample = sample_of(self.mean_q[kept], first.mean[kept] * unit_mm)
        if sample.is_enough and misfit_mm(self.robot, sample) < _COMPUTED_MM:
            self.doubts.append(
                f"{name}: agrees with the nominal arm to {_COMPUTED_MM:g} mm: computed from the joints, not measured?"
            )
        rows = [
            (int(k), point.label, of_point.mean[k], unit_mm * of_point.sigma[k])
            for point, of_point in zip(seen, means, strict=True)
            for k in np.flatnonzero(kept & (of_point.counts > 0))
        ]
        variance = np.square([row[3] for row in rows])
        variance += np.median(variance) if sigma_mm is None else sigma_mm**2  # from stop to stop as much, unless told
        is_uneven = bool(variance.max() > _UNEVEN * variance.min() > 0.0)
        if is_uneven:
            self.notes.append(f"{name}: stops with fewer points weigh less (column counts_as)")
        unit = f" [{seen[0].unit}]" if seen[0].unit else ""
        table = {"pose": [f"p{k + 1}" for k, *_ in rows]}
        table |= {"target": [label for _, label, *_ in rows]} if len(seen) > 1 else {}
        table |= {f"{axis}{unit}": [repr(float(row[2][i])) for row in rows] for i, axis in enumerate("xyz")}
        table |= {"counts_as": [f"{each:.4g}" for each in np.median(variance) / variance]} if is_uneven else {}
        return kept, _table(path, table, [row[0] for row in rows])

    def compare_with_controller(self, points: Sequence[PointSeries]) -> None:
        """Tell how far poses that the controller computed are from the robot's table."""
        for own in (each for each in points if each.is_controllers_own and spread_of(each.xyz) > 0.0):
            mean = self.point_means(own, ClockOffset()).mean
            known = np.isfinite(mean).all(axis=1)
            if known.any():
                off_mm = table_disagreement_mm(self.robot, self.mean_q[known], mean[known] * self._unit_mm(own, mean))
                if off_mm is not None:
                    agrees, sentence = agreement_note(f"{self.file}: {visible(own.name)}", off_mm)
                    (self.notes if agrees else self.doubts).append(sentence)

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
        """Table of the joints with time, approach, torques and temperatures, a row a phase that is kept (K,)."""
        source, rows = self.series.source, np.flatnonzero(kept)
        table: dict[str, Array] = dict(zip(map(_name, self.columns), self._mean(self.series.values).T, strict=True))
        table["time_s"] = np.round(self.spans_s.mean(axis=1) - self.series.time_s[0], 3)
        if (self.sides[kept] != 0.0).all():
            table |= {f"approach{k + 1}": side.astype(int) for k, side in enumerate(self.sides.T)}
        else:
            self.notes.append(
                f"{source}: from which side the joints came is not known of all poses; columns approach are left out"
            )
        conditions = self.series.conditions
        for k, column in enumerate(self.columns, start=1):
            kinds = (("effort", f"torque{k}_nm", column.sign), ("temperature", f"temperature_joint{k}_c", 1.0))
            for key, name, sign in kinds:
                values = conditions.get(f"{key} {column.name}")
                if values is not None and np.isfinite(values).all():
                    table[name] = sign * self._mean(values[:, None])[:, 0]
        if "torque1_nm" in table:
            self.notes.append(
                f"{source}: efforts are taken for torques in Nm, as sensor_msgs/JointState has them; where the driver "
                "writes currents, leave them out by --map 'torque*_nm=ignore'"
            )
        cells = {name: [repr(values[k].item()) for k in rows] for name, values in table.items()}
        return _table(path, {"pose": [f"p{k + 1}" for k in rows]} | cells, rows.tolist())


def _table(path: Path, columns: Mapping[str, Sequence[str]], phases: Sequence[int]) -> UserTable:
    """Table of cells by column, each row under the number of its phase."""
    return UserTable(
        path, tuple(columns), tuple(zip(*columns.values(), strict=True)), tuple(k + 1 for k in phases), True
    )


def _means_note(name: str, means: Means, kept: BoolArray, unit_mm: float) -> str:
    """How many points were averaged at each stop, and how exact the means are while the arm stands.

    This sigma is not declared as the dataset's noise: what changes from stop to stop is not in it, and with it as the
    noise arms that are only less repeatable by 0.03 mm would be told to have an unknown cause.
    """
    counts = means.counts[kept]
    of_each = f"{name}: {counts.min():.0f} to {counts.max():.0f} points a stop are averaged"
    if not means.scatter:
        return of_each
    wild = f"; {means.left_out} outlying points are left out" if means.left_out else ""
    return (
        f"{of_each}: one scatters by {unit_mm * means.scatter:.3g} mm, {means.tau:.1f} in a row tell as much as one, "
        f"so that a mean has sigma {unit_mm * rms(means.sigma[kept]):.2g} mm each axis; what changes from stop to stop "
        f"is not in it, so the noise stays undeclared (--sigma){wild}"
    )
