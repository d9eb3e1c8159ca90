"""What was recognised as the files of a dataset, written beside their place and moved there whole."""

from __future__ import annotations

import csv
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import robot_to_toml
from calib.dataset_import.columns import Recognised
from calib.dataset_import.reading import Work
from calib.dataset_import.roles import roles_of
from calib.errors import CalibError, DatasetError
from calib.kinematics.robot import Robot
from calib.user_tables.user_table import UserTable


def poses_text(
    work: Work,
    table: UserTable,
    meant: Recognised,
    ids: list[str],
    q: Array,
    scans: Path | None,
    measured: BoolArray | None,
) -> str:
    """poses.csv in the units of the columns' names: rad and mm, which the reader takes."""
    given = table.text(meant.columns["role"].name) if "role" in meant.columns else None
    roles, how = roles_of(given, len(ids), 0 if measured is None else int(np.argmax(measured)))
    work.said += [f"{table.path}: {how}"] if how else []
    names = [f"q{k + 1}_{'rad' if turns else 'mm'}" for k, turns in enumerate(work.robot.is_revolute)]
    kept = [
        m
        for m in meant.columns
        if m not in ("pose", "role", "x", "y", "z", "target") and not m.startswith("q")
    ]
    kept = [m for m in kept if not m.startswith(("s", "r")) or m in ("setup", "scan")]
    if meant.rest:
        work.said.append(f"{table.path}: other columns are kept as they are: {', '.join(meant.rest)}")
    taken = {"pose", "role", *names, *kept}
    rest = [name for name in meant.rest if name not in taken]
    body = [
        [ids[i], roles[i], *map(repr, map(float, q[i])), *cells]
        for i, cells in enumerate(
            zip(*(table.text(c) for c in [*(meant.columns[m].name for m in kept), *rest]), strict=True)
            if kept or rest
            else [()] * len(ids)
        )
    ]
    header = ["pose", "role", *names, *kept, *rest]
    if scans is not None and "scan" not in kept:
        files = {path.stem: path.name for path in sorted(scans.iterdir()) if path.is_file()}
        header.append("scan")
        body = [[*row, files.get(ids[i], f"{ids[i]}.ply")] for i, row in enumerate(body)]
    return _csv([header, *body])


def points_text(table: UserTable, meant: Recognised, poses: Sequence[str], xyz_mm: Array) -> str:
    """points.csv."""
    further = [
        m for m in meant.columns if m == "target" or (m[:1] in "qrs" and m[1:2] in "wxyz") or m[1:3] == "_r"
    ]
    columns = [table.text(meant.columns[m].name) for m in further]
    body = [
        [pose, *("" if np.isnan(v) else repr(float(v)) for v in place), *(column[i] for column in columns)]
        for i, (pose, place) in enumerate(zip(poses, xyz_mm, strict=True))
    ]
    return _csv([["pose", "x_mm", "y_mm", "z_mm", *further], *body])


def _csv(rows: Sequence[Sequence[str]]) -> str:
    out = StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def written(
    out: Path,
    robot: Robot,
    poses: str,
    points: str | None,
    scans: Path | None,
    ids: Sequence[str],
    description: str,
) -> Dataset:
    """Write beside the place, read it as every command does, and move it there whole."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name[:50]}.") as made:
        draft, final = Path(made) / "draft", Path(made) / "final"
        draft.mkdir()
        _draft(draft, robot, poses, points, scans)
        try:
            dataset = load_dataset(draft)
            write_dataset(replace(dataset, name=out.resolve().name, description=description), final)
            load_dataset(final)
        except CalibError as error:
            raise DatasetError(
                str(error).replace(str(draft), str(out)).replace(str(final), str(out))
            ) from None
        if out.exists():
            out.rmdir()  # empty
        final.rename(out)
    return load_dataset(out)


def _draft(folder: Path, robot: Robot, poses: str, points: str | None, scans: Path | None) -> None:
    lines = ["format = 1", 'name = "imported"']
    lines += ['points = "points.csv"'] if points is not None else []
    if scans is not None:
        lines.append('scans = "scans"')
        shutil.copytree(scans, folder / "scans", symlinks=False)
    lines += ["[jig]"] if scans is not None else []
    (folder / "robot.toml").write_text(robot_to_toml(robot), encoding="utf-8")
    (folder / "poses.csv").write_text(poses, encoding="utf-8")
    if points is not None:
        (folder / "points.csv").write_text(points, encoding="utf-8")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
