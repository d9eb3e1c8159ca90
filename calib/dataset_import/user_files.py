"""Kinds of a user's files by suffix and content: dataset, robot, tables of joints and points, scans."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.dataset_import.columns import are_names, end_in_joint, length_column, recognise
from calib.dataset_import.place_columns import polar_columns
from calib.dataset_import.sources import ImportSource
from calib.errors import CalibError
from calib.plugins import contributions, load
from calib.robot_formats.origin_yaml import read_origin_yaml
from calib.robot_formats.robot_form import forms_of, rank_of
from calib.text_files.column_names import ANGLES_RAD, listed, plain, split_unit
from calib.text_files.records import ARRAYS, RECORDS, SPREADSHEETS, YAML, sheets
from calib.text_files.text_file import decoded
from calib.text_files.user_table import UserTable, load_table, parse_table

_MOST_FILES = 10_000
_HEAD_BYTES = 16_384  # of a file, by which it is judged
_TABLES = listed(".csv .tsv .txt .dat .src")
_RECORD_EACH = listed(".json .yaml .txt .csv .dat .npz .npy")
_RECORD_BYTES = 20_000  # of a file with one record, at the most
_CLOUDS = listed(".ply .pcd .e57 .xyz .asc .pts .npy .npz .las .laz")
_MESHES = (".stl", ".obj")  # scans where nothing else can be
_MANY = 4  # texts of three numbers a line in one folder, which are scans then
_ROBOT_COLUMNS = ("theta d a alpha", "wx wy wz", "x y z roll pitch yaw")
DATASET, ROBOT, JOINTS, POINTS, BOTH, SCAN, UNUSED = (
    "dataset", "robot", "joints", "points", "joints and points", "scan", "not used",
)  # fmt: skip
_WORDS = {  # in the name of a file or its folder
    JOINTS: ("joint", "pose", "axis", "axes", "q_"), POINTS: ("point", "tracker", "laser", "measure"),
}  # fmt: skip
_MANY_ANGLES = 3


@dataclass(frozen=True)
class UserFile:
    """A file with its kind and the reason for it."""

    path: Path
    kind: str
    why: str


@dataclass(frozen=True)
class UserFiles:
    """The files of a folder; of several of a kind, the likeliest is first."""

    folder: Path
    files: tuple[UserFile, ...]
    scans: Mapping[str, Path] = field(default_factory=dict)  # a file by its stem

    def of(self, *kinds: str) -> tuple[Path, ...]:
        """Paths of the files of the given kinds."""
        return tuple(file.path for file in self.files if file.kind in kinds)

    @property
    def datasets(self) -> tuple[Path, ...]:
        """Folders that are datasets already."""
        return tuple(path.parent for path in self.of(DATASET))

    @property
    def robots(self) -> tuple[Path, ...]:
        """Paths of robot files, the surest form first."""
        return tuple(sorted(self.of(ROBOT), key=lambda path: (rank_of(path), str(path))))

    @property
    def tables(self) -> tuple[Path, ...]:
        """Paths of tables of joints or points."""
        return self.of(BOTH, JOINTS, POINTS)

    @property
    def joints(self) -> Path | None:
        """Path of the likeliest table of joint values; None where there is none."""
        return next(iter((*self.of(JOINTS), *self.of(BOTH))), None)

    @property
    def points(self) -> Path | None:
        """Path of the likeliest table of points other than the table of joints; None where there is none."""
        points = self.of(POINTS)
        return points[0] if points and self.joints is not None and self.joints in self.of(JOINTS) else None


def look_through(folder: Path) -> UserFiles:
    """Find the kind of each file below a folder. Raises CalibError where there are no files or too many."""
    paths = list(_below(folder))
    if len(paths) > _MOST_FILES:
        raise CalibError(f"{folder}: holds more than {_MOST_FILES} files; give the folder of one dataset")
    if not paths:
        raise CalibError(f"{folder}: holds no file; a robot and tables of joints and points are needed")
    if any(path.name == "dataset.toml" for path in paths):
        return UserFiles(folder, tuple(_of_datasets(paths)))
    folders = _owned_folders(paths)
    within = {path for path in paths for top in folders if path.is_relative_to(top) and not _stands_alone(path)}
    paths = sorted({*folders, *(path for path in paths if path not in within)})
    sets = _sets(paths)
    paths = [path for path in paths if path not in {each for members in sets.values() for each in members}]
    files = [file for path in paths for file in (_sheets(path) if path.suffix.lower() in RECORDS else [_judged(path)])]
    files += [_judged_records(path) for path in sets]
    scans = _scans(files)
    return UserFiles(folder, tuple(_settled(file, scans) for file in files), scans)


def _below(folder: Path) -> Iterator[Path]:
    """Paths of the plain files below a folder, sorted, without hidden files and links."""
    count = 0
    for place, folders, names in os.walk(folder, followlinks=False):
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name != "__MACOSX")
        for name in sorted(names):
            path = Path(place) / name
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                yield path
                count += 1
                if count > _MOST_FILES:
                    return


def _of_datasets(paths: list[Path]) -> Iterator[UserFile]:
    found = [path for path in paths if path.name == "dataset.toml"]
    for path in paths:
        if path in found:
            yield UserFile(path, DATASET, "a dataset's folder, as this program writes it")
        elif not any(path.is_relative_to(top.parent) for top in found):
            yield UserFile(path, UNUSED, "beside a ready dataset")


def _owned_folders(paths: Sequence[Path]) -> set[Path]:
    """Folders that are one source of a plug-in's form as a whole, such as a bag."""
    marked = [
        (source, path.parents[mark.count("/")])
        for source in contributions(ImportSource)
        for mark in source.folder_marks
        for path in paths
        if path.as_posix().endswith(f"/{mark}")
    ]
    return {folder for source, folder in marked if load(source.owns)(folder)}


