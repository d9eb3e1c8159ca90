"""The dataset folder, read, checked and written. Format version 1: dataset.toml, robot.toml, poses.csv, points.csv."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import tomli_w
from numpy.typing import NDArray

from calib.dataset import ROLES, Dataset, Points, Poses, Scanner
from calib.errors import DatasetError
from calib.jig import Jig
from calib.robot import Robot
from calib.robot_file import degrees, load_robot, robot_to_toml
from calib.table_file import TableFile
from calib.toml_file import TomlTable, write_text_atomically

FORMAT = 1
COVARIANCE_COLUMNS = ("sxx_mm2", "sxy_mm2", "sxz_mm2", "syy_mm2", "syz_mm2", "szz_mm2")
_CONDITIONS = ("payload_kg", "temperature_c", "time_s")
_UPPER = np.triu_indices(3)


def find_datasets(folder: Path) -> list[Path]:
    """The folder itself where it holds a dataset.toml, else the datasets right below it, by name."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder; give a dataset folder or one that holds datasets")
    if (folder / "dataset.toml").is_file():
        return [folder]
    below = sorted(path.parent for path in folder.glob("*/dataset.toml"))
    if not below:
        raise DatasetError(
            f"{folder}: found no dataset.toml here nor one folder below; a dataset folder has one"
        )
    return below


def load_dataset(folder: Path) -> Dataset:
    """Read a dataset folder. Raises DatasetError; what is odd but possible stands in `warnings`."""
    folder = Path(folder)
    top = TomlTable.load(folder / "dataset.toml")
    version = top.number("format")
    if version != FORMAT:
        raise top.error("format", f"found {version}", f"this program reads format = {FORMAT}")
    name = top.text("name") or folder.name
    description = top.text("description", "") or ""
    robot = load_robot(_inside(folder, top.text("robot", "robot.toml") or "", top, "robot"))
    poses, warnings = _load_poses(_inside(folder, top.text("poses", "poses.csv") or "", top, "poses"), robot)
    points_name, scan_folder = top.text("points"), top.text("scans")
    if points_name is None and scan_folder is None:
        raise top.error(
            "points", "neither points nor scans is given", 'add points = "points.csv" or scans = "scans"'
        )
    points = None
    if points_name is not None:
        points, point_warnings = _load_points(_inside(folder, points_name, top, "points"), robot, poses)
        warnings += point_warnings
    if scan_folder is not None:
        _check_scans(folder, _inside(folder, scan_folder, top, "scans"), poses, needed=points is None)
    jig, jig_extra = _jig(top.table("jig"))
    scanner = _scanner(top.table("scanner"))
    return Dataset(
        name=name,
        robot=robot,
        poses=poses,
        points=points,
        folder=folder,
        scan_folder=scan_folder,
        description=description,
        scanner=scanner,
        jig=jig,
        warnings=tuple(warnings),
        extra=dict(top.unread()) | ({"jig": jig_extra} if jig_extra else {}),
    )


def _inside(folder: Path, name: str, top: TomlTable, key: str) -> Path:
    """A path below the folder; one that leaves it is refused."""
    path = folder / name
    if not name or not path.resolve().is_relative_to(folder.resolve()):
        raise top.error(
            key, f"found {name!r}, which is not below the dataset's folder", "use a relative path below it"
        )
    return path


def _scanner(table: TomlTable) -> Scanner:
    return Scanner(
        point_sigma_mm=table.number("point_sigma_mm", positive=True),
        scan_sigma_mm=table.number("scan_sigma_mm", positive=True),
        extra=table.unread(),
    )


