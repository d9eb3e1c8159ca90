"""Plan of an import: the meaning of each column with its reason, and all faults at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.array_types import Array, Vector
from calib.consistency.own_pose import own_pose_columns, table_disagreement_mm
from calib.consistency.own_pose import told as own_pose_told
from calib.dataset.dataset import Dataset
from calib.dataset_import.bad_rows import (
    NOTHING_LEFT_OUT,
    LeftOutRows,
    left_out_rows,
    too_many_bad_rows,
    without_remarks,
)
from calib.dataset_import.columns import Meaning, Recognised, are_names, length_column
from calib.dataset_import.convention import Sheet, has_known_unit, settled, with_told_commands
from calib.dataset_import.flange_columns import has_flange_poses
from calib.dataset_import.markers import beside_each_other, in_rows, with_targets, with_tool_named
from calib.dataset_import.measured import MeasuredPoses
from calib.dataset_import.reading import (
    ImportReport,
    LeftOutRow,
    joint_values,
    named_by_cells,
    named_by_values,
    named_places,
    of_one_place,
    placement_columns,
    point_of_each_pose,
    point_values,
    points_unit,
    pose_ids,
    recognised,
    require_near_spread,
    require_poses,
    rows_of_points,
    without_strangers,
)
from calib.dataset_import.sources import ImportSource
from calib.dataset_import.tool_offset import with_tool_offset
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, joint_units, length_unit
from calib.dataset_import.writing import Content, checked, lengths_text, points_text, poses_text
from calib.errors import CalibError, DatasetError
from calib.plugins import contributions, load
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile
from calib.robot_formats.urdf.meshes import stl_of_links
from calib.text_files.user_table import Fault, RowFault, UserTable, load_table, split_unit

_NO_ROBOT = "no robot is chosen: give a URDF, a robot.toml or another form, or choose a built-in one"
_EXAMPLES = 3
_COMPUTED_MM = 5e-3  # rms to the robot's table, below which no measured point is
_MOST_SHOWN = 60  # columns of a table


@dataclass(frozen=True)
class ImportSources:
    """Robots, tables and scans to import; `points` is None where the joints' table or scans contain the points."""

    robots: tuple[RobotReading, ...]  # one robot by each convention that its file may be in; (): none yet
    joints: Path | None
    points: Path | None = None
    scans: Mapping[str, Path] = field(default_factory=dict)  # a file by its stem
    mapping: Mapping[str, Meaning] = field(default_factory=dict)
    faults: tuple[str, ...] = ()  # of a robot that could not be read
    point_sigma_mm: float | None = None  # of one measured point, each axis; None where it is not known
    place_sigma_mm: float | None = None  # of each known place that was visited; None where it is not known
    tool_mm: Vector | None = None  # the measured point from the end of the robot's file, see `with_tool_offset`
    skip_bad_rows: bool = False
    tables: Mapping[Path, UserTable] = field(default_factory=dict)  # of a plug-in, by the path that names them
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    joint_unit_is_unknown: bool = False  # whatever their size: they may be no angles at all
    measured: MeasuredPoses | None = None  # by a plug-in, in place of points and scans


@dataclass(frozen=True)
class PlannedColumn:
    """Planned use of a table's column, with its reason; `meaning` is None for a column kept unchanged or left out."""

    table: Path
    name: str
    examples: tuple[str, ...]
    meaning: Meaning | None
    why: str


