"""Plan of an import: the meaning of each column with its reason, and all faults at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from calib.array_types import Array, Vector
from calib.consistency.own_pose import agreement_note, table_disagreement_mm
from calib.corners.edge_length import measured_edge_mm
from calib.dataset.dataset import Dataset
from calib.dataset_import.bad_rows import lines_of, note_of, rows_of, too_many_bad_rows, without_remarks
from calib.dataset_import.columns import Meaning, are_names
from calib.dataset_import.convention import Sheet, has_known_unit, settled, with_told_commands
from calib.dataset_import.drives import drives_in_words
from calib.dataset_import.markers import beside_each_other, in_rows, with_targets, with_tool_named
from calib.dataset_import.measured import MeasuredPoses
from calib.dataset_import.place_columns import Triple, has_poses, own_pose_columns, with_places
from calib.dataset_import.pose_names import files_of_rows, matched
from calib.dataset_import.questions import (
    Question,
    edge_question,
    end_of,
    noise_question,
    tool_questions,
    unit_question,
    with_tool_mass,
    with_tool_offset,
)
from calib.dataset_import.reading import (
    ImportReport,
    LeftOutRow,
    MeantTable,
    joint_values,
    named_by_values,
    named_places,
    of_one_place,
    parted,
    placement_columns,
    point_of_each_pose,
    point_values,
    points_unit,
    pose_ids,
    recognised,
    require_near_spread,
    require_poses,
    rows_of_points,
    with_clear_reading,
)
from calib.dataset_import.sources import ImportSource
from calib.dataset_import.units import joint_units, length_unit
from calib.dataset_import.writing import Content, checked, lengths_text, points_text, poses_text
from calib.errors import CalibError, DatasetError
from calib.kinematics.robot import Robot
from calib.plugins import contributions, load
from calib.progress import OnProgress
from calib.rendering import numbers
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import ReadOptions, RobotFile
from calib.robot_formats.urdf.meshes import stl_of_links
from calib.scans.scan import load_scan
from calib.text_files.column_names import LENGTHS_MM, SCALES, split_unit
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import COLUMN, Fault, RowFault, UserTable, load_table

_NO_ROBOT = "no robot is chosen: give a URDF, a robot.toml or another form, or choose a built-in one"
_EXAMPLES = 3
_COMPUTED_MM = 5e-3  # rms to the robot's table, below which no measured point is
_MOST_SHOWN = 60  # columns of a table
_MOST_NAMED = 8
_SCANS_FOR_EDGE = 3


class MeasuredChoice(Protocol):
    """What the user gives a plug-in to measure in place of points and scans."""

    @property
    def unit(self) -> str:
        """Noun of the files that are measured one after the other, such as "image"; "" where nothing takes long."""

    def sources(self, sources: ImportSources, on_progress: OnProgress | None) -> ImportSources:
        """The sources with what was measured. Raises CalibError."""


@dataclass(frozen=True)
class ImportSources:
    """What to import, as the user chose it, None for the likeliest, and as it was found in the files."""

    robots: tuple[RobotReading, ...] = ()  # one robot by each convention that its file may be in; (): none yet
    joints: Path | None = None
    points: Path | None = None  # None where the joints' table or scans contain the points
    scans: Mapping[str, Path] = field(default_factory=dict)  # a file by its stem
    mapping: Mapping[str, Meaning] = field(default_factory=dict)
    faults: tuple[str, ...] = ()  # of a robot that could not be read
    robot: str | None = None  # the name of a built-in one, or a file
    reading: ReadOptions = field(default_factory=ReadOptions)
    point_sigma_mm: float | None = None  # of one measured point, each axis; None where it is not known
    place_sigma_mm: float | None = None  # of each known place that was visited; None where it is not known
    tool_mm: Vector | None = None  # the measured point from the end of the robot's file, see `with_tool_offset`
    tool_mass_kg: float | None = None
    edge_mm: float | None = None  # of the jig in scans; None: measured
    skip_bad_rows: bool = False
    flange_poses: Path | None = None  # in place of joint values
    to_measure: MeasuredChoice | None = None  # by a plug-in
    measured: MeasuredPoses | None = None  # by it, in place of points and scans
    tables: Mapping[Path, UserTable] = field(default_factory=dict)  # of a plug-in, by the path that names them
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    joint_unit_is_unknown: bool = False  # whatever their size: they may be no angles at all

    @property
    def arm(self) -> Robot | None:
        """Robot in the first convention; None where there is none yet."""
        return self.robots[0].robot.robot if self.robots else None


LEFT_OUT = "left out, as told"
"""Why a column is left out."""


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
    can_leave_out: bool = False  # whether they can be, and are not yet
    left_out: tuple[LeftOutRow, ...] = ()  # rows of points that belong to no pose
    asked: tuple[Question, ...] = ()  # what no file tells

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
    planning = _Planning(sources)
    of_form = None if sources.tables else _form_of(sources)
    if of_form is not None:
        if not sources.robots:
            planning.report.faults += [] if sources.faults else [_NO_ROBOT]
            return planning.plan()
        try:
            sources = load(of_form.tables)(sources)
        except DatasetError as error:
            return planning.failed(error)
        planning = _Planning(sources)
    plan = planning.of_rows()
    if plan.content is None and sources.points is None and sources.measured is None:
        read = [f"{each.path}: {line}" for each in _tables_with_rows(sources) for line in drives_in_words(each)]
        plan = replace(plan, faults=(*plan.faults, *read))
    bad = planning.report.row_faults
    if not bad:
        return plan
    too_many = too_many_bad_rows(_tables_with_rows(sources), bad)
    if too_many or not sources.skip_bad_rows:
        faults = (*(too_many if sources.skip_bad_rows else ()), *plan.faults)
        return replace(plan, faults=faults, bad_rows=tuple(bad), can_leave_out=not too_many)
    return replace(_Planning(sources, bad).of_rows(), bad_rows=tuple(bad), are_left_out=True)


def _form_of(sources: ImportSources) -> ImportSource | None:
    """Plug-in's form that makes tables of the joints' file; None for a table of poses."""
    path, mapping = sources.joints, sources.mapping
    forms = () if path is None or "*" in path.name else contributions(ImportSource)
    return next((form for form in forms if load(form.reads)(path, mapping)), None)


def _tool_note(sources: ImportSources) -> list[str]:
    """Note on where the measured point is taken to be, if the user has given it."""
    if sources.tool_mm is None or not sources.robots:
        return []
    x, y, z = sources.tool_mm
    file = sources.robots[0].robot
    return [f"{file.robot.name}: the measured point is at {x:g}, {y:g}, {z:g} mm in {end_of(file)}, as given"]


def _tables_with_rows(sources: ImportSources) -> list[UserTable]:
    """Tables of joints and points, without their faults; () for one that cannot be read."""
    paths = (sources.joints, sources.points)
    tables = (_loaded(ImportReport(None), sources, path) for path in paths if path is not None)
    return list({table.path.resolve(): table for table in tables if table is not None}.values())


def _loaded(
    report: ImportReport, sources: ImportSources, path: Path | None, bad: Sequence[RowFault] = ()
) -> UserTable | None:
    """Table of a file, its faults reported but for those of bad rows; None where it cannot be read."""
    if path is None:
        return None
    if path in sources.tables:
        return sources.tables[path]

    def fault(found: Fault) -> None:
        if not isinstance(found, RowFault) or lines_of(bad, path).isdisjoint({found.line}):
            report.fault(found)

    try:
        table = load_table(
            path, fault, any_encoding=True, is_names=lambda names: are_names(names, report.robot, sources.mapping)
        )
    except DatasetError as error:
        report.fault(str(error))
        return None
    if table.rows_are == COLUMN:
        report.notes.append(
            f"{path}: its names stand below each other and each pose is a column: it is turned, and a line "
            "that is told of it is a column's number"
        )
    return without_remarks(report, table)


class _Planning:
    """An import as it is planned: each step reads what the ones before have found.

    `joints` and `points` are the tables with the meaning of their columns; `points` is None where the joints' rows have
    the points, or where there are none.
    """

    def __init__(self, sources: ImportSources, bad: Sequence[RowFault] = ()) -> None:
        self.sources, self.bad = sources, bad  # rows to leave out
        self.report = ImportReport(sources.arm, list(sources.faults), list(sources.notes), list(sources.doubts))
        self.report.notes += [*_tool_note(sources), *_measured_notes(sources)]
        self.joints: MeantTable | None = None
        self.points: MeantTable | None = None
        self.ids: list[str] = []
        self.row_of: list[int] = []  # row of the joints of each point
        self.scan_of: dict[int, Path] = {}  # by the row of the joints
        self.robot_file = sources.robots[0].robot if sources.robots else None
        self.asked: list[Question] = []
        self.told_bad: list[str] = []
        self.readings: list[Triple] = []  # columns of a point that was told by angles and a distance

    def plan(self, content: Content | None = None, preview: Dataset | None = None) -> ImportPlan:
        """Plan with what was found so far, which has faults where there is no content."""
        report, tables = self.report, [each for each in (self.joints, self.points) if each is not None]
        columns = [planned for table in tables for planned in _planned(table, self.sources.mapping)]
        return ImportPlan(
            self.robot_file, tuple(columns), tuple(report.notes), tuple(report.doubts), tuple(map(str, report.faults)),
            content, 0 if self.joints is None else len(self.joints.table), preview, left_out=tuple(report.left_out),
            asked=tuple(self.asked),
        )  # fmt: skip

    def failed(self, error: CalibError) -> ImportPlan:
        """Plan with what was found so far, and an error as a fault."""
        self.report.fault(str(error))
        return self.plan()

    def of_rows(self) -> ImportPlan:
        """Plan of the import without the rows that are left out."""
        report, sources = self.report, self.sources
        table = _loaded(report, sources, sources.joints, self.bad)
        same = sources.points is None or (
            sources.joints is not None and sources.points.resolve() == sources.joints.resolve()
        )
        other = None if same else _loaded(report, sources, sources.points, self.bad)
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
            return self.plan()
        table, of_joints = with_places(table)
        other, of_points = (None, []) if other is None else with_places(other)
        self.readings = of_points or of_joints
        wants_points = same and not sources.scans and sources.measured is None
        self.joints = recognised(report, table, sources.mapping, positions=wants_points)
        if other is not None:
            self.points = recognised(report, other, sources.mapping, positions=True, joints=False)
            self.joints, self.points = named_by_values(report, self.joints, self.points)
            if not self.points.pose and (of_visits := named_places(report, self.joints, other)) is not None:
                self.points = recognised(report, of_visits, sources.mapping, positions=True, joints=False)
        elif not same:
            return self.plan()
        self._leave_out_bad_rows()
        if wants_points:
            self.joints, self.points = parted(report, self.joints)
        self.ids = pose_ids(report, self.joints)
        if sources.scans and sources.measured is None:
            self._match_scans()
        self.row_of = list(range(len(self.ids)))
        if self.points is not None:
            self.points, self.row_of = rows_of_points(report, self.joints, self.ids, self.points)
        if report.robot is not None and (wants_points or self.points is not None):
            self._name_targets()
        try:
            plan = self._of_numbers()
        except CalibError as error:
            plan = self.failed(error)
        path = sources.points or table.path  # the file has its markers in the rows of the joints
        made = None if self.points is None or self.points.path.exists() else self.points.path
        report.faults = [
            replace(f, path=path) if isinstance(f, RowFault) and f.path == made else f for f in report.faults
        ]
        return replace(plan, faults=tuple(map(str, report.faults)))

    def _leave_out_bad_rows(self) -> None:
        """Leave out rows that cannot be read, with those of the other table that belong to them by name or order."""
        joints, points = self.joints, self.points
        if not self.bad or joints is None:
            return
        gone = rows_of(joints.table, lines_of(self.bad, joints.path))
        self.told_bad = [note_of(joints.table, self.bad)] if gone else []
        if points is not None:
            bad_points = rows_of(points.table, lines_of(self.bad, points.path))
            self.told_bad += [note_of(points.table, self.bad)] if bad_points else []
            of_points = range(len(points.table))
            if points.pose:
                pose_of = matched(points.cells("pose"), pose_ids(ImportReport(None), joints)).pose
                all_bad = bad_points | {i for i in of_points if pose_of[i] in gone}
            else:
                all_bad = gone = gone | bad_points
            if all_bad > bad_points:
                self.told_bad.append(f"{points.path.name}: rows of these poses are left out, too")
            self.points = points.of_rows([i for i in of_points if i not in all_bad])
        self.report.notes += self.told_bad
        self.joints = joints.of_rows([i for i in range(len(joints.table)) if i not in gone])

    def _match_scans(self) -> None:
        """Find the pose of each scan; poses without one are left out where there are no points."""
        assert self.joints is not None
        report, scans, joints = self.report, self.sources.scans, self.joints
        told = joints.cells("scan")
        if told:
            self.scan_of = {i: scans[Path(name).stem] for i, name in enumerate(told) if Path(name).stem in scans}
        else:
            rows, how = files_of_rows(scans, joints.table, self.ids)
            self.scan_of = {row: scans[stem] for stem, row in rows.items()}
            if how:
                folder = next(iter(scans.values())).parent
                report.notes.append(f"{folder}: scans are matched to the poses of {joints.path.name} {how}")
        strange = [path for path in scans.values() if path not in self.scan_of.values()]
        if not self.scan_of:
            report.fault(
                f"{joints.path}: no scan is named as its poses are: {self.ids[0][:40]!r} ... and "
                f"{strange[0].name[:60]!r} ...; name them alike, or add a column scan with each pose's file"
            )
            return
        if strange:
            why = f"no pose of {joints.path.name} has its name"
            report.left_out += [LeftOutRow(path.name, 1, path.stem, why) for path in strange]
            count, shown = len(strange), numbers.in_short([path.name for path in strange], _MOST_NAMED)
            report.notes.append(f"{numbers.count(count, 'scan')} of no pose left out: {shown}")
        kept = [i for i in range(len(self.ids)) if i in self.scan_of]
        if self.points is None and len(kept) < len(self.ids):
            gone = [name for i, name in enumerate(self.ids) if i not in self.scan_of]
            report.notes.append(
                f"{joints.path}: {numbers.count(len(gone), 'pose')} without a scan left out: "
                f"{numbers.in_short(gone, _MOST_NAMED)}"
            )
            self.joints, self.ids = joints.of_rows(kept), [self.ids[i] for i in kept]
            self.scan_of = {new: self.scan_of[old] for new, old in enumerate(kept)}

    def _name_targets(self) -> None:
        """Part markers beside each other into rows, and name the tool's "jig".

        Markers in the rows of the joints are no further columns of these.
        """
        report, joints = self.report, self.joints
        assert report.robot is not None
        assert joints is not None
        points = self.points or joints
        markers = beside_each_other(points.meant, points.table.columns)
        if markers:
            if -1 in self.row_of or len(self.row_of) != len(points.table):
                return
            of_markers = {name for each in markers.values() for name in each}
            poses = [self.ids[row] for row in self.row_of]
            self.points = in_rows(report, points.table, markers, poses)
            if points is joints:
                rest = [name for name in joints.meant.rest if name not in of_markers]
                self.joints = joints.with_columns(joints.meant.columns, rest)
            self.row_of = list(matched(self.points.cells("pose"), self.ids).pose)
        if self.points is not None and self.points.has_points and "target" in self.points.meant.columns:
            self.points, kept = with_tool_named(report, self.points, report.robot)
            self.row_of = [self.row_of[i] for i in kept]

    def _of_numbers(self) -> ImportPlan:
        """Plan from tables with recognised columns: their numbers, units, and the pose of each point."""
        report, sources, joints = self.report, self.sources, self.joints
        assert joints is not None
        q_file = joint_values(report, joints)
        by_plugin = sources.measured
        points = self.points or joints
        seen = None if by_plugin is not None else point_values(report, points, needed=not sources.scans)
        if q_file is None or report.robot is None or not np.isfinite(q_file).any():
            return self.plan()
        n = report.robot.n_joints
        names = [f"q{k + 1}" for k in range(n)]
        columns = [joints.meant.columns[name] for name in names]
        near = None if seen is None else point_of_each_pose(len(q_file), seen, self.row_of)
        is_open = len(self.readings) > 1
        units, how = joint_units(report.robot, q_file, [column.unit for column in columns], None if is_open else near)
        if len(q_file) > 1 and not np.ptp(q_file, axis=0).any():
            raise DatasetError(
                f"{joints.path}: the joints are the same in all {len(q_file)} rows: nothing can be learned from them; "
                "log them anew at each measurement"
            )
        report.notes.append(
            f"{joints.path}: joints are {', '.join(column.name for column in columns)}"
            + (f"; {how}" if how else f" in {' and '.join(sorted(set(units)))} by their names")
        )
        joints = self.joints = _with_units(joints, names, units, _short(how))
        points = self.points or joints
        scale = np.array([SCALES[unit] for unit in units])
        commanded = q_file * scale
        told = [with_told_commands(each, joints.meant, scale) for each in sources.robots]
        q = told[0].robot.robot.joints_of(commanded)
        if not sources.tables:
            require_poses(report, joints, q)
        if seen is not None and is_open:
            points = with_clear_reading(report, points, self.readings, q, self.row_of)
            self.joints, self.points = (joints, points) if self.points is not None else (points, None)
            joints, seen = self.joints, point_values(report, points, needed=True)
            near = None if seen is None else point_of_each_pose(len(q), seen, self.row_of)
        sheet, off = None, 1.0
        setups = joints.cells("setup")
        if seen is not None and near is not None:
            unit, how, off = points_unit(report, points, near, q)
            if not unit:
                return self.plan()
            points = _with_units(points, list("xyz"), [unit] * 3, "the arm's tool spreads so" if how else "")
            if self.points is None:
                joints = self.joints = points
            else:
                self.points = points
            place = of_one_place(near, seen, self.row_of, points.cells("target"), setups)
            sheet = Sheet(tuple(self.ids), q, place * LENGTHS_MM[unit])
            seen = seen * LENGTHS_MM[unit]
        if sources.joint_unit_is_unknown and not has_known_unit(report, told, sheet, joints):
            self.asked.append(unit_question(joints, "q1", ("deg", "rad")))
            return self.plan()
        taken = settled(report, told, sheet, joints, placement_columns(joints, self.points))
        commanded = commanded[:, list(taken.joints.order)]
        q = taken.robot.robot.joints_of(commanded)
        joints = self.joints = replace(joints, meant=taken.applied(joints.meant, units))
        self.robot_file = taken.robot
        if self.points is not None and seen is not None and "target" in points.meant.columns:
            robot, kept = with_targets(report, taken.robot.robot, points, self.row_of, q, seen, setups)
            self.robot_file = replace(taken.robot, robot=robot)
            self.points, seen = points.of_rows(kept), seen[kept]
            self.row_of = [self.row_of[i] for i in kept]
        payload_kg = [as_number(cell) or 0.0 for cell in joints.cells("payload_kg")] or None
        sample = None if sheet is None else Sheet(sheet.ids, q, sheet.points_mm).sample
        if sources.tool_mass_kg is not None:
            self.robot_file = with_tool_mass(self.robot_file, sample, sources.tool_mass_kg)
        self.asked += tool_questions(self.robot_file, sample, sources.tool_mm, payload_kg)
        report.robot = self.robot_file.robot
        if sheet is not None and off > 1.0 and near is not None:
            faults = len(report.faults)
            require_near_spread(report, points, *length_unit(report.robot, q, near))
            self.asked += [unit_question(points, "x", ("mm", "m", "in"))] if len(report.faults) > faults else []
        if self.points is not None and self.points.meant.rest:
            report.notes.append(f"{points.path}: other columns are left out: {', '.join(self.points.meant.rest)}")
        if sheet is not None and self.points is None and has_poses(joints.table):
            self._doubt_computed(joints.table, sheet, q)
        self._compare_with_controller(joints.table, report.robot, q)
        if by_plugin is not None and not report.faults:
            by_plugin = by_plugin.settled(report.robot, self.ids, q, setups)
            report.notes += by_plugin.notes[len(_measured_notes(sources)) :]
            report.doubts += by_plugin.doubts
        measured = None if near is None else np.asarray(np.isfinite(near).all(axis=1))
        if points.length is not None:
            measured = np.isin(np.arange(len(self.ids)), self.row_of)
        if by_plugin is not None:
            measured = np.isin(self.ids, by_plugin.names)
        scans = (
            [self.scan_of[i].name if i in self.scan_of else "" for i in range(len(self.ids))] if self.scan_of else []
        )
        poses_csv = poses_text(report, joints, self.ids, commanded, scans, measured)
        names_of_points = [self.ids[row] for row in self.row_of if row >= 0]
        points_csv = None if by_plugin is None else by_plugin.points_text(self.ids)
        if points.length is not None:
            points_csv = lengths_text(report, points, names_of_points)
        if report.faults:
            return self.plan()
        if seen is not None:
            points_csv = points_text(self.points or joints, names_of_points, seen)
        return self._checked(poses_csv, points_csv, by_plugin)

    def _checked(self, poses_csv: str, points_csv: str | None, by_plugin: MeasuredPoses | None) -> ImportPlan:
        """Plan with the content of the dataset, if it can be read."""
        report, sources = self.report, self.sources
        assert report.robot is not None
        assert self.robot_file is not None
        assert sources.joints is not None
        if points_csv is None and sources.point_sigma_mm is not None:
            report.doubts.append(
                "the sigma of a measured point is not used: these data have scans and no measured points"
            )
        edge_mm = sources.edge_mm
        if self.scan_of and edge_mm is None:
            edge_mm = _edge_in(list(self.scan_of.values()))
            self.asked.append(edge_question(edge_mm))
        meshes, of_meshes = stl_of_links(self.robot_file.meshes)
        report.notes += of_meshes
        content = Content(
            report.robot, poses_csv, points_csv, {path.stem: path for path in self.scan_of.values()},
            f"imported from {sources.joints.name}", sources.robots[0].path,
            point_sigma_mm=None if points_csv is None else sources.point_sigma_mm,
            place_sigma_mm=None if points_csv is None else sources.place_sigma_mm, notes=tuple(self.told_bad),
            measured=by_plugin, meshes=meshes, edge_mm=edge_mm,
        )  # fmt: skip
        try:
            preview = checked(content)
        except DatasetError as error:
            raise DatasetError(f"{sources.joints}: {error}") from None
        if points_csv is not None and by_plugin is None and sources.point_sigma_mm is None:
            self.asked.insert(0, noise_question(preview))
        return self.plan(content, preview)

    def _off_table_mm(self, q: Array, places_mm: Array) -> float | None:
        """How far places (N, 3) are from those of the robot's table, rms; None where that cannot be told."""
        assert self.report.robot is not None
        known = np.isfinite(places_mm).all(axis=1) & np.isfinite(q).all(axis=1)
        return table_disagreement_mm(self.report.robot, q[known], places_mm[known]) if known.any() else None

    def _doubt_computed(self, table: UserTable, sheet: Sheet, q: Array) -> None:
        """Doubt points that the robot's table gives, too: a controller's own, computed from the joints."""
        off_mm = self._off_table_mm(q, sheet.points_mm)
        if off_mm is not None and off_mm < _COMPUTED_MM:
            self.report.doubts.append(
                f"{table.path}: its points agree with the robot's table to {off_mm:.1g} mm, and turns stand "
                "beside them: they are the pose that the controller computes from the joints and measure nothing; give "
                "measured ones by --points FILE"
            )

    def _compare_with_controller(self, table: UserTable, robot: Robot, q: Array) -> None:
        """Note, or doubt, on whether the poses that the controller wrote down are those of the robot's table."""
        names = own_pose_columns(table.columns)
        if not names or (self.joints is not None and self.joints.named("x") in names):
            return
        places = table.known(names)
        if not np.isfinite(places).all(axis=1).any():
            return
        unit = split_unit(names[0])[1]
        unit = unit if unit in LENGTHS_MM else length_unit(robot, q, places)[0]
        off_mm = self._off_table_mm(q, places * LENGTHS_MM[unit])
        if off_mm is not None:
            agrees, sentence = agreement_note(f"{table.path}: {names[0]} ...", off_mm)
            (self.report.notes if agrees else self.report.doubts).append(sentence)


