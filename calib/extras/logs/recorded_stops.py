"""A recording as one row a pose: where the arm stands, its joints and the measured point are averaged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib.array_types import Array, BoolArray
from calib.consistency.agreement import misfit_mm, sample_of
from calib.consistency.own_pose import table_disagreement_mm
from calib.consistency.own_pose import told as told_of_table
from calib.dataset_import.columns import AS_MAPPED, Column, Meaning
from calib.dataset_import.markers import spread_of
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, length_unit
from calib.errors import DatasetError, visible
from calib.extras.logs.bags import is_bag, read_bag
from calib.extras.logs.chosen_series import arm_joints, in_short, measured_points, shown
from calib.extras.logs.clocks import (
    ClockOffset,
    offset_of_single_points,
    possible_offsets,
    refined,
    settled_offset,
)
from calib.extras.logs.means import Means, means_of
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, recording_file
from calib.extras.logs.standstill import LEAST_S, Phase, Standstill, approach_of, standstill_of, trimmed
from calib.extras.logs.table_logs import has_time, is_always_log, is_log, read_table_log
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
_MOVED = 1e-3  # rad, that a joint moves at least to come from a side
_JUMP = 0.02  # of the whole motion, from one row to the next
_OFTEN = 0.2  # of the rows
_MOVES = 0.02  # of the points' spread, by which they scatter in the stops where they are of other times
_NAMED = 8  # times that a sentence names
_FEW = 12  # poses, with which none is given up for its approach
_COMPUTED_MM = 1e-4  # misfit to the nominal arm, below which points were computed and not measured
_SAME_CLOCK = ClockOffset(0.0, 0.0, 1.0)


@dataclass(frozen=True)
class RecordedPoses:
    """Tables of a recording, a row a pose, with notes on what was read, found and left out."""

    joints: UserTable
    points: UserTable | None  # None where the points come from another table
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    mapping: Mapping[str, Meaning]  # of the tables' columns
    unit_is_unknown: bool = False  # of the joints


def is_recording(path: Path | None, mapping: Mapping[str, Meaning]) -> bool:
    """Whether a path is a log by time, and no table of poses, as a mapping of its time to `ignore` says."""
    if path is None:
        return False
    file, _ = recording_file(path)
    if is_bag(file) or is_always_log(file):
        return True
    with suppress(DatasetError, OSError):
        return table_file(file)[0].is_file() and is_log(file, mapping)
    return False


def recorded_poses(robot: Robot, joints: Path, points: Path | None, mapping: Mapping[str, Meaning]) -> RecordedPoses:
    """Poses at which the arm stood in a recording.

    Args:
        robot: nominal arm, by whose joint names columns are recognised.
        joints: recording of the joints, `FILE` or `FILE#TOPIC`.
        points: recording of the points where it is another one or another topic; a table without times is left to be
            read as a table.
        mapping: meanings of columns, as for tables.

    Raises:
        RecordingError: no joints, no points, no standing phases, or clocks that cannot be set.
    """
    file, topic = recording_file(joints)
    read = _read(file, robot, mapping)
    notes, doubts = list(read.notes), list[str]()
    arm = _stopped_arm(robot, file, *arm_joints(file, read, topic, robot, mapping, notes), notes, doubts)
    told = _told(mapping, arm.columns)
    other, wanted = (file, "") if points is None else recording_file(points)
    if not _has_time(other):  # rows of a pose each, by name or in order
        table = arm.table(joints, np.ones(len(arm.rest.phases), dtype=bool))
        return RecordedPoses(table, None, tuple(notes), tuple(doubts), told, read.unit_is_unknown)
    is_same = other.resolve() == file.resolve()
    of_points = read if is_same else _read(other, robot, mapping)
    notes += [] if is_same else of_points.notes
    seen, clock = arm.its_points(other, measured_points(other, of_points, wanted, notes, doubts), is_same)
    means = [arm.point_means(each, clock) for each in seen]
    has_point = ~np.isnan([each.mean[:, 0] for each in means])  # (points, phases)
    name = shown(other, seen[0])
    missing = arm.starts_s[~has_point[0]] - arm.series.time_s[0]
    if len(missing):
        when = numbers.in_short([f"{each:.1f} s" for each in missing], _NAMED)
        notes.append(f"{name}: {len(missing)} of {has_point.shape[1]} stops have no point and are left out (at {when})")
    if not has_point[0].any():
        raise RecordingError(f"{other}: no point was recorded while the arm stood; give points of the same run")
    kept = arm.with_known_sides(has_point[0])
    table = arm.table(joints, kept)
    unit_mm = arm.unit_mm(seen[0], means[0].mean)
    notes.append(_means_note(name, means[0], kept, unit_mm))
    sample = sample_of(arm.mean_q[kept], means[0].mean[kept] * unit_mm)
    if sample.is_enough and misfit_mm(robot, sample) < _COMPUTED_MM:
        doubts.append(
            f"{name}: agrees with the nominal arm to {_COMPUTED_MM:g} mm: computed from the joints, not measured?"
        )
    arm.compare_with_controller(read.points)
    point_table = _point_table(other, seen, means, kept)
    return RecordedPoses(table, point_table, tuple(notes), tuple(doubts), told, read.unit_is_unknown)


def _read(file: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    if is_bag(file):
        return read_bag(file)
    if not table_file(file)[0].exists():
        raise RecordingError(f"{file}: no such file; name a recording")
    return read_table_log(file, robot, mapping)


def _has_time(path: Path) -> bool:
    with suppress(DatasetError, OSError):
        return is_bag(path) or is_always_log(path) or has_time(path)
    return False


def _told(mapping: Mapping[str, Meaning], columns: Sequence[Column]) -> dict[str, Meaning]:
    """Mapping with the joints' columns under the names that they have in the table."""
    of_joints = {column.name for column in columns}
    used = ("q", "time_s")  # of the log
    out = {key: m for key, m in mapping.items() if key not in of_joints and not m.name.startswith(used)}
    for k, column in enumerate(columns):
        if column.why == AS_MAPPED:
            out[_name(column)] = Meaning(f"q{k + 1}", column.unit, column.sign, column.offset, column.others)
    return out


