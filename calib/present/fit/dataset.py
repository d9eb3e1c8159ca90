"""Presentation of a dataset: the arm, its poses, measurements, conditions, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from calib.calibration.noise_level import noise_level
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.corners.search import CornerSearch
from calib.dataset.dataset import ROLES, Dataset, Points
from calib.dataset.files.points_csv import points_frame
from calib.dataset.files.poses_csv import joint_columns, poses_frame
from calib.measurement.measured_points import failed_searches
from calib.present import names
from calib.present.fit.calibration import calibration_warnings
from calib.present.fit.corners import scan_sentences
from calib.present.names import instrument
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Bullets, Facts, KeyFigures, Paragraph, Presentation, Section, Table

_MOST_NAMED = 8  # poses in a sentence
NOT_SEARCHED: Mapping[str, CornerSearch] = MappingProxyType({})


@presentation.register
def _dataset(dataset: Dataset) -> Presentation:
    return Presentation(
        f"Dataset {dataset.name}",
        [
            KeyFigures([("dataset", dataset.name), *facts(dataset)]),
            Paragraph(dataset.description),
            Bullets([*dataset.warnings, *dataset.notes]),
        ],
        [Section("How far the joints move", [joint_ranges(dataset)])],
    )


def measured_blocks(calibration: Calibration, searches: Mapping[str, CornerSearch]) -> list[Block]:
    """Blocks on a calibration's data: facts, noise and warnings, with the scan search where there was one."""
    dataset = calibration.dataset
    description = [("description", dataset.description)] if dataset.description else []
    rows = [("dataset", dataset.name), *description, *facts(dataset, searches, calibration)]
    return [Facts(rows), Bullets([*calibration_warnings(calibration), *scan_sentences(searches)])]


def facts(
    dataset: Dataset, searches: Mapping[str, CornerSearch] = NOT_SEARCHED, calibration: Calibration | None = None
) -> list[tuple[str, object]]:
    """Facts (name and value) on the arm, the poses by role, the measurements, the noise and the conditions."""
    poses = dataset.poses
    roles = numbers.listing([f"{count} {names.role(role)}" for role, count in _by_role(dataset).items() if count])
    return [
        ("robot", f"{dataset.robot.name}, {dataset.robot.n_joints} joints"),
        ("poses", f"{len(poses)}: {roles}"),
        ("measured", _measured(dataset, searches)),
        (f"placements of the {instrument(dataset)}", len(np.unique(poses.setup))),
        ("declared noise", _noise(dataset, calibration)),
        ("conditions", numbers.listing(_conditions(dataset)) or "none recorded"),
    ]


def preview(dataset: Dataset) -> str:
    """Sentence on the poses and points of a dataset that is to be imported, and on poses without a point."""
    poses, points = dataset.poses, dataset.points
    counts = numbers.count(len(poses), "pose")
    if points is None:
        return f"{counts}, {numbers.count(len(set(poses.scan_names)), 'scan')}."
    without = [poses.ids[i] for i in np.setdiff1d(np.arange(len(poses)), points.pose)]
    have = "have" if len(without) > 1 else "has"
    missing = f"; {numbers.listing(numbers.first_of(without, _MOST_NAMED))} {have} no point" if without else ""
    return f"{counts}, {_points(points)}{missing}."


def _points(points: Points, one: str = "point") -> str:
    """Number of points, and of their targets where there are several."""
    targets = len(np.unique(points.target))
    return numbers.count(len(points), one) + (f" of {targets} targets" if targets > 1 else "")


def first_rows(dataset: Dataset, count: int = 5) -> Table:
    """Table of the first poses: role, joint values as in poses.csv, and the first point measured at each."""
    shown = poses_frame(dataset.poses, dataset.robot)[["pose", "role", *joint_columns(dataset.robot)]].head(count)
    if dataset.points is not None and dataset.points.lengths is None:
        points = points_frame(dataset.poses, dataset.points).drop_duplicates("pose")
        shown = shown.merge(points[["pose", "x_mm", "y_mm", "z_mm"]], how="left", on="pose")
    rows = [
        (pose_id, names.role(role), *("" if np.isnan(value) else f"{value:.3f}" for value in values))
        for pose_id, role, *values in shown.itertuples(index=False)
    ]
    return Table([str(name).replace("_", " ") for name in shown], rows, left=(0, 1))


def _measured(dataset: Dataset, searches: Mapping[str, CornerSearch]) -> str:
    jig = f"a jig of {dataset.jig.edges_text()}"
    if searches:
        found = len(searches) - len(failed_searches(searches))
        return f"the corner of {jig} in {found} of {numbers.count(len(searches), 'scan')}"
    if dataset.points is None:
        return f"{numbers.count(len(dataset.poses), 'scan')} of {jig}; no points yet"
    if (lengths := dataset.points.lengths) is not None:
        return f"{_points(dataset.points, 'length')} from {numbers.count(len(np.unique(lengths.anchor)), 'anchor')}"
    return _points(dataset.points) + (", and scans" if dataset.scan_folder is not None else "")


def _noise(dataset: Dataset, calibration: Calibration | None) -> str:
    if calibration is not None:
        level = noise_level(calibration)
        length = f"{numbers.length(level.sigma_mm)} per coordinate"
        return length if level.is_declared else f"none; {level.name}: {length}"
    if not dataset.declares_noise:
        return "none"
    sigma_mm = dataset.scanner.point_sigma_mm if dataset.points is None else declared_sigma_mm(dataset)
    assert sigma_mm is not None
    return f"{numbers.length(sigma_mm)} per coordinate"


def _conditions(dataset: Dataset) -> list[str]:
    poses = dataset.poses
    ranges = (
        ("payload", poses.payload_kg, "kg"),
        ("temperature", poses.temperature_c, "°C"),
        ("time", poses.time_s, "s"),
    )
    out = [f"{name} {v.min():g} to {v.max():g} {unit}" for name, v, unit in ranges if v is not None]
    return [*out, *(["side of approach"] if poses.approach is not None else []), *poses.extra.names]


def joint_ranges(dataset: Dataset) -> Table:
    """Table of the range of each joint over the poses."""
    robot, q = dataset.robot, dataset.poses.q
    units = ["°" if turns else "mm" for turns in robot.is_revolute]
    shown = np.where(robot.is_revolute, np.degrees(q), q).T
    rows = [
        (names.joint_with_unit(k + 1, unit), *(numbers.signed(v, "z.1f") for v in (low, high, high - low)))
        for k, (unit, low, high) in enumerate(zip(units, shown.min(axis=1), shown.max(axis=1), strict=True))
    ]
    return Table(("", "from", "to", "range"), rows)


@document.register
def _dataset_document(dataset: Dataset) -> dict[str, Any]:
    return {
        **keys_of(dataset, "name", "description", "left_out", "warnings", "notes"),
        "robot": dataset.robot.name,
        "joints": dataset.robot.n_joints,
        "poses": _by_role(dataset),
        "points": None if dataset.points is None else len(dataset.points),
    }


def _by_role(dataset: Dataset) -> dict[str, int]:
    """Number of poses of each role."""
    return {role: int(np.count_nonzero(dataset.poses.role == role)) for role in ROLES}
