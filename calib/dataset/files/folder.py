"""The dataset folder (format version 1: dataset.toml, robot.toml, poses.csv, points.csv), read, checked and written."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from calib.array_types import Vector
from calib.dataset.attachments import AttachedValue, Attachment
from calib.dataset.dataset import About, Dataset, Points, Poses, usual_residual
from calib.dataset.files.atomic_write import write_all_atomically
from calib.dataset.files.cell_tables import (
    load_jig,
    load_mount,
    load_scanner,
    load_signal_noise,
    load_surroundings,
    scanner_document,
    surroundings_document,
    unused_keys,
)
from calib.dataset.files.csv_table import TableFile
from calib.dataset.files.declared_units import load_units
from calib.dataset.files.fingerprint import table_hashes
from calib.dataset.files.points_checks import unmeasured_note
from calib.dataset.files.points_csv import load_arrived_points, load_points, points_frame
from calib.dataset.files.poses_csv import load_poses, poses_frame
from calib.dataset.files.robot_toml import load_robot_toml, refuse_beyond, robot_to_toml
from calib.dataset.files.target_tables import load_targets, target_document
from calib.dataset.lengths import with_known_anchors
from calib.dataset.link_encoders import with_link_encoders
from calib.dataset.measured_torques import with_measured_loads
from calib.errors import DatasetError, is_one_line
from calib.jig import Jig
from calib.kinematics.robot import Robot
from calib.plugins import contributions, load
from calib.scans.scan import scan_file
from calib.text_files.csv_text import frame_csv
from calib.text_files.toml_table import TomlTable, document_of

FORMAT = 1
ABOUT = ("serial", "operator", "site", "date")


def find_datasets(folder: Path) -> list[Path]:
    """The folder itself where it holds a dataset.toml, else its subfolders that are datasets, by name."""
    if folder.is_file():
        raise DatasetError(f"{folder}: is a file; give a dataset folder or one that holds datasets")
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder; give a dataset folder or one that holds datasets")
    if (folder / "dataset.toml").is_file():
        return [folder]
    below = sorted(path.parent for path in folder.glob("*/dataset.toml"))
    if not below:
        raise DatasetError(f"{folder}: found no dataset.toml here nor one folder below; a dataset folder has one")
    return below


def load_dataset(folder: str | Path) -> Dataset:
    """Read and check a dataset folder; values that are possible but suspicious go to `warnings`.

    Raises DatasetError, which names file, line and column or key, what was found, and a remedy.

    >>> import calib
    >>> calib.load_dataset("sample_data/hidden_effect_a")
    Dataset(hidden_effect_a: RB5-850, 6 joints; 64 poses (1 reference, 50 train, 13 test); 64 points)
    """
    return _read(Path(folder), None).dataset


@dataclass(frozen=True)
class ArrivingDataset:
    """A dataset that is still being measured: its `points` are those that have arrived, none where it has scans."""

    dataset: Dataset
    unseen: tuple[str, ...] = ()  # poses with a row in points.csv whose coordinates are empty
    unknown: tuple[str, ...] = ()  # names in points.csv that poses.csv does not have (yet)
    points_file: str = "points.csv"  # as dataset.toml names it


def load_arriving_dataset(folder: Path, growing: Collection[str] = ()) -> ArrivingDataset:
    """Read a dataset folder that is still being filled: points, scans, even poses may come later.

    Args:
        folder: of the dataset, whose dataset.toml and robot.toml are complete.
        growing: names of the tables whose last line may be half written; without its end it is not read yet.

    Raises:
        DatasetError: as `load_dataset`, but not for what has not arrived.
    """
    return _read(folder, growing)


def _read(folder: Path, growing: Collection[str] | None) -> ArrivingDataset:
    """A dataset folder that is complete, where `growing` is None, or still being filled."""
    top = TomlTable.load(folder / "dataset.toml")
    version = top.number("format")
    if version != FORMAT:
        found = "the key is missing" if version is None else f"found {version:g}"
        raise top.error("format", found, f"this program reads format = {FORMAT}")
    name = top.text("name") or folder.resolve().name
    if not is_one_line(name):
        raise top.error("name", f"found {name!r}", "a name is one line without control characters")
    description = top.text("description", "", lines=True) or ""
    robot_path = inside(folder, top.text("robot", "robot.toml") or "", top, "robot")
    scanner_table = top.table("scanner")
    robot = replace(load_robot_toml(robot_path), carries_scanner=load_mount(scanner_table))
    refuse_beyond(robot, robot_path)
    poses_path = inside(folder, top.text("poses", "poses.csv") or "", top, "poses")
    units = load_units(top.table("units"))
    poses, warnings = load_poses(poses_path, robot, units, growing=poses_path.name in (growing or ()))
    points_name, scan_folder = top.text("points"), top.text("scans")
    if points_name is None and scan_folder is None:
        raise top.error("points", "neither points nor scans is given", 'add points = "points.csv" or scans = "scans"')
    points = None
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    if points_name is not None and growing is not None:
        points_path = inside(folder, points_name, top, "points")
        arrived = load_arrived_points(points_path, robot, poses, units, growing=points_path.name in growing)
        points, unseen, unknown = arrived.points, arrived.unseen, arrived.unknown
    elif points_name is not None:
        points_path = inside(folder, points_name, top, "points")
        points, point_warnings = load_points(points_path, robot, poses, units)
        warnings += point_warnings
        points = _with_anchors(points, top, robot, poses)
        notes = unmeasured_note(points_path, poses, points)
    if scan_folder is not None:
        scans = inside(folder, scan_folder, top, "scans")
        if growing is None and not scans.is_dir():
            missing = top.error("scans", f"found {scan_folder!r}, no such folder", "name the folder of the scans")
            if points is None:
                raise missing
            warnings.append(str(missing))
        _check_scans(folder, scans, poses, poses_path, needed=points is None and growing is None)
    jig_table = top.table("jig")
    targets = load_targets(jig_table, top.tables("targets"), robot)
    other = jig_table.data.get("shape") if targets and targets[0].name == "jig" else None
    jig, jig_extra = (Jig(), {}) if other else load_jig(jig_table)
    about = _about(top.table("about"))
    surroundings = load_surroundings(top.table("cell"))
    scanner = load_scanner(scanner_table)
    signal_noise = load_signal_noise(top.table("signals"))
    attachments = _attachments(top, folder, poses)
    if scanner.scan_sigma_mm is not None and scanner.scan_sigma_mm > jig.shortest_mm / 10.0:
        raise scanner_table.error(
            "scan_sigma_mm",
            f"found {scanner.scan_sigma_mm:g} mm",
            f"of a jig of {jig.edges_text()} nothing is seen above {jig.shortest_mm / 10.0:g} mm",
        )
    dataset = Dataset(
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
        notes=(*_own_notes(top), *notes, *unused_keys(top.file, {"scanner": scanner.extra, "jig": jig_extra})),
        extra=dict(top.unread()) | ({"jig": jig_extra} if jig_extra else {}),
        jig_is_declared="jig" in top.data and not other,
        about=about,
        surroundings=surroundings,
        targets=targets,
        signal_noise=signal_noise,
        attachments=attachments,
        read_files=table_hashes(folder, so_far=growing is not None),
    )
    dataset = with_link_encoders(with_measured_loads(dataset))
    return ArrivingDataset(dataset, unseen, unknown, points_name or "points.csv")


def as_dataset(dataset: Dataset | str | Path) -> Dataset:
    """The dataset, read from its folder where a path is given. Raises DatasetError."""
    if isinstance(dataset, str | Path):
        return load_dataset(dataset)
    if not hasattr(dataset, "poses"):
        raise DatasetError(f"found a {type(dataset).__name__}, expected a Dataset or the path of its folder")
    return dataset


def usual_residual_of(folder: Path) -> str:
    """Kind of residual that is fitted for a dataset's folder unless another is asked for, from dataset.toml alone.

    "position" where the file cannot be read: what opens the dataset says why.
    """
    try:
        top = TomlTable.load(folder / "dataset.toml").data
    except DatasetError:
        return "position"
    scanner = top.get("scanner")
    scanner = scanner if isinstance(scanner, dict) else {}
    by_camera, estimated = scanner.get("kind") == "camera", scanner.get("sigmas") == "estimated"
    return usual_residual(top, by_camera=by_camera, sigmas_estimated=estimated)


def dataset_files(dataset: Dataset) -> tuple[Path, ...]:
    """Every file that belongs to a dataset, scans included, whether or not a fit reads it."""
    if dataset.folder is None:
        return ()
    top = TomlTable.load(dataset.folder / "dataset.toml")
    names = [top.text("robot", "robot.toml"), top.text("poses", "poses.csv"), top.text("points")]
    return (
        dataset.folder / "dataset.toml",
        *(dataset.folder / name for name in names if name),
        *_attached_files(dataset),
        *_meshes(dataset),
        *_scans(dataset),
    )


def _scans(dataset: Dataset) -> list[Path]:
    """Files of the scans, each once, whether or not they are there; several scans may lie in one file."""
    paths = map(dataset.scan_path, range(len(dataset.poses)))
    return list(dict.fromkeys(scan_file(path) for path in paths if path is not None))


def _attachments(top: TomlTable, folder: Path, poses: Poses) -> dict[str, AttachedValue]:
    """Values of plug-ins that have a table in dataset.toml. Raises DatasetError."""
    found = {each.name: load(each.load)(top.table(each.name), folder, poses) for each in contributions(Attachment)}
    return {name: value for name, value in found.items() if value is not None}


def _attached_files(dataset: Dataset) -> list[Path]:
    """Files of attached values in the dataset's folder."""
    folder, poses = dataset.folder, dataset.poses.ids
    if folder is None:
        return []
    return [path for value in dataset.attachments.values() for path in value.files(folder, poses)]


