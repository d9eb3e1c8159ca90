"""What was measured, as a notebook shows it: a dataset."""

from __future__ import annotations

import numpy as np

from calib.dataset.dataset import ROLES, Dataset
from calib.present.blocks import Block, Bullets, Facts, KeyFigures, Section, Table
from calib.views.view_page import view_html

_DIGITS = 2  # of degrees and mm in tables of the robot


def dataset_html(dataset: Dataset) -> str:
    """A dataset as HTML: what it holds, its conditions and doubts; below, the table and how far each joint moves."""
    return view_html(f"Dataset {dataset.name}", dataset_head(dataset), dataset_sections(dataset))


def dataset_head(dataset: Dataset) -> list[Block]:
    """What stands at the top: the counts, the conditions, the doubts."""
    poses = dataset.poses
    counts = {role: int(np.count_nonzero(poses.role == role)) for role in ROLES}
    setups = len(np.unique(poses.setup))
    pairs: list[tuple[str, object]] = [
        ("robot", f"{dataset.robot.name}, {dataset.robot.n_joints} joints"),
        ("poses", f"{len(poses)}: {', '.join(f'{n} {role}' for role, n in counts.items() if n)}"),
        ("measured", _measured(dataset)),
        ("placements of the instrument", setups),
    ]
    if dataset.scanner.point_sigma_mm is not None:
        pairs.append(("declared noise", f"{dataset.scanner.point_sigma_mm:g} mm a coordinate"))
    head: list[Block] = [KeyFigures(pairs)]
    if dataset.description:
        head.append(Facts([("description", dataset.description)]))
    told = [*dataset.warnings, *dataset.notes]
    return [*head, *([Bullets(told)] if told else [])]


def dataset_sections(dataset: Dataset) -> list[Section]:
    """What opens with a click: joints' ranges, conditions, the nominal table."""
    poses, robot = dataset.poses, dataset.robot
    commanded = np.where(robot.is_revolute, np.degrees(poses.q), poses.q)
    units = ["°" if turns else "mm" for turns in robot.is_revolute]
    reach = [
        (f"joint {k + 1}, {unit}", *(f"{v:.1f}" for v in (q.min(), q.max(), np.ptp(q))))
        for k, (unit, q) in enumerate(zip(units, commanded.T, strict=True))
    ]
    conditions = [
        (name, f"{values.min():g}", f"{values.max():g}")
        for name, values in (
            ("payload, kg", poses.payload_kg),
            ("temperature, °C", poses.temperature_c),
            ("time, s", poses.time_s),
        )
        if values is not None
    ]
    sections = [Section("How far the joints move", [Table(("", "from", "to", "range"), reach)])]
    if conditions:
        sections.append(Section("Conditions", [Table(("", "from", "to"), conditions)]))
    names = ("", "a, mm", "alpha, °", "d, mm", "theta, °", "beta, °")
    rows = [(f"joint {k + 1}", *_shown(joint.row)) for k, joint in enumerate(robot.joints)]
    rows.append(("tool", *_shown(robot.tool.row)))
    return [*sections, Section("The arm as robot.toml has it", [Table(names, rows)])]


def _shown(row: tuple[float, float, float, float, float]) -> list[str]:
    a, alpha, d, theta, beta = row
    return [f"{v:.{_DIGITS}f}" for v in (a, np.degrees(alpha), d, np.degrees(theta), np.degrees(beta))]


def _measured(dataset: Dataset) -> str:
    if dataset.points is None:
        return f"{len(dataset.poses)} scans of a jig of {dataset.jig.edge_words()}; no points yet"
    targets = np.unique(dataset.points.target)
    of = "" if len(targets) == 1 else f" of {len(targets)} targets"
    with_scans = ", and scans" if dataset.scan_folder is not None else ""
    return f"{len(dataset.points)} points{of}{with_scans}"
