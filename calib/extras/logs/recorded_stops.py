"""A recording as one row a pose: where the arm stands, its joints and the measured point are averaged."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.array_types import Array, BoolArray
from calib.consistency.agreement import misfit_mm, sample_of
from calib.consistency.own_pose import table_disagreement_mm
from calib.consistency.own_pose import told as told_of_table
from calib.dataset_import.columns import AS_MAPPED, Column, Meaning, kind_of_marker, recognise
from calib.dataset_import.markers import STANDS_STILL, spread_of
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, length_unit
from calib.errors import DatasetError, visible
from calib.extras.logs.bags import is_bag, read_bag
from calib.extras.logs.clocks import (
    ClockOffset,
    offset_of_single_points,
    possible_offsets,
    refined,
    settled_offset,
)
from calib.extras.logs.means import Means, means_of
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, lost_rows, recording_file
from calib.extras.logs.standstill import LEAST_S, Phase, Standstill, approach_of, standstill_of, trimmed
from calib.extras.logs.table_logs import has_time, is_always_log, is_log, read_table_log
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.statistics import mad_sigmas, rms
from calib.text_files.records import table_file
from calib.text_files.user_table import UserTable, split_unit

_ONE_CLOCK_S = 10.0  # at most, by which clocks differ within one file
_MARGIN_S = 0.1  # at both ends of a phase, in which points are not used
_DENSE = 5.0  # points a phase, from which their motion is recorded, too
_PATH_STEP_S = 0.01  # between the joints at which the tool's path is computed
_MOVED = 1e-3  # rad, that a joint moves at least to come from a side
_JUMP = 0.02  # of the whole motion, from one row to the next
_OFTEN = 0.2  # of the rows
_RARE = 0.1  # of the points seen most often
_MOVES = 0.02  # of the points' spread, by which they scatter in the stops where they are of other times
_WILD = 6.0  # times the usual scatter, from which a phase was disturbed
_AGREES = 0.1  # of the points' spread
_NAMED = 8  # topics or times that a sentence names
_FEW = 12  # poses, with which none is given up for its approach
_COMPUTED_MM = 1e-4  # misfit to the nominal arm, below which points were computed and not measured


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
    if not table_file(file)[0].is_file():
        return False
    try:
        return is_log(file, mapping)
    except (DatasetError, OSError):
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
    series, columns = _joints_of(file, read, topic, robot, mapping, notes)
    told = _told(mapping, columns)
    other, wanted = (file, "") if points is None else recording_file(points)
    is_table = not (is_bag(other) or is_always_log(other) or _has_time(other))
    if is_bag(file) and _jumps(series.values):
        raise RecordingError(
            f"{file}: {series.source}: the joints jump back and forth from row to row, as where two publishers "
            "write to one topic; record the topic of one of them"
        )
    try:
        rest = standstill_of(str(file), series.time_s, series.values)
    except RecordingError as error:
        if is_bag(file) or is_always_log(file):
            raise
        raise RecordingError(
            f"{error}; where its rows are poses, say so by --map with its column of time =ignore"
        ) from None
    notes.append(_rest_note(file, series, rest))
    if is_table:  # rows of a pose each, by name or in order
        everything = np.ones(len(rest.phases), dtype=bool)
        table = _joint_table(joints, series, columns, rest, _sides(series, columns, rest), everything, notes)
        return RecordedPoses(table, None, tuple(notes), tuple(doubts), told, read.unit_is_unknown)
    is_same = other.resolve() == file.resolve()
    of_points = read if is_same else _read(other, robot, mapping)
    notes += [] if is_same else of_points.notes
    seen = [_kept(other, each, notes) for each in _points_of(other, of_points, wanted, robot, notes, doubts)]
    q = _q(robot, series, columns)
    seen, clock = _of_this_arm(robot, (series, q, rest), seen, other, is_same, notes, doubts)
    means = [_point_means(each, series.time_s, rest, clock) for each in seen]
    kept = ~np.isnan(means[0].mean[:, 0])
    for further in means[1:]:
        kept |= ~np.isnan(further.mean[:, 0])
    kept &= _calm(_shown(other, seen[0]), means[0], series.time_s, rest, notes)
    if not kept.any():
        raise RecordingError(f"{other}: no point was recorded while the arm stood; give points of the same run")
    sides = _sides(series, columns, rest)
    kept = _with_known_sides(series, sides, kept, notes)
    table = _joint_table(joints, series, columns, rest, sides, kept, notes)
    ids = table.text("pose")
    unit_mm = _unit_mm(robot, _mean_q(q, rest), means[0].mean, seen[0])
    notes += _means_note(_shown(other, seen[0]), means[0], kept, unit_mm)
    doubts += _computed(robot, q, rest, (means[0].mean, unit_mm), kept, _shown(other, seen[0]))
    for name, off_mm in _of_controller(robot, series, q, rest, read.points):
        agrees, sentence = told_of_table(f"{file}: {visible(name)}", off_mm)
        (notes if agrees else doubts).append(sentence)
    point_table = _point_table(other, seen, means, kept, ids)
    return RecordedPoses(table, point_table, tuple(notes), tuple(doubts), told, read.unit_is_unknown)


def _jumps(values: Array) -> bool:
    """Whether rows (N, n) alternate between two places."""
    steps = np.diff(values, axis=0)
    far = np.linalg.norm(steps, axis=1) > max(_JUMP * float(np.linalg.norm(np.ptp(values, axis=0))), _MOVED)
    back = np.einsum("ij,ij->i", steps[1:], steps[:-1]) < 0.0
    return bool(len(back) and np.mean(back & far[1:] & far[:-1]) > _OFTEN)


def _told(mapping: Mapping[str, Meaning], columns: Sequence[Column]) -> dict[str, Meaning]:
    """Mapping with the joints' columns under the names that they have in the table."""
    of_joints = {column.name for column in columns}
    used = ("q", "time_s")  # of the log
    out = {key: m for key, m in mapping.items() if key not in of_joints and not m.name.startswith(used)}
    for k, column in enumerate(columns):
        if column.why == AS_MAPPED:
            out[_name(column)] = Meaning(f"q{k + 1}", column.unit, column.sign, column.offset)
    return out


