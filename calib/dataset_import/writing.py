"""Writing of an imported dataset: its files as text, written to a temporary folder and moved into place."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import ROLES, Dataset, Scanner
from calib.dataset.files.atomic_write import new_folder
from calib.dataset.files.cell_tables import scanner_document
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import robot_to_toml
from calib.dataset.input_names import CONDITIONS, joint_input, quantity_of
from calib.dataset_import.measured import MeasuredPoses
from calib.dataset_import.place_columns import is_beside_point
from calib.dataset_import.reading import ImportReport, MeantTable
from calib.errors import CalibError, DatasetError
from calib.kinematics.robot import Robot
from calib.robot_formats.calibrated_file import template_name
from calib.text_files.column_names import LENGTHS_MM
from calib.text_files.csv_text import rows_csv

_WORDS = {
    word: role
    for role, words in {
        "reference": "reference ref",
        "train": "train training calibration fit",
        "test": "test testing validation verification check",
    }.items()
    for word in words.split()
}
MESH_FOLDER = "meshes"
_ENOUGH = 25  # poses, so that some can be kept apart
_EVERY = 4


def roles_of(
    column: Sequence[str] | None, count: int, first: int = 0, *, few_unknowns: bool = False
) -> tuple[list[str], str]:
    """Role of each pose, exactly one being the reference, and the reason; "" where all are in the table.

    first  # index of the first measured pose
    few_unknowns  # whether no link is fitted: what is sought is nearest by all poses, and fits none of their noise
    """
    if column is None:
        apart = count >= _ENOUGH and not few_unknowns
        roles = ["test" if apart and i % _EVERY == _EVERY - 1 else "train" for i in range(count)]
        kept = (
            f"every fourth is kept apart to test ({roles.count('test')} of {count})"
            if "test" in roles
            else "none is kept"
        )
        roles[first] = "reference"
        return roles, f"no column role: the first pose with a point is the reference, {kept}"
    roles = [_WORDS.get(word.strip().lower(), word.strip()) for word in column]
    if "reference" in roles or not roles:
        return roles, ""
    roles[roles.index("train") if "train" in roles else first] = "reference"
    return roles, "column role names no reference pose: the first for training is taken"


def poses_text(
    report: ImportReport,
    joints: MeantTable,
    ids: Sequence[str],
    commanded: Array,
    scans: Sequence[str],
    measured: BoolArray | None,
) -> str:
    """Text of poses.csv, with commanded values in rad and mm.

    commanded  # (N, n) rad, mm; scans  # (N,) each pose's file, "" for none; () without scans
    measured  # (N,) poses that have a point; None: scans only
    """
    assert report.robot is not None
    table, meant = joints.table, joints.meant
    given = joints.cells("role") or None
    first = 0 if measured is None else int(np.argmax(measured))
    roles, how = roles_of(given, len(ids), first, few_unknowns=report.robot.is_cartesian)
    report.notes += [f"{table.path}: {how}"] if how else []
    unknown = [i for i, role in enumerate(roles) if role not in ROLES]
    for i in unknown:
        found = f"found {roles[i][:40]!r}; expected reference, train or test"
        report.fault(str(table.fault(i, found, joints.named("role"))))
    names = [f"q{k + 1}_{'rad' if turns else 'mm'}" for k, turns in enumerate(report.robot.is_revolute)]
    kept = [m for m in meant.columns if m in (*CONDITIONS, "setup", "scan") or quantity_of(m) == "approach"]
    taken = {"pose", "role", *names, *kept}
    rest = [name for name in meant.rest if name not in taken]
    beside = [name for name in rest if "x" in meant.columns and is_beside_point(name)]
    if beside:  # as inputs they would explain the error by itself
        report.notes.append(f"{table.path}: columns of other or nominal points are left out: {', '.join(beside)}")
        rest = [name for name in rest if name not in beside]
    if rest:
        report.notes.append(f"{table.path}: other columns are kept as they are: {', '.join(rest)}")
    columns = [_condition(report, joints, m) for m in kept] + [table.text(name) for name in rest]
    body = [
        [ids[i], roles[i], *map(repr, map(float, commanded[i])), *(column[i] for column in columns)]
        for i in range(len(ids))
    ]
    header = ["pose", "role", *names, *kept, *rest]
    if scans and "scan" not in kept:
        header.append("scan")
        for pose, row, file in zip(ids, body, scans, strict=True):
            row.append(file or f"{pose}.ply")
    return rows_csv([header, *body])


def _condition(report: ImportReport, joints: MeantTable, meaning: str) -> list[str]:
    """Cells of a condition's column; a fault is reported where one should be a number and is not."""
    cells = joints.cells(meaning)
    if meaning in CONDITIONS:
        joints.table.numbers(joints.named(meaning), report.fault, may_be_empty=True)  # that is for the reader to judge
    of_joint = joint_input(meaning)
    joint = None if of_joint is None else joints.meant.columns.get(f"q{of_joint[1] + 1}")
    if joint is not None and joint.sign < 0:
        turned = {"1": "-1", "+1": "-1", "1.0": "-1", "-1": "1", "-1.0": "1"}
        cells = [turned.get(cell, cell) for cell in cells]
    return cells