def _stands_alone(path: Path) -> bool:
    """Whether a file below a source's folder is no part of it: a robot or a table beside the source's own files."""
    marks = tuple(f"/{mark}" for source in contributions(ImportSource) for mark in source.folder_marks)
    return bool(forms_of(path) or path.suffix.lower() in _TABLES) and not path.as_posix().endswith(marks)


def _judged(path: Path) -> UserFile:
    for source in contributions(ImportSource):
        if load(source.owns)(path):
            found: UserFile = load(source.judged)(path)
            return found
    suffix = path.suffix.lower()
    if suffix in YAML:
        try:
            read_origin_yaml(path)
        except CalibError:
            return _judged_records(path)
        return UserFile(path, ROBOT, "joint origins")
    if suffix in _TABLES:
        return _judged_records(path, of_head=True)
    forms = forms_of(path)
    if forms:
        head = _head(path) if any(form.mark for form in forms) else ""
        shown = next((form for form in forms if form.mark in head), None)
        return UserFile(path, UNUSED, "holds no robot") if shown is None else UserFile(path, ROBOT, shown.told_by)
    if suffix in (*_CLOUDS, *_MESHES):
        return UserFile(path, SCAN, "a point cloud")
    if suffix == ".numbers":
        return UserFile(path, UNUSED, "a spreadsheet: save its sheet as CSV")
    return UserFile(path, UNUSED, "a zip within" if suffix == ".zip" else "of no form that is read")


def _sets(paths: Sequence[Path]) -> dict[Path, list[Path]]:
    """Files with one record of joints or points each, of one folder and form, by the pattern of their names."""
    of_pattern: dict[Path, list[Path]] = {}
    for path in paths:
        if path.suffix.lower() in _RECORD_EACH and path.stat().st_size <= _RECORD_BYTES:
            of_pattern.setdefault(path.with_name(f"*{path.suffix}"), []).append(path)
    many = {pattern: found for pattern, found in of_pattern.items() if len(found) >= _MANY}
    return {pattern: found for pattern, found in many.items() if _judged_records(pattern).kind not in (UNUSED, SCAN)}


def _sheets(path: Path) -> list[UserFile]:
    """A spreadsheet's sheets, or a file of records, each judged as a table; one entry where none can be read."""
    if path.suffix.lower() not in SPREADSHEETS:
        return [_judged_records(path)]
    try:
        named = [path.with_name(f"{path.name}#{name}") for name in sheets(path)]
    except CalibError as error:
        return [_unread(path, error)]
    return [_judged_records(each) for each in named or [path]]


def _unread(path: Path, error: CalibError) -> UserFile:
    return UserFile(path, UNUSED, str(error).removeprefix(f"{path}: "))


def _judged_records(path: Path, *, of_head: bool = False) -> UserFile:
    """A file of records, a sheet, or a pattern of files with one record each, as the table that they are.

    of_head: whether it is a text, of which the beginning is enough.
    """
    try:
        if of_head:
            return _judged_table(path, parse_table(path, _head(path), lambda _: None, _are_names))
        found = _judged_table(path, load_table(path, lambda _: None, any_encoding=True, is_names=_are_names))
    except CalibError as error:
        found = _unread(path, error)
    is_array = path.suffix.lower() in ARRAYS and found.kind == UNUSED
    return UserFile(path, SCAN, "a point cloud") if is_array else found


def is_workbook(path: Path) -> bool:
    """Whether a path is a spreadsheet, none of its sheets named."""
    return path.suffix.lower() in SPREADSHEETS and path.is_file()