def _meshes(dataset: Dataset) -> list[Path]:
    """Meshes of links that lie in the dataset's folder."""
    if dataset.folder is None:
        return []
    named = [dataset.folder / joint.mesh for joint in dataset.robot.joints if joint.mesh]
    return [path for path in named if path.is_file() and _is_below(dataset.folder, path)]


def inside(folder: Path, name: str, top: TomlTable, key: str) -> Path:
    """The path of a named file below the folder. Raises DatasetError where it leads out of the folder."""
    if not name or not _is_below(folder, folder / name):
        raise top.error(key, f"found {name!r}, which is not below the dataset's folder", "use a relative path below it")
    return folder / name


def _is_below(folder: Path, path: Path) -> bool:
    """Whether a path, links followed, lies in the folder; False for a link that leads nowhere."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a circle of links, a zero character
        return False


def _with_anchors(points: Points, top: TomlTable, robot: Robot, poses: Poses) -> Points:
    """Measured points; lengths among them with the anchors whose place [[anchors]] knows. Raises DatasetError."""
    if points.lengths is None:
        return points
    places_mm: dict[str, Vector] = {}
    for table in top.tables("anchors"):
        name, place_mm = table.text("name", "") or "", table.vector("xyz_mm")
        if place_mm is None:
            raise table.error("xyz_mm", "the key is missing", "add xyz_mm = [x, y, z] in the base frame")
        if name not in points.lengths.anchor:
            named = ", ".join(map(repr, np.unique(points.lengths.anchor).tolist()))
            raise table.error("name", f"found {name!r}", f"points.csv has lengths from {named}")
        places_mm[name] = place_mm
    return with_known_anchors(points, robot, poses, places_mm) if places_mm else points


def _about(table: TomlTable) -> About:
    """The arm's serial number, operator, site and date of [about]; the date may be a TOML date or a text."""
    texts: dict[str, str] = {}
    for key in ABOUT:
        date = table.date(key) if key == "date" else None
        texts[key] = date or table.text(key, "") or ""
        if not is_one_line(texts[key]):
            raise table.error(key, f"found {texts[key]!r}", "a text of one line without control characters is needed")
    return About(**texts, extra=table.unread())