def points_text(points: MeantTable, poses: Sequence[str], xyz_mm: Array) -> str:
    """Text of points.csv."""
    as_told = re.compile(r"target|counts_as|[qrs][wxyz].*|._r.*")
    further = [m for m in points.meant.columns if as_told.fullmatch(m)]
    columns = [points.cells(m) for m in further]
    body = [
        [pose, *("" if np.isnan(v) else repr(float(v)) for v in place), *(column[i] for column in columns)]
        for i, (pose, place) in enumerate(zip(poses, xyz_mm, strict=True))
    ]
    return rows_csv([["pose", "x_mm", "y_mm", "z_mm", *further], *body])


def lengths_text(report: ImportReport, points: MeantTable, poses: Sequence[str]) -> str:
    """Text of points.csv with measured lengths, in mm, each with its pose's name."""
    length = points.length
    assert length is not None
    lengths_mm = points.table.numbers(length.name, report.fault) * LENGTHS_MM[length.meaning.removeprefix("length_")]
    further = [name for name in ("anchor", "target") if name in points.meant.columns]
    body = zip(poses, map(repr, lengths_mm.tolist()), *map(points.cells, further), strict=False)
    return rows_csv([["pose", "length_mm", *further], *map(list, body)])


@dataclass(frozen=True)
class Content:
    """Content of a dataset folder to be written."""

    robot: Robot
    poses_csv: str
    points_csv: str | None
    scans: Mapping[str, Path]  # a file by its stem
    description: str
    template: Path | None = None  # the user's own robot file, kept for a calibrated one of the same form
    point_sigma_mm: float | None = None
    place_sigma_mm: float | None = None
    notes: tuple[str, ...] = ()
    measured: MeasuredPoses | None = None  # by a plug-in
    edge_mm: float | None = None  # of the jig in scans, one length whatever the faces' shape
    meshes: tuple[bytes | None, ...] = ()  # (n,) STL of what each joint moves, mm, in its frame


def checked(content: Content) -> Dataset:
    """Dataset with this content, scans only checked to exist. Raises DatasetError where it cannot be read."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "dataset"
        folder.mkdir()
        _draft(folder, content, with_scans=False)
        try:
            return load_dataset(folder)
        except CalibError as error:
            raise DatasetError(str(error).replace(f"{folder}/", "as a dataset, ")) from None


def written(out: Path, content: Content) -> Dataset:
    """Write a dataset to a temporary folder, read it for checking, and move it into place. Raises DatasetError."""
    with new_folder(out) as final:
        draft = final.with_name("draft")
        draft.mkdir()
        _draft(draft, content, with_scans=True)
        try:
            dataset = load_dataset(draft)
            write_dataset(replace(dataset, name=out.resolve().name, description=content.description), final)
            if content.template is not None:
                shutil.copyfile(content.template, final / template_name(content.template))
            load_dataset(final)
        except CalibError as error:
            raise DatasetError(str(error).replace(str(draft), str(out)).replace(str(final), str(out))) from None
    return load_dataset(out)


def _draft(folder: Path, content: Content, *, with_scans: bool) -> None:
    document: dict[str, Any] = {"format": 1, "name": "imported"}
    if content.points_csv is not None:
        document["points"] = "points.csv"
    if content.notes:
        document["notes"] = list(content.notes)
    declared = scanner_document(Scanner(content.point_sigma_mm, place_sigma_mm=content.place_sigma_mm))
    if content.measured is not None:
        declared = content.measured.scanner_table(declared)
        document |= content.measured.write(folder, with_files=with_scans)
    if declared:
        document["scanner"] = declared
    if content.scans:
        edges = {} if content.edge_mm is None else {"edge_mm": [content.edge_mm] * 3}
        document |= {"scans": "scans", "jig": edges}
        (folder / "scans").mkdir()
        for path in content.scans.values():
            if with_scans:
                shutil.copyfile(path, folder / "scans" / path.name)
            else:
                (folder / "scans" / path.name).touch()
    robot = _with_meshes(folder, content.robot, content.meshes) if with_scans else content.robot
    (folder / "robot.toml").write_text(robot_to_toml(robot), encoding="utf-8")
    (folder / "poses.csv").write_text(content.poses_csv, encoding="utf-8")
    if content.points_csv is not None:
        (folder / "points.csv").write_text(content.points_csv, encoding="utf-8")
    (folder / "dataset.toml").write_text(tomli_w.dumps(document), encoding="utf-8")


def _with_meshes(folder: Path, robot: Robot, meshes: Sequence[bytes | None]) -> Robot:
    """Robot with its links' meshes written to the folder, an STL a joint."""
    joints = list(robot.joints)
    for k, content in enumerate(meshes):
        if content is not None:
            (folder / MESH_FOLDER).mkdir(exist_ok=True)
            joints[k] = replace(joints[k], mesh=f"{MESH_FOLDER}/joint{k + 1}.stl")
            (folder / MESH_FOLDER / f"joint{k + 1}.stl").write_bytes(content)
    return replace(robot, joints=tuple(joints))
