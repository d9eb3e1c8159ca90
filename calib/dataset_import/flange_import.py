"""Poses of the flange with measured points, or alone with one tip visited, as a dataset for tool and base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.consistency.agreement import points_of_poses
from calib.consistency.flange_fit import bad_rows, flange_fit, poorly_known_sentence, tool_sentence
from calib.consistency.joint_convention import FEWEST_POSES, best_agreement
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import without_poses
from calib.dataset_import.columns import Meaning
from calib.dataset_import.flange_poses import CARTESIAN_JOINTS, FlangePoses, clear_reading, joints_in_place, readings_of
from calib.dataset_import.plan import ImportPlan, ImportSources, plan_import
from calib.kinematics.cartesian import cartesian_arm
from calib.kinematics.robot import TOOL_POINT, Robot, Target
from calib.rendering import numbers
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile
from calib.text_files.user_table import UserTable, load_table

_OPEN_MM = 500.0  # tolerance of a tool point of which nothing is known
_ONE_TIP = ("x_mm", "y_mm", "z_mm")  # columns of the place that is visited, the same in all rows
_FEWEST_VISITS = 3


def plan_of_flange_poses(sources: ImportSources, path: Path) -> ImportPlan:
    """Plan of an import of flange poses, read in the way that agrees with the points. Raises CalibError.

    Without points all poses have to visit one tip.
    """
    table = load_table(path, any_encoding=True)
    readings = readings_of(table)
    name = sources.arm.name if sources.arm is not None else "poses of the flange"
    plans = [_planned(sources, table, one, cartesian_arm(name)) for one in readings]
    datasets = [plan.preview for plan in plans if plan.preview is not None]
    if len(datasets) < len(plans):
        return next(plan for plan in plans if plan.preview is None)
    if min(len(points_of_poses(one)[0]) for one in datasets) < _fewest(sources):
        fault = f"{path}: {len(table)} poses; {_fewest(sources)} are needed at least, with different attitudes"
        return replace(plans[0], faults=(fault,), content=None, preview=None)
    agreed = [best_agreement(one.robot, *_measured(one)) for one in datasets]
    what = "the points" if sources.points is not None else "the visited tip"
    chosen, note = clear_reading(path, readings, [one.left_mm for one in agreed], f"what {what} show", what)
    x, y, z = agreed[readings.index(chosen)].tool_mm.tolist()
    robot = replace(cartesian_arm(name), targets=(Target(TOOL_POINT, (x, y, z), _OPEN_MM),))
    plan = _planned(sources, table, chosen, robot)
    assert plan.preview is not None
    told, doubts = _told(plan.preview, what)
    return replace(plan, notes=(*plan.notes, note, *told), doubts=(*plan.doubts, *doubts))


def _fewest(sources: ImportSources) -> int:
    return _FEWEST_VISITS if sources.points is None else FEWEST_POSES - 1


def _measured(dataset: Dataset) -> tuple[Array, Array]:
    poses, points_mm = points_of_poses(dataset)
    return dataset.poses.q[poses], points_mm


def _planned(sources: ImportSources, table: UserTable, reading: FlangePoses, robot: Robot) -> ImportPlan:
    joints = joints_in_place(table, reading)
    if sources.points is None:
        joints = replace(
            joints, columns=(*joints.columns, *_ONE_TIP), rows=tuple((*row, "0", "0", "0") for row in joints.rows)
        )
    named = {column: Meaning(column[:2], column[3:]) for column in CARTESIAN_JOINTS}
    return plan_import(
        replace(
            sources, robots=(RobotReading("", RobotFile(robot, None)),), joints=table.path,
            tables={table.path: joints}, mapping={**named, **sources.mapping},
        )
    )  # fmt: skip


def _told(dataset: Dataset, what: str) -> tuple[list[str], list[str]]:
    """Notes and doubts on the tool point, the rows that err, and what the poses do not determine."""
    bad = bad_rows(dataset)
    found = flange_fit(fit_measured(without_poses(dataset, tuple(bad))))
    assert found is not None
    doubts = list(filter(None, [poorly_known_sentence(found)]))
    if bad:
        named = [f"{name} ({off_mm:.3g} mm)" for name, off_mm in bad.items()]
        doubts.insert(0, f"farther from {what} than the noise of the others: {numbers.listing(named)}; look at them")
    return [tool_sentence(found)], doubts