def _name(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit and not split_unit(column.name)[1] else column.name


def _read(file: Path, robot: Robot, mapping: Mapping[str, Meaning]) -> Recording:
    if is_bag(file):
        return read_bag(file)
    if not table_file(file)[0].exists():
        raise RecordingError(f"{file}: no such file; name a recording")
    return read_table_log(file, robot, mapping)


def _has_time(path: Path) -> bool:
    try:
        return has_time(path)
    except (DatasetError, OSError):
        return False


# ---- which joints and points -----------------------------------------------------------------------------------------


def _joints_of(
    file: Path, read: Recording, topic: str, robot: Robot, mapping: Mapping[str, Meaning], notes: list[str]
) -> tuple[JointSeries, list[Column]]:
    """Series with the arm's joints, and the column of each. Raises RecordingError."""
    wanted = f"{robot.n_joints} joints are needed, {', '.join(joint.name for joint in robot.joints)}"
    if not read.joints:
        raise RecordingError(
            f"{file}: holds no joint states (sensor_msgs/JointState, or a column a joint); {wanted}; found "
            f"{_list(read) or 'nothing'}"
        )
    series = [each for each in read.joints if topic in ("", each.source)]
    if not series:
        named = ", ".join(each.source for each in read.joints)
        raise RecordingError(f"{file}: no joint states in {topic!r}; there are {named}")
    possible: list[tuple[JointSeries, list[Column]]] = []
    several: list[str] = []
    for each in series:
        meant = recognise(
            each.names, robot, {key: value for key, value in mapping.items() if _matches(key, each.names)}
        )
        found = [meant.columns.get(f"q{k + 1}") for k in range(robot.n_joints)]
        several += [f"{file}: {each.source}: {fault}" for fault in meant.faults]
        if all(found):
            possible.append((each, [column for column in found if column is not None]))
    if not possible and several:
        raise RecordingError(visible(several[0]))
    if not possible:
        has = "; ".join(f"{each.source} has {', '.join(each.names[:20])}" for each in series)
        raise RecordingError(f"{file}: {wanted}; {visible(has)}; tell with --map {series[0].names[0]}=q1 ...")
    if len(possible) > 1:
        best = [pair for pair in possible if re.search(r"(^|/)joint_states$", pair[0].source)] or possible
        best = sorted(best, key=lambda pair: (pair[0].source.count("/"), -len(pair[0])))
        if len(best) > 1 and best[0][0].source.count("/") == best[1][0].source.count("/"):
            named = ", ".join(pair[0].source for pair in best)
            raise RecordingError(
                f"{file}: several topics hold the joints, {named}; say which by --joints {file}#{best[0][0].source}"
            )
        notes.append(
            f"{file}: joints are taken from {best[0][0].source}, not from "
            f"{', '.join(p[0].source for p in possible if p is not best[0])}"
        )
        possible = [best[0]]
    chosen, columns = possible[0]
    rows = chosen.values[:, [chosen.names.index(column.name) for column in columns]]
    kept = chosen.kept(np.logical_and.reduce(np.isfinite(rows), axis=1))
    values = kept.values[:, [kept.names.index(column.name) for column in columns]]
    if len(kept) < 10:
        raise RecordingError(f"{file}: {chosen.source} has {len(kept)} rows with all joints; record the whole run")
    unused = [name for name in chosen.names if name not in {column.name for column in columns}]
    if unused and is_bag(file):
        notes.append(f"{file}: other joints are left out: {visible(', '.join(unused[:_NAMED]))}")
    if read.others:
        notes.append(f"{file}: not read: {visible(numbers.in_short(read.others, _NAMED))}")
    unit = chosen.unit
    told = [
        column if column.unit or not unit else replace(column, unit=unit if joint.is_revolute else "m")
        for column, joint in zip(columns, robot.joints, strict=True)
    ]
    return replace(kept, names=tuple(column.name for column in columns), values=values), told


def _matches(pattern: str, names: Sequence[str]) -> bool:
    return "*" in pattern or pattern in names


def _points_of(
    file: Path, read: Recording, wanted: str, robot: Robot, notes: list[str], doubts: list[str]
) -> list[PointSeries]:
    """Series of the measured point, several only where they are the robot's own targets. Raises RecordingError."""
    if wanted:
        chosen = [each for each in read.points if wanted in (each.name, each.source, each.label)]
        if not chosen:
            named = ", ".join(each.name for each in read.points) or "none"
            raise RecordingError(f"{file}: no points in {wanted!r}; there are {named}")
        if any(each.is_controllers_own for each in chosen):
            doubts.append(
                f"{file}: {wanted} is named as a pose that the controller computes; it is used as measured, as asked"
            )
    else:
        chosen = [each for each in read.points if not each.is_controllers_own]
        own = [each.name for each in read.points if each.is_controllers_own]
        if own and chosen:
            notes.append(
                f"{file}: poses of the controller itself measure nothing and are left out: "
                f"{visible(', '.join(own[:_NAMED]))}"
            )
        if own and not chosen:
            raise RecordingError(
                f"{file}: holds no measured points, only poses that are named as the controller's own, "
                f"{visible(', '.join(own[:_NAMED]))}; give the points by --points FILE, or one of these by --points "
                f"{file}#{own[0]}"
            )
    if not chosen:
        raise RecordingError(
            f"{file}: holds no measured points (PointStamped, PoseStamped, TransformStamped, tf2_msgs/TFMessage, "
            f"Marker, arrays of detections with poses, or columns x, y, z) that move; found "
            f"{_list(read) or 'nothing else'}; "
            "give them by --points FILE"
        )
    widest = max(spread_of(each.xyz) for each in chosen)
    static = [each.name for each in chosen if spread_of(each.xyz) < STANDS_STILL * widest]
    chosen = [each for each in chosen if each.name not in static]
    if static:
        notes.append(f"{file}: points that stand still are left out: {visible(', '.join(static[:_NAMED]))}")
    sources = list(dict.fromkeys(each.source for each in chosen))
    body = next((s for s in sources if all(re.match(rf"{re.escape(_stem(s))}\b", each) for each in sources)), None)
    if len(sources) > 1 and body is not None:  # a rigid body of motion capture before its own markers
        others = visible(", ".join(source for source in sources if source != body))
        notes.append(f"{file}: the point is {visible(body)}; its markers are left out: {others}")
        chosen = [each for each in chosen if each.source == body]
    elif len({kind_of_marker(source) for source in sources}) > 1:
        raise RecordingError(
            f"{file}: several sources of points, {visible(', '.join(sources[:_NAMED]))}; say which by --points "
            f"'{file}#{sources[0]}'"
        )
    if len(chosen) == 1:
        return chosen
    chosen = sorted(chosen, key=lambda each: -len(each))
    rare = [each.name for each in chosen if len(each) < _RARE * len(chosen[0])]
    chosen = [each for each in chosen if each.name not in rare]
    if rare:
        notes.append(f"{file}: points that were seldom seen are left out: {visible(', '.join(rare[:_NAMED]))}")
    if len(chosen) > 1:
        notes.append(
            f"{file}: {len(chosen)} points are measured, {visible(', '.join(each.name for each in chosen[:_NAMED]))}; "
            f"one alone by --points '{file}#{chosen[0].name}'"
        )
    labelled = zip(chosen, _labels(chosen), strict=True)
    return [replace(each, source="" if len(sources) > 1 else each.source, label=label) for each, label in labelled]


def _labels(series: Sequence[PointSeries]) -> list[str]:
    """Short name of each of several points, as a target of the robot."""
    if len({each.source for each in series}) == 1:
        names = [each.label for each in series]
    else:  # what their topics do not share
        parts = [re.split(r"[/:]", each.name.strip("/")) for each in series]
        shared = set.intersection(*map(set, parts))
        names = ["/".join(part for part in of_one if part not in shared) for of_one in parts]
    return [f"marker{name}" if name.isdigit() else name for name in names]


def _kept(file: Path, seen: PointSeries, notes: list[str]) -> PointSeries:
    """Points without what was written while the target was lost."""
    lost = lost_rows(seen.xyz)
    if not lost.any() or lost.all():
        return seen
    notes.append(f"{_shown(file, seen)}: {lost.sum()} of {len(seen)} points are zeros or held values and left out")
    return replace(seen, time_s=seen.time_s[~lost], xyz=seen.xyz[~lost])


def _stem(source: str) -> str:
    """Name of a body of motion capture, without what is measured of it."""
    return source.removesuffix(" Position")


def _shown(file: Path, seen: PointSeries) -> str:
    """File of a point, with its topic or columns where it has a name."""
    return f"{file}: {visible(seen.name)}" if seen.name else str(file)


def _list(read: Recording) -> str:
    return visible(", ".join([*(each.name or "x, y, z" for each in read.points), *read.others][: 2 * _NAMED]))


# ---- clocks ----------------------------------------------------------------------------------------------------------


def _q(robot: Robot, series: JointSeries, columns: Sequence[Column]) -> Array:
    """Joint values (N, n), rad and mm, for the path of the tool; units that are not told are guessed by size."""
    out = np.empty_like(series.values)
    for k, (column, joint) in enumerate(zip(columns, robot.joints, strict=True)):
        values = series.values[:, k]
        largest = float(np.max(np.abs(values)))
        if joint.is_revolute:
            scale = ANGLES_RAD[column.unit or ("rad" if largest <= 4.0 * np.pi else "deg")]
        else:
            scale = LENGTHS_MM[column.unit or ("m" if largest <= 5.0 else "mm")]
        out[:, k] = (column.sign * values + column.offset) * scale
    return out


def _mean_q(q: Array, rest: Standstill) -> Array:
    """Joint values (K, n) of each phase."""
    return np.array([q[phase.first : phase.last + 1].mean(axis=0) for phase in rest.phases])


def _unit_mm(robot: Robot, q: Array, points: Array, seen: PointSeries) -> float:
    """Millimetres of the points' unit, by its name or by their spread."""
    return LENGTHS_MM[seen.unit or length_unit(robot, q, points)[0]]


def _clock(
    robot: Robot,
    joints: tuple[JointSeries, Array, Standstill],
    points: tuple[PointSeries, Path],
    is_same: bool,
    notes: list[str],
    doubts: list[str],
) -> ClockOffset:
    """Offset of the points' clock to that of the joints. Raises RecordingError where it is ambiguous."""
    (series, q, rest), (seen, other) = joints, points
    names = (series.source, _shown(other, seen))
    starts, ends = rest.starts_s(series.time_s), rest.ends_s(series.time_s)
    if len(seen) < _DENSE * len(rest.phases) or np.median(np.diff(seen.time_s)) > 1.0:
        clock = offset_of_single_points(names, starts, ends, seen.time_s)
        how = "as recorded" if clock.offset_s == 0.0 else f"{clock.offset_s:.3f} s, sigma {1e3 * clock.sigma_s:.2g} ms"
        notes.append(
            f"{names[1]}: single points; offset of their clock to the joints': {how}, by which they fall into phases"
        )
        return clock
    step = max(1, round(_PATH_STEP_S / float(np.median(np.diff(series.time_s)))))
    path_s, path_mm = series.time_s[::step], target_points(robot, q[::step])
    possible = possible_offsets(path_s, path_mm, seen.time_s, seen.xyz, _ONE_CLOCK_S if is_same else None)
    if not possible and is_same:  # of two machines' clocks
        possible = possible_offsets(path_s, path_mm, seen.time_s, seen.xyz)
    if not possible and is_same:
        still = _point_means(seen, series.time_s, rest, ClockOffset(0.0, 0.0, 1.0))
        if np.linalg.norm(still.scatter) > _MOVES * spread_of(seen.xyz):
            raise RecordingError(
                f"{names[1]}: its points move while the arm stands, and at no offset of the clocks do both move at the "
                "same times; give points of the same run"
            )
        doubts.append(
            f"{names[1]}: its motion does not show the offset of its clock; its times are taken as the joints'"
        )
        return ClockOffset(0.0, 0.0, 0.0)

    def misfit(offset_s: float) -> float:
        found = _point_means(seen, series.time_s, rest, ClockOffset(offset_s, 0.0, 1.0)).mean
        sample = sample_of(_mean_q(q, rest), found * _unit_mm(robot, _mean_q(q, rest), found, seen))
        return misfit_mm(robot, sample) if sample.is_enough else np.inf

    rough = settled_offset(names, possible, misfit)
    spans = np.column_stack([ends[:-1] - 0.4, starts[1:] + 0.4])
    clock = refined(path_s, path_mm, seen.time_s, seen.xyz, rough, spans[spans[:, 1] - spans[:, 0] < 60.0])
    if is_same and abs(clock.offset_s) <= max(3.0 * clock.sigma_s, 2e-3):
        notes.append(
            f"{names[1]}: clocks of joints and points agree to {abs(clock.offset_s):.3f} s, sigma "
            f"{1e3 * clock.sigma_s:.2g} ms"
        )
        return replace(clock, offset_s=0.0)
    ahead = "behind" if clock.offset_s < 0.0 else "ahead of"
    notes.append(
        f"{names[1]}: its clock is {abs(clock.offset_s):.3f} s {ahead} the joints', sigma {1e3 * clock.sigma_s:.2g} "
        f"ms, by "
        f"{clock.travels} travels (correlation of the speeds {clock.correlation:.2f}); taken into account"
    )
    if clock.drift:
        doubts.append(
            f"{names[1]}: its clock drifts against the joints' by {clock.drift * 1e6:.0f} ppm; the mean offset is taken"
        )
    return clock


def _of_this_arm(
    robot: Robot,
    joints: tuple[JointSeries, Array, Standstill],
    seen: list[PointSeries],
    other: Path,
    is_same: bool,
    notes: list[str],
    doubts: list[str],
) -> tuple[list[PointSeries], ClockOffset]:
    """Points from the first on that moves as the arm does, and its clock's offset. Raises RecordingError for none."""
    first_error: RecordingError | None = None
    for k, each in enumerate(seen):
        try:
            clock = _clock(robot, joints, (each, other), is_same, notes, doubts)
        except RecordingError as error:
            first_error = first_error or error
            continue
        if k:
            left_out = ", ".join(point.name for point in seen[:k])
            notes.append(f"{other}: points that do not move as this arm does are left out: {visible(left_out)}")
        return seen[k:], clock
    assert first_error is not None
    raise first_error


# ---- means -----------------------------------------------------------------------------------------------------------


def _point_means(seen: PointSeries, joint_s: Array, rest: Standstill, clock: ClockOffset) -> Means:
    """Means of the points in each phase, without its ends and without what still settles."""
    at = seen.time_s - clock.offset_s
    samples = []
    for start, end in zip(rest.starts_s(joint_s), rest.ends_s(joint_s), strict=True):
        margin = min(_MARGIN_S + 3.0 * clock.sigma_s, 0.25 * (end - start))
        first, last = np.searchsorted(at, [start + margin, end - margin])
        samples.append(seen.xyz[first:last])
    spreads = [mad_sigmas(s) for s in samples if len(s) >= 8]
    noise = np.maximum(np.median(spreads, axis=0), 1e-12) if spreads else np.full(3, np.inf)
    calm = []
    for each in samples:
        inner = trimmed(each, Phase(0, len(each) - 1), noise) if len(each) >= 8 and np.isfinite(noise).all() else None
        calm.append(each if inner is None else each[inner.first : inner.last + 1])
    return means_of(calm)


def _calm(name: str, means: Means, joint_s: Array, rest: Standstill, notes: list[str]) -> BoolArray:
    """Whether each phase has points; what has none is told."""
    has = ~np.isnan(means.mean[:, 0])
    missing = rest.starts_s(joint_s)[~has] - joint_s[0]
    if len(missing):
        when = numbers.in_short([f"{each:.1f} s" for each in missing], _NAMED)
        notes.append(f"{name}: {len(missing)} of {len(has)} stops have no point and are left out (at {when})")
    return np.asarray(has)


# ---- tables ----------------------------------------------------------------------------------------------------------


def _rest_note(file: Path, series: JointSeries, rest: Standstill) -> str:
    spans = rest.ends_s(series.time_s) - rest.starts_s(series.time_s)
    rate = 1.0 / float(np.median(np.diff(series.time_s)))
    brief = f"; {rest.brief} shorter than {LEAST_S:g} s are left out" if rest.brief else ""
    return (
        f"{file}: {len(series)} joint states of {series.source} in {series.time_s[-1] - series.time_s[0]:.1f} s "
        f"({rate:.0f} Hz); "
        f"the arm stands {len(rest.phases)} times, for {spans.min():.1f} to {spans.max():.1f} s, where no joint moves "
        f"by more "
        f"than {100.0 * rest.threshold:.2g} % of its range within {rest.window_s:.2g} s{brief}"
    )


def _sides(series: JointSeries, columns: Sequence[Column], rest: Standstill) -> Array:
    """Direction (K, n) from which each joint came to each phase, 1 or -1; 0 where it had not moved before."""
    least = _least_motion(series.values, columns)
    medians = (np.median(series.values[phase.first : phase.last + 1], axis=0) for phase in rest.phases)
    return np.array([approach_of(series.values, p, m, least) for p, m in zip(rest.phases, medians, strict=True)])


def _with_known_sides(series: JointSeries, sides: Array, kept: BoolArray, notes: list[str]) -> BoolArray:
    """Phases to keep: a few at the beginning are given up where those behind them have known approaches."""
    unknown = kept & (sides == 0.0).any(axis=1)
    left = kept.sum() - unknown.sum()
    if not unknown.any() or left < max(_FEW, 0.8 * kept.sum()):
        return kept
    named = ", ".join(f"p{k + 1}" for k in np.flatnonzero(unknown))
    notes.append(
        f"{series.source}: {named} left out: not every joint had moved before, so from which side it came is not known"
    )
    return np.asarray(kept & ~unknown)


def _joint_table(
    path: Path,
    series: JointSeries,
    columns: Sequence[Column],
    rest: Standstill,
    sides: Array,
    kept: BoolArray,
    notes: list[str],
) -> UserTable:
    """Table of the joints with time, approach, torques and temperatures, a row a phase that is kept."""
    means = means_of([series.values[phase.first : phase.last + 1] for phase in rest.phases])
    with_sides = bool((sides[kept] != 0.0).all())
    if not with_sides:
        notes.append(
            f"{series.source}: from which side the joints came is not known of all poses; columns approach are left out"
        )
    n = len(columns)
    middle = 0.5 * (rest.starts_s(series.time_s) + rest.ends_s(series.time_s)) - series.time_s[0]
    names = [_name(column) for column in columns]
    table: dict[str, list[str]] = {"pose": [f"p{k + 1}" for k in range(len(rest.phases))]}
    table |= {name: [repr(float(v)) for v in means.mean[:, k]] for k, name in enumerate(names)}
    table["time_s"] = [repr(round(float(t), 3)) for t in middle]
    if with_sides:
        table |= {f"approach{k + 1}": [str(int(s)) for s in sides[:, k]] for k in range(n)}
    table |= _conditions(series, columns, rest, notes)
    rows = [k for k in range(len(rest.phases)) if kept[k]]
    cells = tuple(tuple(column[k] for column in table.values()) for k in rows)
    return UserTable(path, tuple(table), cells, tuple(k + 1 for k in rows), True)


def _least_motion(values: Array, columns: Sequence[Column]) -> Array:
    whole = np.ptp(values, axis=0)
    scale = np.array([1.0 if c.unit == "rad" else 1.0 / ANGLES_RAD["deg"] if c.unit == "deg" else 0.0 for c in columns])
    return np.where(scale > 0.0, _MOVED * scale, 5e-4 * whole)


def _conditions(
    series: JointSeries, columns: Sequence[Column], rest: Standstill, notes: list[str]
) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for k, column in enumerate(columns):
        for key, name in (("effort", f"torque{k + 1}_nm"), ("temperature", f"temperature_joint{k + 1}_c")):
            values = series.conditions.get(f"{key} {column.name}")
            if values is not None and np.isfinite(values).all():
                each = [float(values[phase.first : phase.last + 1].mean()) for phase in rest.phases]
                sign = column.sign if key == "effort" else 1.0
                out[name] = [repr(sign * value) for value in each]
    if any(name.startswith("torque") for name in out):
        notes.append(
            f"{series.source}: efforts are taken for torques in Nm, as sensor_msgs/JointState has them; where the "
            f"driver writes "
            "currents, leave them out by --map 'torque*_nm=ignore'"
        )
    return out


def _point_table(
    path: Path, seen: Sequence[PointSeries], means: Sequence[Means], kept: BoolArray, ids: list[str]
) -> UserTable:
    """Table of the points, a row for each target of a phase that is kept."""
    with_targets = len(seen) > 1
    unit = f" [{seen[0].unit}]" if seen[0].unit else ""
    header = ("pose", *(("target",) if with_targets else ()), f"x{unit}", f"y{unit}", f"z{unit}")
    wanted, rows, lines = set(ids), [], []
    for series, found in zip(seen, means, strict=True):
        for k in np.flatnonzero(kept):
            if f"p{k + 1}" in wanted and np.isfinite(found.mean[k]).all():
                xyz = (repr(float(v)) for v in found.mean[k])
                rows.append((f"p{k + 1}", *((series.label,) if with_targets else ()), *xyz))
                lines.append(int(k) + 1)
    return UserTable(path, header, tuple(rows), tuple(lines), True)


def _means_note(name: str, means: Means, kept: BoolArray, unit_mm: float) -> list[str]:
    """How many points were averaged at each stop, and how exact the means are while the arm stands.

    This sigma is not declared as the dataset's noise: what changes from stop to stop is not in it, and with it as the
    noise arms that are only less repeatable by 0.03 mm would be told to have an unknown cause.
    """
    counts = means.counts[kept]
    of_each = f"{counts.min():.0f} to {counts.max():.0f} points a stop are averaged"
    if not means.scatter.any():
        return [f"{name}: {of_each}"]
    scatter_mm = unit_mm * rms(means.scatter)
    sigma_mm = unit_mm * rms(means.sigma[kept])
    wild = f"; {means.left_out} outlying points are left out" if means.left_out else ""
    return [
        f"{name}: {of_each}: one scatters by {scatter_mm:.3g} mm, {means.tau:.1f} in a row tell as much as one, so "
        f"that "
        f"a mean has sigma {sigma_mm:.2g} mm each axis; what changes from stop to stop is not in it, so the noise "
        f"stays "
        f"undeclared (--sigma){wild}"
    ]


def _of_controller(
    robot: Robot, series: JointSeries, q: Array, rest: Standstill, points: Sequence[PointSeries]
) -> list[tuple[str, float]]:
    """Poses that the controller computed, by name, with how far they are from the robot's table, mm."""
    out = []
    for own in (each for each in points if each.is_controllers_own and spread_of(each.xyz) > 0.0):
        mean = _point_means(own, series.time_s, rest, ClockOffset(0.0, 0.0, 1.0)).mean
        known = np.isfinite(mean).all(axis=1)
        if known.any():
            at = _mean_q(q, rest)[known]
            off_mm = table_disagreement_mm(robot, at, mean[known] * _unit_mm(robot, at, mean[known], own))
            out += [] if off_mm is None else [(own.name, off_mm)]
    return out


def _computed(
    robot: Robot, q: Array, rest: Standstill, points: tuple[Array, float], kept: BoolArray, name: str
) -> list[str]:
    """Doubt where the points agree with the nominal arm as none that was measured does.

    points  # (K, 3) of each phase, and the mm of their unit
    """
    mean, unit_mm = points
    sample = sample_of(_mean_q(q, rest)[kept], mean[kept] * unit_mm)
    if sample.is_enough and misfit_mm(robot, sample) < _COMPUTED_MM:
        return [f"{name}: agrees with the nominal arm to {_COMPUTED_MM:g} mm: computed from the joints, not measured?"]
    return []