def _jig(table: TomlTable) -> tuple[Jig, dict[str, Any]]:
    default = Jig()
    edge_mm = table.number("edge_mm", default.edge_mm, positive=True) or default.edge_mm
    if edge_mm < 1.0:
        raise table.error("edge_mm", f"found {edge_mm:g} mm, which looks like metres", "multiply it by 1000")
    angles = table.vector("face_angles_deg") or default.face_angles_deg
    if not all(10.0 < angle < 170.0 for angle in angles):
        raise table.error(
            "face_angles_deg", f"found {list(angles)}", "angles between faces lie between 10 and 170"
        )
    jig = Jig(
        shape=table.text("shape", default.shape, choices=(default.shape,)) or default.shape,
        edge_mm=edge_mm,
        convex=table.flag("convex", default.convex),
        face_angles_deg=angles,
        certified=table.flag("certified", default.certified),
    )
    return jig, table.unread()


def _joint_columns(robot: Robot) -> list[str]:
    return [f"q{i + 1}_{'deg' if joint.is_revolute else 'mm'}" for i, joint in enumerate(robot.joints)]


def _load_poses(path: Path, robot: Robot) -> tuple[Poses, list[str]]:
    file = TableFile.load(path)
    joint_columns = _joint_columns(robot)
    file.require(["pose", "role", *joint_columns])
    if len(file) == 0:
        raise DatasetError(f"{path}: no row below the header; one row a pose is needed")
    ids = file.text("pose")
    first: dict[str, int] = {}
    for row, pose_id in enumerate(ids):
        if first.setdefault(pose_id, row) != row:
            line = first[pose_id] + 2
            raise file.error(
                row, "pose", f"{pose_id!r} stands in line {line} too", "each pose needs its own id"
            )
    role = file.choices("role", ROLES)
    references = [row for row, value in enumerate(role) if value == "reference"]
    if len(references) != 1:
        where = ", ".join(f"line {row + 2}" for row in references) or "none"
        raise DatasetError(
            f"{path}: column role: found {len(references)} reference poses ({where}); set exactly one"
        )
    q_file = file.numbers(joint_columns)
    warnings = [*_angle_warnings(path, q_file, robot)]
    approach_columns = [f"approach{i + 1}" for i in range(robot.n_joints)]
    approach = None
    if any(column in file for column in approach_columns):
        file.require(approach_columns)
        approach = file.numbers(approach_columns)
        wrong = np.argwhere(~np.isin(approach, (-1.0, 1.0)))
        if len(wrong):
            row, k = map(int, wrong[0])
            raise file.error(row, approach_columns[k], f"found {approach[row, k]:g}", "expected -1 or 1")
    conditions = {name: file.numbers([name])[:, 0] for name in _CONDITIONS if name in file}
    known = [
        "pose",
        "role",
        *joint_columns,
        *_CONDITIONS,
        "setup",
        "scan",
        *(approach_columns if approach is not None else []),
    ]
    poses = Poses(
        ids=tuple(ids),
        role=np.array(role),
        q=np.where(robot.is_revolute, np.radians(q_file), q_file),
        setup=np.array(file.text("setup", allow_empty=True) if "setup" in file else [""] * len(ids)),
        scan_names=tuple(file.text("scan") if "scan" in file else [f"{pose_id}.ply" for pose_id in ids]),
        payload_kg=conditions.get("payload_kg"),
        temperature_c=conditions.get("temperature_c"),
        time_s=conditions.get("time_s"),
        approach=approach,
        extra=file.rest(known),
    )
    return poses, warnings