def _name(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit and not split_unit(column.name)[1] else column.name


# ---- the arm ---------------------------------------------------------------------------------------------------------


def _stopped_arm(
    robot: Robot, file: Path, series: JointSeries, columns: list[Column], notes: list[str], doubts: list[str]
) -> _StoppedArm:
    """The arm with its standing phases. Raises RecordingError where it has none, or two publishers write its joints."""
    is_surely_log = is_bag(file) or is_always_log(file)
    if is_bag(file) and _jumps(series.values):
        raise RecordingError(
            f"{file}: {series.source}: the joints jump back and forth from row to row, as where two publishers "
            "write to one topic; record the topic of one of them"
        )
    try:
        rest = standstill_of(str(file), series.time_s, series.values)
    except RecordingError as error:
        if is_surely_log:
            raise
        raise RecordingError(
            f"{error}; where its rows are poses, say so by --map with its column of time =ignore"
        ) from None
    arm = _StoppedArm(robot, file, series, columns, rest, notes, doubts)
    spans = arm.ends_s - arm.starts_s
    rate = 1.0 / float(np.median(np.diff(series.time_s)))
    brief = f"; {rest.brief} shorter than {LEAST_S:g} s are left out" if rest.brief else ""
    notes.append(
        f"{file}: {len(series)} joint states of {series.source} in {series.time_s[-1] - series.time_s[0]:.1f} s "
        f"({rate:.0f} Hz); the arm stands {len(rest.phases)} times, for {spans.min():.1f} to {spans.max():.1f} s, "
        f"where no joint moves by more than {100.0 * rest.threshold:.2g} % of its range within {rest.window_s:.2g} s"
        f"{brief}"
    )
    return arm


def _jumps(values: Array) -> bool:
    """Whether rows (N, n) alternate between two places."""
    steps = np.diff(values, axis=0)
    far = np.linalg.norm(steps, axis=1) > max(_JUMP * float(np.linalg.norm(np.ptp(values, axis=0))), _MOVED)
    back = np.einsum("ij,ij->i", steps[1:], steps[:-1]) < 0.0
    return bool(len(back) and np.mean(back & far[1:] & far[:-1]) > _OFTEN)


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
    def starts_s(self) -> Array:
        """Times (K,) at which the phases begin."""
        return self.series.time_s[[phase.first for phase in self.rest.phases]]

    @cached_property
    def ends_s(self) -> Array:
        """Times (K,) at which the phases end."""
        return self.series.time_s[[phase.last for phase in self.rest.phases]]

    @cached_property
    def q(self) -> Array:
        """Joint values (N, n), rad and mm, for the path of the tool; units that are not told are guessed by size."""
        out = np.empty_like(self.series.values)
        for k, (column, joint) in enumerate(zip(self.columns, self.robot.joints, strict=True)):
            values = self.series.values[:, k]
            largest = float(np.max(np.abs(values)))
            if joint.is_revolute:
                scale = ANGLES_RAD[column.unit or ("rad" if largest <= 4.0 * np.pi else "deg")]
            else:
                scale = LENGTHS_MM[column.unit or ("m" if largest <= 5.0 else "mm")]
            out[:, k] = (column.sign * values + column.offset) * scale
        return out

    @cached_property
    def mean_q(self) -> Array:
        """Joint values (K, n) of each phase."""
        return np.array(self._of_phases(self.q, np.mean))

    @cached_property
    def sides(self) -> Array:
        """Direction (K, n) from which each joint came to each phase, 1 or -1; 0 where it had not moved before.

        A joint that always comes from one side came so to the first phase, too.
        """
        values = self.series.values
        per_rad = {"rad": 1.0, "deg": 1.0 / ANGLES_RAD["deg"]}
        least = np.array([
            _MOVED * per_rad[column.unit] if column.unit in per_rad else 5e-4 * whole
            for column, whole in zip(self.columns, np.ptp(values, axis=0), strict=True)
        ])  # fmt: skip
        medians = zip(self.rest.phases, self._of_phases(values, np.median), strict=True)
        sides = np.array([approach_of(values, phase, median, least) for phase, median in medians])
        only = np.where((np.abs(sides.sum(axis=0)) == np.abs(sides).sum(axis=0)), np.sign(sides.sum(axis=0)), 0.0)
        return np.where(sides == 0.0, only, sides)

    def _of_phases(self, values: Array, mean: Callable[..., Array]) -> list[Array]:
        return [mean(values[phase.first : phase.last + 1], axis=0) for phase in self.rest.phases]

    def unit_mm(self, seen: PointSeries, points: Array) -> float:
        """Millimetres of the unit of points (K, 3), by its name or by their spread."""
        return LENGTHS_MM[seen.unit or length_unit(self.robot, self.mean_q, points)[0]]

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
                left_out = in_short([point.name for point in seen[:k]])
                self.notes.append(f"{file}: points that do not move as this arm does are left out: {left_out}")
            return seen[k:], clock
        raise errors[0]

    def _clock(self, seen: PointSeries, name: str, is_same: bool) -> ClockOffset:
        """Offset of the points' clock to that of the joints. Raises RecordingError where it is ambiguous."""
        joint_s, starts, ends = self.series.time_s, self.starts_s, self.ends_s
        names = (self.series.source, name)
        if len(seen) < _DENSE * len(starts) or np.median(np.diff(seen.time_s)) > 1.0:
            clock = offset_of_single_points(names, starts, ends, seen.time_s)
            sigma = f"{clock.offset_s:.3f} s, sigma {1e3 * clock.sigma_s:.2g} ms"
            how = sigma if clock.offset_s else "as recorded"
            self.notes.append(
                f"{name}: single points; offset of their clock to the joints': {how}, by which they fall into phases"
            )
            return clock
        step = max(1, round(_PATH_STEP_S / float(np.median(np.diff(joint_s)))))
        path = (joint_s[::step], target_points(self.robot, self.q[::step]), seen.time_s, seen.xyz)
        possible = possible_offsets(*path, _ONE_CLOCK_S) if is_same else []
        possible = possible or possible_offsets(*path)  # of two machines' clocks
        if not possible and is_same:
            if np.linalg.norm(self.point_means(seen, _SAME_CLOCK).scatter) > _MOVES * spread_of(seen.xyz):
                raise RecordingError(
                    f"{name}: its points move while the arm stands, and at no offset of the clocks do both move at the "
                    "same times; give points of the same run"
                )
            self.doubts.append(
                f"{name}: its motion does not show the offset of its clock; its times are taken as the joints'"
            )
            return ClockOffset(0.0, 0.0, 0.0)

        def misfit(offset_s: float) -> float:
            found = self.point_means(seen, replace(_SAME_CLOCK, offset_s=offset_s)).mean
            sample = sample_of(self.mean_q, found * self.unit_mm(seen, found))
            return misfit_mm(self.robot, sample) if sample.is_enough else np.inf

        rough = settled_offset(names, possible, misfit)
        spans = np.column_stack([ends[:-1] - 0.4, starts[1:] + 0.4])
        clock = refined(*path, rough, spans[spans[:, 1] - spans[:, 0] < 60.0])
        size = f"{abs(clock.offset_s):.3f} s"
        sigma = f"sigma {1e3 * clock.sigma_s:.2g} ms"
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
        at = seen.time_s - clock.offset_s
        margins = np.minimum(_MARGIN_S + 3.0 * clock.sigma_s, 0.25 * (self.ends_s - self.starts_s))
        first, last = np.searchsorted(at, self.starts_s + margins), np.searchsorted(at, self.ends_s - margins)
        samples = [seen.xyz[a:b] for a, b in zip(first, last, strict=True)]
        spreads = [mad_sigmas(each) for each in samples if len(each) >= 8]
        noise = np.maximum(np.median(spreads, axis=0), 1e-12) if spreads else np.full(3, np.inf)
        for k, each in enumerate(samples):
            inner = trimmed(each, Phase(0, len(each) - 1), noise) if len(each) >= 8 else None
            samples[k] = each if inner is None else each[inner.first : inner.last + 1]
        return means_of(samples)

    def compare_with_controller(self, points: Sequence[PointSeries]) -> None:
        """Tell how far poses that the controller computed are from the robot's table."""
        for own in (each for each in points if each.is_controllers_own and spread_of(each.xyz) > 0.0):
            mean = self.point_means(own, _SAME_CLOCK).mean
            known = np.isfinite(mean).all(axis=1)
            if known.any():
                off_mm = table_disagreement_mm(self.robot, self.mean_q[known], mean[known] * self.unit_mm(own, mean))
                if off_mm is not None:
                    agrees, sentence = told_of_table(f"{self.file}: {visible(own.name)}", off_mm)
                    (self.notes if agrees else self.doubts).append(sentence)

    # ---- its table ---------------------------------------------------------------------------------------------------

    def with_known_sides(self, kept: BoolArray) -> BoolArray:
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
        means = means_of([self.series.values[phase.first : phase.last + 1] for phase in self.rest.phases]).mean
        table: dict[str, Array] = {_name(column): means[:, k] for k, column in enumerate(self.columns)}
        table["time_s"] = np.round(0.5 * (self.starts_s + self.ends_s) - self.series.time_s[0], 3)
        if (self.sides[kept] != 0.0).all():
            table |= {f"approach{k + 1}": side.astype(int) for k, side in enumerate(self.sides.T)}
        else:
            self.notes.append(
                f"{source}: from which side the joints came is not known of all poses; columns approach are left out"
            )
        for k, column in enumerate(self.columns):
            for key, name, sign in (
                ("effort", f"torque{k + 1}_nm", column.sign),
                ("temperature", f"temperature_joint{k + 1}_c", 1.0),
            ):
                values = self.series.conditions.get(f"{key} {column.name}")
                if values is not None and np.isfinite(values).all():
                    table[name] = sign * np.array(self._of_phases(values, np.mean))
        if any(name.startswith("torque") for name in table):
            self.notes.append(
                f"{source}: efforts are taken for torques in Nm, as sensor_msgs/JointState has them; where the driver "
                "writes currents, leave them out by --map 'torque*_nm=ignore'"
            )
        cells = tuple((f"p{k + 1}", *(repr(column[k].item()) for column in table.values())) for k in rows)
        return UserTable(path, ("pose", *table), cells, tuple(int(k) + 1 for k in rows), True)


# ---- points ----------------------------------------------------------------------------------------------------------


def _point_table(path: Path, seen: Sequence[PointSeries], means: Sequence[Means], kept: BoolArray) -> UserTable:
    """Table of the points, a row for each target of a phase that is kept."""
    unit = f" [{seen[0].unit}]" if seen[0].unit else ""
    with_targets = len(seen) > 1
    header = ("pose", *(("target",) if with_targets else ()), f"x{unit}", f"y{unit}", f"z{unit}")
    found = [
        (int(k), series.label, of_series.mean[k])
        for series, of_series in zip(seen, means, strict=True)
        for k in np.flatnonzero(kept & np.isfinite(of_series.mean).all(axis=1))
    ]
    rows = (
        (f"p{k + 1}", *((label,) if with_targets else ()), *(repr(float(v)) for v in mean)) for k, label, mean in found
    )
    return UserTable(path, header, tuple(rows), tuple(k + 1 for k, _, _ in found), True)


def _means_note(name: str, means: Means, kept: BoolArray, unit_mm: float) -> str:
    """How many points were averaged at each stop, and how exact the means are while the arm stands.

    This sigma is not declared as the dataset's noise: what changes from stop to stop is not in it, and with it as the
    noise arms that are only less repeatable by 0.03 mm would be told to have an unknown cause.
    """
    counts = means.counts[kept]
    of_each = f"{name}: {counts.min():.0f} to {counts.max():.0f} points a stop are averaged"
    if not means.scatter.any():
        return of_each
    wild = f"; {means.left_out} outlying points are left out" if means.left_out else ""
    return (
        f"{of_each}: one scatters by {unit_mm * rms(means.scatter):.3g} mm, {means.tau:.1f} in a row tell as much as "
        f"one, so that a mean has sigma {unit_mm * rms(means.sigma[kept]):.2g} mm each axis; what changes from stop to "
        f"stop is not in it, so the noise stays undeclared (--sigma){wild}"
    )