def _own_notes(top: TomlTable) -> tuple[str, ...]:
    """Notes that dataset.toml lists under `notes`; any other value of the key is kept as an unknown key is."""
    notes = top.data.get("notes")
    if not isinstance(notes, list) or not all(isinstance(note, str) and is_one_line(note) for note in notes):
        return ()
    return tuple(notes)


def _check_scans(folder: Path, scan_folder: Path, poses: Poses, poses_path: Path, *, needed: bool) -> None:
    """Raise DatasetError, with the line, where a pose's scan lies outside the folder or, if `needed`, is missing."""
    for row, name in enumerate(poses.scan_names):
        path = scan_folder / name
        outside = not _is_below(folder, path)
        if not outside and (not needed or scan_file(path).is_file()):
            continue
        file = TableFile.load(poses_path)  # once more, for the line
        column = "scan" if "scan" in file else "pose"
        if outside:
            found = f"{name!r} leaves the dataset's folder"
            raise file.error(row, column, found, "use a file name below the scan folder")
        found = f"{path} is a folder, no scan" if path.is_dir() else f"no such scan as {path}"
        raise file.error(row, column, found, f"add it or remove the pose {poses.ids[row]!r}")


def write_dataset(dataset: Dataset, folder: str | Path) -> None:
    """Write a dataset folder, which `load_dataset` reads back unchanged. Scans are copied where they lie elsewhere.

    >>> import calib
    >>> calib.write_dataset(calib.load_dataset("sample_data/hidden_effect_a"), "copy")
    >>> calib.load_dataset("copy").name
    'hidden_effect_a'
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if dataset.scan_folder is not None:
        (folder / dataset.scan_folder).mkdir(exist_ok=True)
    if dataset.folder is not None and dataset.folder.resolve() != folder.resolve():
        for source in (*_scans(dataset), *_attached_files(dataset), *_meshes(dataset)):
            if not source.is_file():
                continue
            copy = folder / source.relative_to(dataset.folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
    for value in dataset.attachments.values():
        value.write(folder)
    files: dict[Path, str | bytes] = {
        folder / "robot.toml": robot_to_toml(dataset.robot),
        folder / "poses.csv": frame_csv(poses_frame(dataset.poses, dataset.robot)),
    }
    if dataset.points is not None:
        files[folder / "points.csv"] = frame_csv(points_frame(dataset.poses, dataset.points))
    # dataset.toml last: a folder without it is not taken for a dataset.
    write_all_atomically(files | {folder / "dataset.toml": tomli_w.dumps(_dataset_document(dataset))})


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
    mount = {"mount": "flange"} if dataset.robot.carries_scanner else {}
    document["scanner"] = mount | scanner_document(dataset.scanner)
    document |= {name: value.document() for name, value in dataset.attachments.items()}
    if signals := document_of(dataset.signal_noise):
        document["signals"] = signals
    if cell := surroundings_document(dataset.surroundings):
        document["cell"] = cell
    about = {key: value for key in ABOUT if (value := getattr(dataset.about, key))} | dict(dataset.about.extra)
    if about:
        document["about"] = about
    if dataset.jig_is_declared:
        document["jig"] = document_of(dataset.jig) | dict(jig_extra)
    lengths = None if dataset.points is None else dataset.points.lengths
    if lengths is not None and lengths.known_places:
        document["anchors"] = [{"name": k, "xyz_mm": list(place)} for k, place in lengths.known_places.items()]
    if dataset.targets:
        document["targets"] = [target_document(target) for target in dataset.targets]
    return document
