"""Which joints and which points of a recording are the arm's and the measured ones."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.dataset_import.columns import Column, Meaning, kind_of_marker, recognise
from calib.dataset_import.markers import STANDS_STILL, spread_of
from calib.errors import visible
from calib.extras.logs.bags import is_bag
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, lost_rows
from calib.kinematics.robot import Robot
from calib.rendering import numbers

_NAMED = 8  # topics or times that a sentence names
_FEWEST_ROWS = 10
_RARE = 0.1  # of the points seen most often


def in_short(names: Sequence[str], most: int = _NAMED) -> str:
    """Names as a list of a few, without hidden characters."""
    return visible(", ".join(names[:most]))


def shown(file: Path, seen: PointSeries) -> str:
    """File of a point, with its topic or columns where it has a name."""
    return f"{file}: {visible(seen.name)}" if seen.name else str(file)


def arm_joints(
    file: Path, read: Recording, topic: str, robot: Robot, mapping: Mapping[str, Meaning], notes: list[str]
) -> tuple[JointSeries, list[Column]]:
    """Series with the arm's joints, and the column of each. Raises RecordingError."""
    wanted = f"{robot.n_joints} joints are needed, {', '.join(joint.name for joint in robot.joints)}"
    if not read.joints:
        raise RecordingError(
            f"{file}: holds no joint states (sensor_msgs/JointState, or a column a joint); {wanted}; found "
            f"{_holds(read) or 'nothing'}"
        )
    series = [each for each in read.joints if topic in ("", each.source)]
    if not series:
        named = ", ".join(each.source for each in read.joints)
        raise RecordingError(f"{file}: no joint states in {topic!r}; there are {named}")
    possible: list[tuple[JointSeries, list[Column]]] = []
    faults: list[str] = []
    for each in series:
        of_names = {key: value for key, value in mapping.items() if "*" in key or key in each.names}
        meant = recognise(each.names, robot, of_names)
        found = [meant.columns.get(f"q{k + 1}") for k in range(robot.n_joints)]
        faults += [f"{file}: {each.source}: {fault}" for fault in meant.faults]
        if all(found):
            possible.append((each, [column for column in found if column is not None]))
    if not possible:
        has = "; ".join(f"{each.source} has {', '.join(each.names[:20])}" for each in series)
        told = f"{file}: {wanted}; {has}; tell with --map {series[0].names[0]}=q1 ..."
        raise RecordingError(visible((*faults, told)[0]))

    def likely(pair: tuple[JointSeries, list[Column]]) -> tuple[bool, int]:
        return not re.search(r"(^|/)joint_states$", pair[0].source), pair[0].source.count("/")

    possible.sort(key=lambda pair: (*likely(pair), -len(pair[0])))
    chosen, columns = possible[0]
    others = ", ".join(pair[0].source for pair in possible[1:])
    if others and likely(possible[0]) == likely(possible[1]):
        raise RecordingError(
            f"{file}: several topics hold the joints, {chosen.source}, {others}; say which by --joints "
            f"{file}#{chosen.source}"
        )
    if others:
        notes.append(f"{file}: joints are taken from {chosen.source}, not from {others}")
    places = [chosen.names.index(column.name) for column in columns]
    kept = chosen.kept(np.asarray(np.isfinite(chosen.values[:, places]).all(axis=1)))
    if len(kept) < _FEWEST_ROWS:
        raise RecordingError(f"{file}: {chosen.source} has {len(kept)} rows with all joints; record the whole run")
    unused = [name for k, name in enumerate(chosen.names) if k not in places]
    if unused and is_bag(file):
        notes.append(f"{file}: other joints are left out: {in_short(unused)}")
    if read.others:
        notes.append(f"{file}: not read: {visible(numbers.in_short(read.others, _NAMED))}")
    told_units = [
        replace(column, unit=column.unit or (chosen.unit and ("m", chosen.unit)[joint.is_revolute]))
        for column, joint in zip(columns, robot.joints, strict=True)
    ]
    return replace(kept, names=tuple(column.name for column in columns), values=kept.values[:, places]), told_units


def measured_points(file: Path, read: Recording, wanted: str, notes: list[str], doubts: list[str]) -> list[PointSeries]:
    """Series of the measured point, several only where they are the robot's own targets. Raises RecordingError."""
    own = [each.name for each in read.points if each.is_controllers_own]
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
        if own and not chosen:
            raise RecordingError(
                f"{file}: holds no measured points, only poses that are named as the controller's own, "
                f"{in_short(own)}; give the points by --points FILE, or one of these by --points {file}#{own[0]}"
            )
        if own:
            notes.append(f"{file}: poses of the controller itself measure nothing and are left out: {in_short(own)}")
    if not chosen:
        raise RecordingError(
            f"{file}: holds no measured points (PointStamped, PoseStamped, TransformStamped, tf2_msgs/TFMessage, "
            f"Marker, arrays of detections with poses, or columns x, y, z) that move; found "
            f"{_holds(read) or 'nothing else'}; give them by --points FILE"
        )

    def without(chosen: list[PointSeries], left_out: Sequence[PointSeries], why: str) -> list[PointSeries]:
        if left_out:
            notes.append(f"{file}: points that {why} are left out: {in_short([each.name for each in left_out])}")
        return [each for each in chosen if each not in left_out]

    widest = max(spread_of(each.xyz) for each in chosen)
    static = [each for each in chosen if spread_of(each.xyz) < STANDS_STILL * widest]
    chosen = without(chosen, static, "stand still")
    sources = list(dict.fromkeys(each.source for each in chosen))
    stems = {source: re.escape(source.removesuffix(" Position")) for source in sources}
    body = next((s for s, stem in stems.items() if all(re.match(rf"{stem}\b", each) for each in sources)), None)
    if len(sources) > 1 and body is not None:  # a rigid body of motion capture before its own markers
        others = [source for source in sources if source != body]
        notes.append(f"{file}: the point is {visible(body)}; its markers are left out: {visible(', '.join(others))}")
        chosen = [each for each in chosen if each.source == body]
    elif len({kind_of_marker(source) for source in sources}) > 1:
        raise RecordingError(
            f"{file}: several sources of points, {in_short(sources)}; say which by --points '{file}#{sources[0]}'"
        )
    chosen.sort(key=lambda each: -len(each))
    chosen = without(chosen, [each for each in chosen if len(each) < _RARE * len(chosen[0])], "were seldom seen")
    if len(chosen) > 1:
        notes.append(
            f"{file}: {len(chosen)} points are measured, {in_short([each.name for each in chosen])}; "
            f"one alone by --points '{file}#{chosen[0].name}'"
        )
        source = "" if len(sources) > 1 else chosen[0].source
        labels = zip(chosen, _labels(chosen), strict=True)
        chosen = [replace(each, source=source, label=label) for each, label in labels]
    return [_kept(file, each, notes) for each in chosen]


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
    notes.append(f"{shown(file, seen)}: {lost.sum()} of {len(seen)} points are zeros or held values and left out")
    return replace(seen, time_s=seen.time_s[~lost], xyz=seen.xyz[~lost])


def _holds(read: Recording) -> str:
    return in_short([*(each.name or "x, y, z" for each in read.points), *read.others], 2 * _NAMED)
