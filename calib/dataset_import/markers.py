"""Several points measured at one pose: markers beside each other in a row, or rows of several targets.

The point that was measured most often is the tool's, "jig"; the others become further targets of the robot, at the
places on the arm where the nominal arm has them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.consistency.agreement import Sample, misfit_mm, nominal_places
from calib.dataset_import.columns import AS_MAPPED, Column, Recognised
from calib.dataset_import.place_columns import Markers, marker_columns
from calib.dataset_import.reading import ImportReport, MeantTable, coordinates
from calib.errors import visible
from calib.frames import apply, best_fit_transform, invert
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import TOOL_POINT, Robot, Target
from calib.kinematics.tool_point import tool_point_of, with_own_tool_point
from calib.robot_formats.chain.five_parameters import vector
from calib.statistics import group_numbers, rms_length
from calib.text_files.column_names import split_unit
from calib.text_files.user_table import UserTable

STANDS_STILL = 0.02  # of the widest point's spread, below which a point is not on the arm
_SAME = 2e-3  # of the spread, up to which two columns hold one point that was measured twice
_FEWEST = 8  # poses, by which the places of further targets are found
_FIXED = 5.0  # times the misfit of the tool's point, up to which a target's place scatters on the link that carries it
_FIXED_MM = 2.0
_CLEARLY = 0.5  # of the scatter on a later link, below which an earlier one carries a target
_COMPUTED_MM = 5e-3  # rms to the nominal arm, below which no measured point is
_LEAST_TOLERANCE_MM = 5.0
_NAMED = 8


def beside_each_other(meant: Recognised, names: Sequence[str]) -> Markers:
    """Columns x, y, z of each marker of a table with several in a row; {} where there is one, or --map names it."""
    found = marker_columns(names)
    chosen = tuple(meant.columns[axis].name for axis in "xyz" if axis in meant.columns)
    told = any(meant.columns[axis].why == AS_MAPPED for axis in "xyz" if axis in meant.columns)
    return {} if told or "target" in meant.columns or len(found) < 2 or chosen not in found.values() else found


def in_rows(
    report: ImportReport,
    table: UserTable,
    markers: Markers,
    poses: Sequence[str],
) -> MeantTable:
    """Table with a row for each marker of a pose in place of columns.

    poses  # name of each row's pose
    """  # fmt: skip
    units = {split_unit(name)[1] for columns in markers.values() for name in columns}
    if len(units) > 1:
        report.fault(f"{table.path}: line 1: its markers' columns have different units; give all of them in one")
    unit = min(units)
    rows, lines = [], []
    for i, pose in enumerate(poses):
        for label, columns in markers.items():
            cells = tuple(table.rows[i][table.columns.index(name)] for name in columns)
            if any(cells):
                rows.append((pose, f"marker{label}" if label.isdigit() else label, *cells))
                lines.append(table.lines[i])
    report.notes.append(f"{table.path}: {len(markers)} markers are in a row: {visible(', '.join(markers))}")
    names = ("pose", "target", *(f"{axis} [{unit}]" if unit else axis for axis in "xyz"))
    meant = {"pose": Column("pose", "pose"), "target": Column("target", "target")}
    meant |= {axis: Column(name, axis, unit) for axis, name in zip("xyz", names[2:], strict=True)}
    path = table.path.with_name(f"{table.path.name} (points)")
    made = UserTable(path, names, tuple(rows), tuple(lines), has_header=True)
    return MeantTable(made, Recognised(meant, (), ()))


def with_tool_named(report: ImportReport, points: MeantTable, robot: Robot) -> tuple[MeantTable, list[int]]:
    """Table of several targets without those that stand still, the most often measured one named "jig"; its old rows.

    Two that are one point are repeats of one target. Targets that robot.toml knows keep their names.
    """
    table, targets, column = points.table, points.cells("target"), points.named("target")
    known = {target.name for target in robot.targets} | {TOOL_POINT}
    if robot.carries_scanner or set(targets) <= known:
        return points, list(range(len(table)))
    xyz = coordinates(ImportReport(None), table, [*map(points.named, "xyz")])
    poses = points.cells("pose") or list(map(str, range(len(table))))
    of_each = {name: {p: i for i, (p, t) in enumerate(zip(poses, targets, strict=True)) if t == name}
               for name in dict.fromkeys(targets)}  # fmt: skip
    spreads = {name: spread_of(xyz[list(rows.values())]) for name, rows in of_each.items()}
    widest = max(spreads.values())
    still = [name for name, spread in spreads.items() if spread < STANDS_STILL * widest]
    if still:
        report.notes.append(f"{table.path}: points that stand still are left out: {visible(', '.join(still[:_NAMED]))}")
    counts = Counter(target for target in targets if target not in still)
    main = counts.most_common(1)[0][0]
    new = {name: name for name in counts}
    for name in counts:
        both = [(rows[p], i) for rows in (of_each[main],) for p, i in of_each[name].items() if p in rows]
        apart = [float(np.linalg.norm(xyz[i] - xyz[j])) for i, j in both]
        if name != main and name not in known and len(apart) > 1 and max(apart) < _SAME * widest:
            new[name] = main
    same = [name for name in new if new[name] != name]
    if same:
        report.notes.append(
            f"{table.path}: {visible(', '.join(same))} are at the place of {visible(main)}: repeats of it"
        )
    if not set(counts) & known:
        others = list(dict.fromkeys(name for name in new.values() if name != main))
        report.notes.append(
            f"{table.path}: the tool's point, jig, is {visible(main)}"
            + (f"; further targets are {visible(', '.join(others[:_NAMED]))}" if others else "")
            + f"; for another choice remove the rows or columns of the others, or name it {TOOL_POINT}"
        )
        new = {name: TOOL_POINT if to == main else to for name, to in new.items()}
    k = table.columns.index(column)
    kept = [i for i, target in enumerate(targets) if target in new]
    table = table.of_rows(kept)
    named = (new[targets[i]] for i in kept)
    rows = tuple((*r[:k], name, *r[k + 1 :]) for r, name in zip(table.rows, named, strict=True))
    return replace(points, table=replace(table, rows=rows)), kept


def with_targets(
    report: ImportReport,
    robot: Robot,
    points: MeantTable,
    row_of: Sequence[int],
    q: Array,
    xyz_mm: Array,
    station: Sequence[str],
) -> tuple[Robot, list[int]]:
    """Robot with the targets that a table names and it does not have, and the rows of the table that are kept.

    A target's place is the median of where the nominal arm has it, with the frame and the tool's point that fit best.
    One that is fixed to no link is left out, as is one that was computed from the joints.

    Args:
        row_of: row of joints of each point; -1 where there is none.
        q: (N, n) joint values, rad and mm.
        xyz_mm: (M, 3) points.
        station: setup of each row of joints; [] for one.
    """  # fmt: skip
    table, names = points.table, np.array(points.cells("target"))
    known = {target.name for target in robot.targets} | {TOOL_POINT}
    missing = [name for name in dict.fromkeys(names.tolist()) if name not in known]
    everything = list(range(len(names)))
    if not missing or robot.carries_scanner:
        return robot, everything
    row = np.asarray(row_of, dtype=int)
    usable = (row >= 0) & np.isfinite(xyz_mm).all(axis=1)
    usable[usable] &= np.isfinite(q[row[usable]]).all(axis=1)
    groups = group_numbers(station) if len(station) else np.zeros(len(q), dtype=np.int64)
    main = Counter(names[usable].tolist()).most_common(1)[0][0]
    rows = np.flatnonzero(usable & (names == main))
    if len(rows) < _FEWEST:
        report.fault(
            f"{table.path}: {main!r} was measured at {len(rows)} poses, too few to find where "
            f"{visible(', '.join(missing))} are on the arm; add [[targets]] with their "
            "names and xyz_mm to a robot.toml, or leave out their rows"
        )
        return robot, everything
    sample = Sample(q[row[rows]], xyz_mm[rows], groups[row[rows]])
    misfit, base_mm = nominal_places(robot, sample)
    base_T_scanner = {
        sample.group[of_group[0]]: invert(best_fit_transform(base_mm[of_group], sample.points_mm[of_group]))
        for of_group in sample.groups
        if len(of_group) > 2
    }
    found: list[Target] = []
    dropped: dict[str, str] = {}
    for name in missing:
        rows = np.flatnonzero(usable & (names == name))
        rows = rows[np.isin(groups[row[rows]], list(base_T_scanner))]
        if not len(rows):
            dropped[name] = "is at no pose of the others"
            continue
        in_base = np.array([apply(base_T_scanner[groups[row[i]]], xyz_mm[i]) for i in rows])
        scatter, place, joint = _on_link(robot, q[row[rows]], in_base)
        if scatter > max(_FIXED * misfit, _FIXED_MM):
            dropped[name] = f"is fixed to no link of this arm (it scatters by {scatter:.3g} mm at best)"
        elif misfit > _COMPUTED_MM > misfit_mm(robot, Sample(q[row[rows]], xyz_mm[rows], groups[row[rows]])):
            dropped[name] = "is computed from the joints and not measured"
        else:
            tolerance_mm = max(_LEAST_TOLERANCE_MM, 2.0 * scatter, 2.0 * misfit)
            found.append(Target(name, vector(np.round(place, 3)), round(tolerance_mm, 1), joint))
    for name, why in dropped.items():
        report.doubts.append(f"{table.path}: target {visible(name)} {why}; it is left out")
    if found:
        told = "; ".join(
            f"{visible(t.name)} at {', '.join(f'{v:.1f}' for v in t.xyz_mm)} mm in the frame of joint "
            f"{t.joint or robot.n_joints}"
            for t in found[:_NAMED]
        )
        report.notes.append(
            f"{table.path}: places of targets by the nominal arm, from which the fit moves them: {told}"
        )
    if main == TOOL_POINT:
        _, tool_mm, _ = _on_link(robot, sample.q, base_mm, last=True)
        off_mm = float(np.linalg.norm(tool_mm - tool_point_of(robot)))
        if off_mm > max(_LEAST_TOLERANCE_MM, 2.0 * misfit):
            robot = with_own_tool_point(robot, np.round(tool_mm, 3))
            at = ", ".join(f"{v:.1f}" for v in tool_mm)
            report.notes.append(
                f"{table.path}: jig is at {at} mm in the frame of joint {robot.n_joints}, {off_mm:.3g} mm from where "
                "the robot's file ends, and is written there"
            )
    return replace(robot, targets=(*robot.targets, *found)), [i for i in everything if names[i] not in dropped]


def _on_link(robot: Robot, q: Array, in_base_mm: Array, *, last: bool = False) -> tuple[float, Array, int | None]:
    """Scatter, place (3,) and joint of the link on which points (N, 3) scatter least; None for the last link."""
    chain = nominal_chain(robot, q)
    best: tuple[float, Array, int | None] = (np.inf, np.zeros(3), None)
    for k in [robot.n_joints] if last else range(robot.n_joints, 0, -1):
        frame = chain.base_T_frame[:, k]
        local = np.einsum("nji,nj->ni", frame[:, :3, :3], in_base_mm - frame[:, :3, 3])
        place = np.median(local, axis=0)
        scatter = rms_length(local - place)
        if scatter < _CLEARLY * best[0]:
            best = (scatter, place, None if k == robot.n_joints else k)
    return best


def spread_of(xyz: Array) -> float:
    """Root mean square distance of places (M, 3) from their median; 0 where none is known."""
    known = xyz[np.isfinite(xyz).all(axis=1)]
    return rms_length(known - np.median(known, axis=0)) if len(known) else 0.0