@dataclass(frozen=True)
class ImportPlan:
    """Result of planning an import: notes, doubts, faults, and the content to write, None where there are faults."""

    robot: RobotFile | None
    columns: tuple[PlannedColumn, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    faults: tuple[str, ...]
    content: Content | None
    poses: int = 0
    preview: Dataset | None = None  # the dataset that comes out; None where there are faults
    bad_rows: tuple[RowFault, ...] = ()  # rows that cannot be read, each with its first fault
    are_left_out: bool = False  # whether the dataset comes out without the bad rows
    has_too_many_bad_rows: bool = False
    left_out: tuple[LeftOutRow, ...] = ()  # rows of points that belong to no pose

    @property
    def can_leave_out(self) -> bool:
        """Whether there are bad rows that can be left out, and are not yet."""
        return bool(self.bad_rows) and not self.are_left_out and not self.has_too_many_bad_rows

    def require(self) -> Content:
        """Content to write. Raises DatasetError with all faults, a line each."""
        if self.content is not None and not self.faults:
            return self.content
        report = ImportReport(None, list(self.faults) or ["nothing to import was given"])
        report.raise_all()
        raise AssertionError


def plan_import(sources: ImportSources) -> ImportPlan:
    """Plan of an import; mistakes in the user's files are collected in `faults` and not raised.

    With `skip_bad_rows` the rows that cannot be read are left out, and noted, unless they are more than half of a
    table's rows.
    """
    if sources.tool_mm is not None:
        robots = [replace(each, robot=with_tool_offset(each.robot, sources.tool_mm)) for each in sources.robots]
        sources = replace(sources, robots=tuple(robots))
    of_form = None if sources.tables else _form_of(sources)
    if of_form is not None:
        report = _new_report(sources)
        if not sources.robots:
            report.faults += [] if sources.faults else [_NO_ROBOT]
            return _plan(report, sources, {}, None)
        try:
            sources = load(of_form.tables)(sources)
        except DatasetError as error:
            report.fault(str(error))
            return _plan(report, sources, {}, None)
    report = _new_report(sources)
    report.notes += [*_tool_note(sources), *_measured_notes(sources)]
    plan = _plan_of_rows(report, sources, NOTHING_LEFT_OUT)
    bad = report.row_faults
    if not bad:
        return plan
    tables = _tables_with_rows(sources)
    too_many = too_many_bad_rows(tables, bad)
    if too_many or not sources.skip_bad_rows:
        faults = (*(too_many if sources.skip_bad_rows else ()), *plan.faults)
        return replace(plan, faults=faults, bad_rows=tuple(bad), has_too_many_bad_rows=bool(too_many))
    left_out = left_out_rows(tables, bad, _pose_columns(sources, tables))
    report = _new_report(sources)
    report.notes += [*left_out.notes, *_tool_note(sources), *_measured_notes(sources)]
    plan = _plan_of_rows(report, sources, left_out)
    return replace(plan, bad_rows=tuple(bad), are_left_out=True)


def _form_of(sources: ImportSources) -> ImportSource | None:
    """Plug-in's form that makes tables of the joints' file; None for a table of poses."""
    path, mapping = sources.joints, sources.mapping
    forms = () if path is None else contributions(ImportSource)
    return next((form for form in forms if load(form.reads)(path, mapping)), None)


def _new_report(sources: ImportSources) -> ImportReport:
    """Report for one pass over the sources, with the faults of the robot and what a source told."""
    robot = sources.robots[0].robot.robot if sources.robots else None
    return ImportReport(robot, list(sources.faults), list(sources.notes), list(sources.doubts))


def _tool_note(sources: ImportSources) -> list[str]:
    """Note on where the measured point is taken to be, if the user has given it."""
    if sources.tool_mm is None or not sources.robots:
        return []
    chain = sources.robots[0].robot.chain
    end = "the flange's frame" if chain is None or not chain.tip else chain.tip
    x, y, z = sources.tool_mm
    return [f"{sources.robots[0].robot.robot.name}: the measured point is at {x:g}, {y:g}, {z:g} mm in {end}, as given"]


def _measured_notes(sources: ImportSources) -> tuple[str, ...]:
    """Notes on what a plug-in has measured."""
    return () if sources.measured is None else sources.measured.notes


def _tables_with_rows(sources: ImportSources) -> list[UserTable]:
    """Tables of joints and points, without their faults; () for one that cannot be read."""
    paths = (sources.joints, sources.points)
    tables = (_loaded(ImportReport(None), sources, path) for path in paths if path is not None)
    return list({table.path.resolve(): table for table in tables if table is not None}.values())


def _pose_columns(sources: ImportSources, tables: Sequence[UserTable]) -> list[str]:
    """Column of each table that names the pose; "" where there is none."""
    robot = sources.robots[0].robot.robot if sources.robots else None
    found = [
        recognised(ImportReport(robot), table, sources.mapping, positions=k > 0, joints=k == 0)
        for k, table in enumerate(tables)
    ]
    if len(found) == 2:
        found = list(named_by_values(tables[0], found[0], tables[1], found[1]))
    return [meant.columns["pose"].name if "pose" in meant.columns else "" for meant in found]


def _plan_of_rows(report: ImportReport, sources: ImportSources, left_out: LeftOutRows) -> ImportPlan:
    """Plan of an import without the rows that are left out."""
    table = _loaded(report, sources, sources.joints, left_out)
    same = sources.points is None or (
        sources.joints is not None and sources.points.resolve() == sources.joints.resolve()
    )
    other = None if same else _loaded(report, sources, sources.points, left_out)
    tables = [each for each in (table, other) if each is not None]
    for column in sources.mapping:
        if tables and "*" not in column and not any(column in each.columns for each in tables):
            report.fault(
                f"--map {column}=...: no such column; there are {', '.join(c for t in tables for c in t.columns)}"
            )
    if not sources.robots and not sources.faults:
        report.fault(_NO_ROBOT)
    if sources.joints is None:
        report.fault(
            "no table of joint values was found: a CSV with a column a joint, q1, q2 ..., or the joints' names"
        )
    if table is None:
        return _plan(report, sources, {}, None)
    wants_points = same and not sources.scans and sources.measured is None
    meant = recognised(report, table, sources.mapping, positions=wants_points)
    columns = {table.path: (table, meant)}
    of_points = meant
    if other is not None:
        of_points = recognised(report, other, sources.mapping, positions=True, joints=False)
        meant, of_points = named_by_values(table, meant, other, of_points)
        columns[table.path] = (table, meant)
        by_name = None if "pose" in of_points.columns else named_places(report, table, meant, other)
        if by_name is not None:
            other = by_name
            of_points = recognised(report, other, sources.mapping, positions=True, joints=False)
        elif "pose" in meant.columns:
            of_points = named_by_cells(report, table.text(meant.columns["pose"].name), other, of_points)
        else:
            of_points = named_by_cells(report, [], other, of_points)
        other = without_strangers(report, table, pose_ids(ImportReport(None), table, meant), other, of_points)
        columns[other.path] = (other, of_points)
    elif not same:
        return _plan(report, sources, columns, None)
    if report.robot is not None and (wants_points or other is not None):
        meant, other, of_points = _with_named_targets(report, columns, table, meant, other, of_points)
    plan = _with_numbers(report, sources, columns, table, meant, other, of_points, left_out)
    for i, fault in enumerate(report.faults):  # the file has its markers in the rows of the joints
        if isinstance(fault, RowFault) and other is not None and fault.path == other.path:
            report.faults[i] = replace(fault, path=sources.points or table.path)
    return plan


def _with_named_targets(
    report: ImportReport,
    columns: dict[Path, tuple[UserTable, Recognised]],
    table: UserTable,
    meant: Recognised,
    other: UserTable | None,
    of_points: Recognised,
) -> tuple[Recognised, UserTable | None, Recognised]:
    """Columns of the joints' table; table of points with a row for each marker, the tool's named "jig"; its columns.

    Markers in the rows of the joints are no further columns of these.
    """
    assert report.robot is not None
    points = table if other is None else other
    markers = beside_each_other(of_points, points.columns)
    if markers:
        ids = pose_ids(ImportReport(None), table, meant)
        rows = rows_of_points(report, table, ids, other, of_points)
        if -1 in rows or len(rows) != len(points):
            return meant, other, of_points
        of_markers = {name for each in markers.values() for name in each}
        other, of_points = in_rows(report, points, markers, [ids[row] for row in rows])
        if points is table:
            meant = replace(meant, rest=tuple(name for name in meant.rest if name not in of_markers))
            columns[table.path] = (table, meant)
        columns[other.path] = (other, of_points)
    if other is not None and "target" in of_points.columns and all(axis in of_points.columns for axis in "xyz"):
        other = with_tool_named(report, other, of_points, report.robot)
        columns[other.path] = (other, of_points)
    return meant, other, of_points


def _loaded(
    report: ImportReport, sources: ImportSources, path: Path | None, left_out: LeftOutRows = NOTHING_LEFT_OUT
) -> UserTable | None:
    """Table of a file without the rows that are left out, its faults reported; None where it cannot be read."""
    if path is None:
        return None
    if path in sources.tables:
        return sources.tables[path]
    lines = left_out.lines(path)

    def fault(found: Fault) -> None:
        if not (isinstance(found, RowFault) and found.line in lines):
            report.fault(found)

    try:
        table = load_table(
            path, fault, any_encoding=True, is_names=lambda names: are_names(names, report.robot, sources.mapping)
        )
    except DatasetError as error:
        report.fault(str(error))
        return None
    if table.is_turned:
        report.notes.append(
            f"{path}: its names stand below each other and each pose is a column: it is turned, and a line "
            "that is told of it is a column's number"
        )
    table, remarks = without_remarks(table)
    report.notes += [remarks] if remarks else []
    return table.without(lines) if lines else table


def _with_numbers(
    report: ImportReport,
    sources: ImportSources,
    columns: dict[Path, tuple[UserTable, Recognised]],
    table: UserTable,
    meant: Recognised,
    other: UserTable | None,
    of_points: Recognised,
    left_out: LeftOutRows,
) -> ImportPlan:
    """Plan of an import from tables with recognised columns: their numbers, units, and the pose of each point."""
    q_file = joint_values(report, table, meant)
    by_plugin = sources.measured
    seen = None if by_plugin is not None else point_values(report, other or table, of_points, needed=not sources.scans)
    ids = pose_ids(report, table, meant)
    row_of = rows_of_points(report, table, ids, other, of_points)
    if q_file is None or report.robot is None or not np.isfinite(q_file).any():
        return _plan(report, sources, columns, None, len(table))
    n = report.robot.n_joints
    names = [f"q{k + 1}" for k in range(n)]
    near = None if seen is None else point_of_each_pose(q_file, seen, row_of)
    units, how = joint_units(report.robot, q_file, [meant.columns[name].unit for name in names], near)
    report.notes.append(
        f"{table.path}: joints are {', '.join(meant.columns[name].name for name in names)}"
        + (f"; {how}" if how else f" in {' and '.join(sorted(set(units)))} by their names")
    )
    columns[table.path] = (table, _with_units(meant, names, units, _short(how)))
    if other is None:
        of_points = columns[table.path][1]
    scale = np.array([ANGLES_RAD.get(unit) or LENGTHS_MM[unit] for unit in units])
    commanded = q_file * scale
    try:
        told = [with_told_commands(each, meant, scale) for each in sources.robots]
    except DatasetError as error:
        report.fault(str(error))
        return _plan(report, sources, columns, None, len(table))
    q = told[0].robot.robot.joints_of(commanded)
    if not sources.tables:
        require_poses(report, table, meant, q)
    sheet, off, unit = None, 1.0, "mm"
    setups = table.text(meant.columns["setup"].name) if "setup" in meant.columns else []
    if seen is not None and near is not None:
        unit, how, off = points_unit(report, other or table, of_points, near, q)
        of_points = _with_units(of_points, list("xyz"), [unit] * 3, "the arm's tool spreads so" if how else "")
        columns[(other or table).path] = (other or table, of_points)
        place = of_one_place(near, row_of, (other or table, of_points), setups)
        sheet = Sheet(tuple(ids), q, place * LENGTHS_MM[unit])
        seen = seen * LENGTHS_MM[unit]
    if sources.joint_unit_is_unknown and not has_known_unit(report, told, sheet, meant, table.path):
        return _plan(report, sources, columns, None, len(table))
    taken = settled(report, told, sheet, meant, table.path, placement_columns(table, meant, other))
    columns[table.path] = (table, taken.applied(columns[table.path][1], units))
    robot_file = taken.robot
    commanded = commanded[:, list(taken.joints.order)]
    q = robot_file.robot.joints_of(commanded)
    if other is not None and seen is not None and "target" in of_points.columns:
        robot, kept = with_targets(report, robot_file.robot, other, of_points, row_of, q, seen, setups)
        robot_file = replace(robot_file, robot=robot)
        other, seen, row_of = other.of_rows(kept), seen[kept], [row_of[i] for i in kept]
    report.robot = robot_file.robot
    if sheet is not None and off > 1.0 and near is not None:
        require_near_spread(report, other or table, of_points, *length_unit(report.robot, q, near))
    if other is not None and of_points.rest:
        report.notes.append(f"{other.path}: other columns are left out: {', '.join(of_points.rest)}")
    if sheet is not None and other is None and has_flange_poses(table):
        known = np.isfinite(sheet.points_mm).all(axis=1) & np.isfinite(q).all(axis=1)
        off_mm = table_disagreement_mm(report.robot, q[known], sheet.points_mm[known])
        if off_mm is not None and off_mm < _COMPUTED_MM:
            report.doubts.append(
                f"{table.path}: its points agree with the robot's table to {off_mm:.1g} mm, and turns stand beside "
                "them: they are the pose that the controller computes from the joints and measure nothing; give "
                "measured ones by --points FILE"
            )
    measured = None if near is None else np.asarray(np.isfinite(near).all(axis=1))
    if length_column(of_points) is not None:
        measured = np.isin(np.arange(len(ids)), row_of)
    _compare_with_controller(report, table, q)
    if by_plugin is not None and not report.faults:
        try:
            by_plugin = by_plugin.settled(report.robot, ids, q, setups)
            report.notes += by_plugin.notes[len(_measured_notes(sources)) :]
        except CalibError as error:
            report.fault(str(error))
            return _plan(report, sources, columns, None, len(table), robot_file)
    if by_plugin is not None:
        measured = np.isin(ids, by_plugin.names)
    poses_csv = poses_text(report, table, columns[table.path][1], ids, commanded, sources.scans, measured)
    of_lengths = None
    if length_column(of_points) is not None:
        of_lengths = lengths_text(report, other or table, of_points, [(i, ids[row]) for i, row in enumerate(row_of)])
    if report.faults:
        return _plan(report, sources, columns, None, len(table), robot_file)
    points_csv = of_lengths if by_plugin is None else by_plugin.points_text(ids)
    if seen is not None:
        points_csv = points_text(other or table, of_points, [ids[i] for i in row_of], seen)
    if points_csv is None and sources.point_sigma_mm is not None:
        report.doubts.append("the sigma of a measured point is not used: these data have scans and no measured points")
    meshes, of_meshes = stl_of_links(robot_file.meshes)
    report.notes += of_meshes
    content = Content(
        report.robot, poses_csv, points_csv, sources.scans, f"imported from {table.path.name}", sources.robots[0].path,
        point_sigma_mm=None if points_csv is None else sources.point_sigma_mm,
        place_sigma_mm=None if points_csv is None else sources.place_sigma_mm, notes=left_out.notes, measured=by_plugin,
        meshes=meshes,
    )  # fmt: skip
    try:
        preview = checked(content)
    except DatasetError as error:
        report.fault(f"{table.path}: {error}")
        return _plan(report, sources, columns, None, len(table), robot_file)
    return replace(_plan(report, sources, columns, content, len(table), robot_file), preview=preview)


def _compare_with_controller(report: ImportReport, table: UserTable, q: Array) -> None:
    """Note, or doubt, on whether the poses that the controller wrote down are those of the robot's table."""
    by_base = {split_unit(name)[0]: name for name in table.columns}
    found = own_pose_columns(list(by_base))
    if found is None or report.robot is None:
        return
    names = [by_base[base] for base in found]
    places = np.column_stack([table.numbers(name, lambda _: None) for name in names])
    known = np.isfinite(places).all(axis=1) & np.isfinite(q).all(axis=1)
    if not known.any():
        return
    unit = split_unit(names[0])[1]
    unit = unit if unit in LENGTHS_MM else length_unit(report.robot, q[known], places[known])[0]
    off_mm = table_disagreement_mm(report.robot, q[known], places[known] * LENGTHS_MM[unit])
    if off_mm is not None:
        agrees, sentence = own_pose_told(f"{table.path}: {names[0]} ...", off_mm)
        (report.notes if agrees else report.doubts).append(sentence)


def _short(how: str) -> str:
    """Reason for a unit, shortened for a table's cell."""
    return f"the largest is {how.rpartition(' ')[2]}" if how else ""


def _with_units(meant: Recognised, names: list[str], units: list[str], how: str) -> Recognised:
    """The recognised columns with the units that were found and the reason."""
    columns = dict(meant.columns)
    for name, unit in zip(names, units, strict=True):
        column = columns[name]
        if not column.unit:
            why = f"{column.why}; {unit}: {how}" if how else column.why
            columns[name] = replace(column, unit=unit, why=why)
    return Recognised(columns, meant.rest, meant.faults)


def _plan(
    report: ImportReport,
    sources: ImportSources,
    tables: Mapping[Path, tuple[UserTable, Recognised]],
    content: Content | None,
    poses: int = 0,
    robot: RobotFile | None = None,
) -> ImportPlan:
    columns = [planned for table, meant in tables.values() for planned in _planned(table, meant, sources.mapping)]
    if robot is None and sources.robots:
        robot = sources.robots[0].robot
    return ImportPlan(
        robot,
        tuple(columns),
        tuple(report.notes),
        tuple(report.doubts),
        tuple(map(str, report.faults)),
        content,
        poses,
        left_out=tuple(report.left_out),
    )


def _planned(table: UserTable, meant: Recognised, mapping: Mapping[str, Meaning]) -> list[PlannedColumn]:
    by_name = {column.name: column for column in meant.columns.values()}
    out = []
    for k, name in enumerate(table.columns[:_MOST_SHOWN]):
        examples = tuple(row[k] for row in table.rows[:_EXAMPLES])
        column = by_name.get(name)
        if column is None:
            ignored = name in mapping and mapping[name].name == "ignore"
            out.append(PlannedColumn(table.path, name, examples, None, "left out, as told" if ignored else ""))
            continue
        meaning = Meaning(column.meaning, column.unit, column.sign, column.offset, column.others)
        out.append(PlannedColumn(table.path, name, examples, meaning, column.why))
    return out