def _angle_warnings(path: Path, q_file: NDArray[np.float64], robot: Robot) -> list[str]:
    """Angles that look like radians, and angles beyond the limits: odd, yet not impossible."""
    turning = robot.is_revolute
    warnings = []
    if turning.any():
        largest = float(np.abs(q_file[:, turning]).max())
        spans = [
            j.max - j.min for j in robot.joints if j.is_revolute and j.min is not None and j.max is not None
        ]
        wide = not spans or max(spans) > math.radians(30.0)
        if wide and 0.0 < largest < 6.4:
            warnings.append(
                f"{path}: every joint angle is below 6.4 (largest {largest:.3g}); these look like radians, not degrees"
            )
    for i, joint in enumerate(robot.joints):
        low, high = (
            (math.degrees(v) if joint.is_revolute else v) if v is not None else None
            for v in (joint.min, joint.max)
        )
        beyond = np.zeros(len(q_file), dtype=bool)
        if low is not None:
            beyond |= q_file[:, i] < low - 1e-9
        if high is not None:
            beyond |= q_file[:, i] > high + 1e-9
        if beyond.any():
            row = int(np.flatnonzero(beyond)[0])
            warnings.append(
                f"{path}: {int(beyond.sum())} poses lie beyond the limits of {joint.name}, the first in line {row + 2} "
                f"({q_file[row, i]:g})"
            )
    return warnings


def _load_points(path: Path, robot: Robot, poses: Poses) -> tuple[Points, list[str]]:
    file = TableFile.load(path)
    file.require(["pose", "x_mm", "y_mm", "z_mm"])
    ids = file.text("pose")
    index = {pose_id: i for i, pose_id in enumerate(poses.ids)}
    for row, pose_id in enumerate(ids):
        if pose_id not in index:
            raise file.error(
                row, "pose", f"{pose_id!r} is not in poses.csv", "remove the row or add the pose"
            )
    measured = set(ids)
    missing = [pose_id for pose_id in poses.ids if pose_id not in measured]
    if missing:
        raise DatasetError(
            f"{path}: no point for pose {', '.join(missing[:5])}{' ...' if len(missing) > 5 else ''} "
            f"({len(missing)} of {len(poses)}); add the rows or remove the poses"
        )
    xyz_mm = file.numbers(["x_mm", "y_mm", "z_mm"])
    target = np.array(file.text("target") if "target" in file else ["jig"] * len(file))
    known_targets = ("jig", *(t.name for t in robot.targets))
    for row, name in enumerate(target):
        if name not in known_targets:
            raise file.error(row, "target", f"found {name!r}", f"robot.toml knows {', '.join(known_targets)}")
    warnings = []
    extent_mm = float(np.ptp(xyz_mm, axis=0).max())
    if len(poses) > 1 and 0.0 < extent_mm < 5.0 and np.ptp(poses.q, axis=0).max() > 0.2:
        warnings.append(
            f"{path}: all points lie within {extent_mm:.3g} mm; columns are mm, these look like metres"
        )
    covariance = _load_covariance(file) if any(c in file for c in COVARIANCE_COLUMNS) else None
    pose = np.array([index[pose_id] for pose_id in ids], dtype=np.int64)
    return Points(pose, xyz_mm, target, covariance), warnings


