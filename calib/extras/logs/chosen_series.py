"""Which joints and which points of a recording are the arm's and the measured ones."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.dataset_import.column_words import kind_of_marker
from calib.dataset_import.columns import Column, Meaning, recognise
from calib.dataset_import.markers import STANDS_STILL, spread_of
from calib.errors import visible
from calib.extras.logs.series import JointSeries, PointSeries, Recording, RecordingError, lost_rows
from calib.kinematics.robot import Robot
from calib.rendering import numbers

_NAMED = 8  # topics that a sentence names
_FEWEST_ROWS = 10


def _names(series: Sequence[PointSeries]) -> str:
    return visible(", ".join(each.name for each in series[:_NAMED]))


def shown(file: Path, seen: PointSeries) -> str:
    """File of a point, with its topic or columns where it has a name."""
    return f"{file}: {visible(seen.name)}" if seen.name else str(file)


def arm_joints(
    file: Path, read: Recording, topic: str, robot: Robot, mapping: Mapping[str, Meaning], notes: list[str]
) -> tuple[JointSeries, list[Column]]:
    """Series of the arm's joints, in order, and the column of each. Raises RecordingError."""
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
    possible: list[tuple[tuple[bool, int], JointSeries, list[Column]]] = []
    faults: list[str] = []
    for each in series:
        meant = recognise(each.names, robot, {k: m for k, m in mapping.items() if "*" in k or k in each.names})
        faults += [f"{file}: {each.source}: {fault}" for fault in meant.faults]
        wanted_names = [f"q{k + 1}" for k in range(robot.n_joints)]
        if set(wanted_names) <= set(meant.columns):
            rank = not re.search(r"(^|/)joint_states$", each.source), each.source.count("/")
            possible.append((rank, each, [meant.columns[name] for name in wanted_names]))
    if not possible:
        has = "; ".join(f"{each.source} has {', '.join(each.names[:20])}" for each in series)
        told = f"{file}: {wanted}; {has}; tell with --map {series[0].names[0]}=q1 ..."
        raise RecordingError(visible((*faults, told)[0]))
    possible.sort(key=lambda found: (found[0], -len(found[1])))
    rank, chosen, columns = possible[0]
    others = ", ".join(each.source for _, each, _ in possible[1:])
    if others and rank == possible[1][0]:
        raise RecordingError(
            f"{file}: several topics hold the joints, {chosen.source}, {others}; say which by --joints "
            f"{file}#{chosen.source}"
        )
    if others:
        notes.append(f"{file}: joints are taken from {chosen.source}, not from {others}")
    places = [chosen.names.index(column.name) for column in columns]
    kept = np.isfinite(chosen.values[:, places]).all(axis=1)
    if kept.sum() < _FEWEST_ROWS:
        raise RecordingError(f"{file}: {chosen.source} has {kept.sum()} rows with all joints; record the whole run")
    unused = [name for k, name in enumerate(chosen.names) if k not in places]
    if unused:
        notes.append(f"{file}: other joints are left out: {visible(', '.join(unused[:_NAMED]))}")
    if read.others:
        notes.append(f"{file}: not read: {visible(numbers.in_short(read.others, _NAMED))}")
    efforts = {name: values[kept] for name, values in chosen.efforts.items()}
    names, values = tuple(column.name for column in columns), chosen.values[kept][:, places]
    return JointSeries(chosen.source, chosen.time_s[kept], names, values, efforts), columns


def measured_points(file: Path, read: Recording, wanted: str, notes: list[str], doubts: list[str]) -> list[PointSeries]:
    """Series that may be the measured point, the one seen most often first. Raises RecordingError where none may."""
    own = [each for each in read.points if each.is_controllers_own]
    if wanted:
        chosen = [each for each in read.points if wanted in (each.name, each.source, each.label)]
        if not chosen:
            raise RecordingError(f"{file}: no points in {wanted!r}; there are {_names(read.points) or 'none'}")
        if any(each.is_controllers_own for each in chosen):
            doubts.append(
                f"{file}: {wanted} is named as a pose that the controller computes; it is used as measured, as asked"
            )
    else:
        chosen = [each for each in read.points if not each.is_controllers_own]
        if own and not chosen:
            raise RecordingError(
                f"{file}: holds no measured points, only poses that are named as the controller's own, {_names(own)}; "
                f"give the points by --points FILE, or one of these by --points {file}#{own[0].name}"
            )
        if own:
            notes.append(f"{file}: poses of the controller itself measure nothing and are left out: {_names(own)}")
    if not chosen:
        raise RecordingError(
            f"{file}: holds no measured points (PointStamped, PoseStamped, TransformStamped, tf2_msgs/TFMessage, "
            f"Marker, arrays of detections with poses, or columns x, y, z) that move; found "
            f"{_holds(read) or 'nothing else'}; give them by --points FILE"
        )

    spreads = [spread_of(each.xyz) for each in chosen]
    still = [each for each, spread in zip(chosen, spreads, strict=True) if spread < STANDS_STILL * max(spreads)]
    chosen = [each for each in chosen if each not in still]
    sources = list(dict.fromkeys(each.source for each in chosen))
    bodies = (s for s in sources if all(re.match(rf"{re.escape(s.removesuffix(' Position'))}\b", t) for t in sources))
    body = next(bodies, None)  # a rigid body of motion capture before its own markers
    if body is None and len({kind_of_marker(source) for source in sources}) > 1:
        raise RecordingError(
            f"{file}: several sources of points, {visible(', '.join(sources[:_NAMED]))}; say which by --points "
            f"'{file}#{sources[0]}'"
        )
    of_body = [each for each in chosen if body in (None, each.source)]
    for why, left_out in (
        ("stand still", still), (f"are markers of {visible(body or '')}", [e for e in chosen if e not in of_body])
    ):  # fmt: skip
        if left_out:
            notes.append(f"{file}: points that {why} are left out: {_names(left_out)}")
    return [_kept(file, each, notes) for each in sorted(of_body, key=len, reverse=True)]


def _kept(file: Path, seen: PointSeries, notes: list[str]) -> PointSeries:
    """Points without what was written while the target was lost."""
    lost = lost_rows(seen.xyz)
    if not lost.any() or lost.all():
        return seen
    notes.append(f"{shown(file, seen)}: {lost.sum()} of {len(seen)} points are zeros or held values and left out")
    return replace(seen, time_s=seen.time_s[~lost], xyz=seen.xyz[~lost])


def _holds(read: Recording) -> str:
    return visible(", ".join([*(each.name or "x, y, z" for each in read.points), *read.others][: 2 * _NAMED]))