def of_workbook(path: Path) -> UserFiles:
    """Sheets of a workbook as tables, where several are; no files where one or none is."""
    found = [file for file in _sheets(path) if file.kind != UNUSED]
    return UserFiles(path.parent, tuple(found) if len(found) > 1 else ())


def _are_names(names: Sequence[str]) -> bool:
    """Whether texts name the columns of joints, of a point or of a table of the robot."""
    return are_names(names) or _are_of_robot(names)


def _are_of_robot(names: Sequence[str]) -> bool:
    """Whether texts name the columns of a table of the robot."""
    plain_names = {plain(split_unit(name)[0]) for name in names}
    return any(plain_names.issuperset(columns.split()) for columns in _ROBOT_COLUMNS)


def _judged_table(path: Path, table: UserTable) -> UserFile:
    if path.suffix.lower() == ".csv" and table.has_header and _are_of_robot(table.columns):
        return UserFile(path, ROBOT, "a table of the robot, by its columns")
    if not table.has_header:
        return _without_header(path, table)
    meant = recognise(table.columns, None, {})
    has_joints = "q1" in meant.columns or bool(meant.faults)
    has_points = (
        all(axis in meant.columns for axis in "xyz")
        or length_column(meant) is not None
        or bool(polar_columns(table.columns))
    )
    if not has_joints and not has_points:
        has_joints, has_points = _described(table)
    has_joints = has_joints or (has_points and end_in_joint(table.columns))
    if has_joints or has_points:
        kind = BOTH if has_joints and has_points else JOINTS if has_joints else POINTS
        return UserFile(path, kind, "by the names of its columns")
    name = f"{path.stem} {path.parent.name}".lower()
    for kind, words in _WORDS.items():
        if any(word in name for word in words):
            return UserFile(path, kind, "by its own name")
    if sum(split_unit(column)[1] in ANGLES_RAD for column in table.columns) >= _MANY_ANGLES:
        return UserFile(path, JOINTS, "by the angles in it")
    return UserFile(path, UNUSED, "has columns neither of joints nor of points")


def _described(table: UserTable) -> tuple[bool, bool]:
    """Whether a table has joints, and points, for any plug-in's form."""
    found: list[tuple[bool, bool]] = [load(source.describe)(table) for source in contributions(ImportSource)]
    return any(joints for joints, _ in found), any(points for _, points in found)


def _without_header(path: Path, table: UserTable) -> UserFile:
    width = len(table.columns)
    has_joints, has_points = _described(table)
    if has_joints or has_points:
        return UserFile(path, JOINTS if has_joints else POINTS, "messages of ROS, by their cells")
    if width == 3:
        return UserFile(path, SCAN, "three numbers a line")
    if width == 4:
        return UserFile(path, POINTS, "four columns without a header: a pose and a point")
    kind = BOTH if width >= 8 else JOINTS
    return UserFile(path, kind, f"{width} columns without a header")


def _head(path: Path) -> str:
    """Beginning of a file as text, cut at the end of a line."""
    with path.open("rb") as file:
        content = file.read(_HEAD_BYTES)
    text = decoded(content)
    whole = len(content) < _HEAD_BYTES or "\n" not in text
    return text if whole else text[: text.rindex("\n")]


def _scans(files: list[UserFile]) -> dict[str, Path]:
    """Scan files by file name without suffix, of the folder that has most of them."""
    found = [file.path for file in files if file.kind == SCAN]
    clouds = [path for path in found if path.suffix.lower() in _CLOUDS]
    texts = [path for path in found if path.suffix.lower() in _TABLES]
    many = Counter(path.parent for path in texts)
    clouds += [path for path in texts if many[path.parent] >= _MANY]
    if not clouds and not any(file.kind == ROBOT and file.path.suffix.lower() != ".toml" for file in files):
        clouds = [path for path in found if path.suffix.lower() in _MESHES]
    if not clouds or (len(clouds) == 1 and clouds[0].suffix.lower() == ".npy"):  # an array of points, a row a pose
        return {}
    folder = Counter(path.parent for path in clouds).most_common(1)[0][0]
    of_stem = {path.stem: path for path in reversed(clouds) if path.parent == folder}  # the first of a stem
    return dict(reversed(of_stem.items()))


def _settled(file: UserFile, scans: Mapping[str, Path]) -> UserFile:
    """File that looks like a scan as one of the dataset's scans, or else as points or unused; any other unchanged."""
    suffix = file.path.suffix.lower()
    if file.path in scans.values():
        return UserFile(file.path, SCAN, "a point cloud a pose")
    if file.kind != SCAN:
        return file
    if suffix in (*_TABLES, ".npy"):
        return UserFile(file.path, POINTS, "three columns without a header")
    return UserFile(file.path, UNUSED, "a mesh" if suffix in _MESHES else "a scan of another folder")