def _edge_in(scans: Sequence[Path]) -> float | None:
    """Length of the jig's edges by some scans from all over the poses; None where they do not show it."""
    some = []
    for path in scans[:: max(1, len(scans) // _SCANS_FOR_EDGE)][:_SCANS_FOR_EDGE]:
        with suppress(CalibError):
            some.append(load_scan(path))
    return measured_edge_mm(some)


def _measured_notes(sources: ImportSources) -> tuple[str, ...]:
    """Notes on what a plug-in has measured."""
    return () if sources.measured is None else sources.measured.notes


def _short(how: str) -> str:
    """Reason for a unit, shortened for a table's cell."""
    return f"the largest is {how.rpartition(' ')[2]}" if how else ""


def _with_units(table: MeantTable, names: list[str], units: list[str], how: str) -> MeantTable:
    """The table's columns with the units that were found and the reason."""
    columns = dict(table.meant.columns)
    for name, unit in zip(names, units, strict=True):
        if not columns[name].unit:
            why = f"{columns[name].why}; {unit}: {how}" if how else columns[name].why
            columns[name] = replace(columns[name], unit=unit, why=why)
    return table.with_columns(columns)


def _planned(table: MeantTable, mapping: Mapping[str, Meaning]) -> list[PlannedColumn]:
    by_name = {column.name: column for column in table.meant.columns.values()}
    out = []
    for k, name in enumerate(table.table.columns[:_MOST_SHOWN]):
        examples = tuple(row[k] for row in table.table.rows[:_EXAMPLES])
        column = by_name.get(name)
        if column is None:
            ignored = name in mapping and mapping[name].name == "ignore"
            out.append(PlannedColumn(table.path, name, examples, None, LEFT_OUT if ignored else ""))
            continue
        meaning = Meaning(column.meaning, column.unit, column.sign, column.offset, column.others)
        out.append(PlannedColumn(table.path, name, examples, meaning, column.why))
    return out