def _load_covariance(file: TableFile) -> NDArray[np.float64]:
    file.require(COVARIANCE_COLUMNS)
    values = file.numbers(list(COVARIANCE_COLUMNS))
    covariance = np.zeros((len(values), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = values
    covariance[:, _UPPER[1], _UPPER[0]] = values
    bad = np.flatnonzero(np.linalg.eigvalsh(covariance)[:, 0] <= 0.0)
    if len(bad):
        raise file.error(
            int(bad[0]),
            "sxx_mm2 ... szz_mm2",
            "the covariance is not positive definite",
            "give a covariance in mm^2",
        )
    return covariance


def _check_scans(folder: Path, scan_folder: Path, poses: Poses, *, needed: bool) -> None:
    for row, name in enumerate(poses.scan_names):
        path = scan_folder / name
        if not path.resolve().is_relative_to(folder.resolve()):
            raise DatasetError(
                f"{folder / 'poses.csv'}: line {row + 2}, column scan: {name!r} leaves the dataset's folder; "
                "use a file name below the scan folder"
            )
        if needed and not path.is_file():
            raise DatasetError(
                f"{path}: no such scan, pose {poses.ids[row]!r} needs it; add it or remove the pose"
            )


def write_dataset(dataset: Dataset, folder: Path) -> None:
    """Write the folder; `load_dataset` gives the same dataset back. Scans are copied where they lie elsewhere."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if dataset.scan_folder is not None:
        (folder / dataset.scan_folder).mkdir(exist_ok=True)
        if dataset.folder is not None and dataset.folder.resolve() != folder.resolve():
            for i, name in enumerate(dataset.poses.scan_names):
                source = dataset.scan_path(i)
                if source is not None and source.is_file():
                    shutil.copyfile(source, folder / dataset.scan_folder / name)
    write_text_atomically(folder / "robot.toml", robot_to_toml(dataset.robot))
    write_text_atomically(folder / "poses.csv", poses_frame(dataset).to_csv(index=False, lineterminator="\n"))
    if dataset.points is not None:
        text = points_frame(dataset.poses, dataset.points).to_csv(index=False, lineterminator="\n")
        write_text_atomically(folder / "points.csv", text)
    # dataset.toml last: a folder without it is not taken for a dataset.
    write_text_atomically(folder / "dataset.toml", tomli_w.dumps(_dataset_document(dataset)))


def _dataset_document(dataset: Dataset) -> dict[str, Any]:
    extra = dict(dataset.extra)
    jig_extra = extra.pop("jig", {})
    document: dict[str, Any] = {"format": FORMAT, "name": dataset.name}
    if dataset.description:
        document["description"] = dataset.description
    document |= {"robot": "robot.toml", "poses": "poses.csv"}
    if dataset.points is not None:
        document["points"] = "points.csv"
    if dataset.scan_folder is not None:
        document["scans"] = dataset.scan_folder
    document |= extra
    sigmas = {
        "point_sigma_mm": dataset.scanner.point_sigma_mm,
        "scan_sigma_mm": dataset.scanner.scan_sigma_mm,
    }
    document["scanner"] = {k: v for k, v in sigmas.items() if v is not None} | dict(dataset.scanner.extra)
    jig = dataset.jig
    document["jig"] = {
        "shape": jig.shape,
        "edge_mm": jig.edge_mm,
        "convex": jig.convex,
        "face_angles_deg": list(jig.face_angles_deg),
        "certified": jig.certified,
    } | dict(jig_extra)
    return document


def poses_frame(dataset: Dataset) -> pd.DataFrame:
    """poses.csv as a table: degrees for angles."""
    poses, robot = dataset.poses, dataset.robot
    columns: dict[str, Any] = {"pose": poses.ids, "role": poses.role}
    if any(poses.setup):
        columns["setup"] = poses.setup
    for k, (name, joint) in enumerate(zip(_joint_columns(robot), robot.joints, strict=True)):
        columns[name] = [degrees(v) for v in poses.q[:, k]] if joint.is_revolute else poses.q[:, k]
    for name in _CONDITIONS:
        values = getattr(poses, name)
        if values is not None:
            columns[name] = values
    if poses.approach is not None:
        columns |= {f"approach{k + 1}": poses.approach[:, k].astype(int) for k in range(robot.n_joints)}
    if poses.scan_names != tuple(f"{pose_id}.ply" for pose_id in poses.ids):
        columns["scan"] = poses.scan_names
    frame = pd.DataFrame(columns)
    return (
        pd.concat([frame, poses.extra.reset_index(drop=True)], axis=1) if len(poses.extra.columns) else frame
    )


def points_frame(poses: Poses, points: Points) -> pd.DataFrame:
    """points.csv as a table."""
    columns: dict[str, Any] = {"pose": [poses.ids[i] for i in points.pose]}
    if np.any(points.target != "jig"):
        columns["target"] = points.target
    columns |= {f"{axis}_mm": points.xyz_mm[:, k] for k, axis in enumerate("xyz")}
    if points.covariance_mm2 is not None:
        upper = points.covariance_mm2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: upper[:, k] for k, name in enumerate(COVARIANCE_COLUMNS)}
    return pd.DataFrame(columns)
