"""The command `plan`: poses to measure, for a robot or for a dataset."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.api.causes import diagnose
from calib.array_types import Array, Vector
from calib.compensation.target_files import load_targets
from calib.dataset.dataset import Box, Dataset, Poses, Surroundings
from calib.dataset.files.atomic_write import write_all_atomically
from calib.effects.catalogue import effects_named
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.options import BUILTIN_ROBOTS
from calib.planning.criterion import PlanTask
from calib.planning.plan import (
    CANDIDATES,
    FIRST_SET,
    BoxRegion,
    criterion_of,
    plan_poses,
    task_of_diagnosis,
)
from calib.planning.purpose import FURTHER, PlanPurpose, purposes
from calib.planning.start import FromFit, FromRobot, Start, start_of_dataset
from calib.planning.unknowns import DEFAULT_NOISE_MM
from calib.robot_formats.robot_file import named_robot
from calib.workcell.known_cell import CUBE_CORNER, workcell_of_dataset, workcell_of_robot
from calib.workcell.scan_field import JANG_FIELD
from calib.workcell.scanner_place import scanner_at
from inspector.cli.calibrate_command import loaded_effects
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options.fits import PlanOptions
from inspector.cli.output_paths import check_outputs
from inspector.cli.progress import stages
from inspector.export.plan_files import check_plan_file, planned_file

BALL = "ball"
_SAME = 1e-4  # rad or mm by which the joints of one pose may differ between two tables


def run_plan(options: PlanOptions) -> int:
    """Choose poses, and print the reasons and the expected result."""
    if options.out is not None:
        check_plan_file(options.out)
    purpose = purposes().get(options.purpose)
    if purpose is not None and purpose.why_no_candidates and options.candidates is not None:
        raise CalibError(
            f"{options.candidates}: --for {purpose.name} {purpose.why_no_candidates}; leave out --candidates"
        )
    user_effects: Sequence[Family] = ()
    if purpose is not None and purpose.of_diagnosis:
        task = _task(options, purpose)
    else:
        criterion = criterion_of(options.purpose, payload_kg=options.payload_kg)
        if options.path.is_dir() and options.poses is None:
            start, user_effects = _dataset_start(options)
            task = PlanTask(start, options.add or (purpose.usual_count if purpose else FURTHER), criterion)
        else:
            task = PlanTask(_first_start(options), options.poses or FIRST_SET, criterion)
    region = options.region if isinstance(options.region, str) else BoxRegion(*_corners(options.region))
    given = None if options.candidates is None else _candidates(options.candidates, task.start)
    plan = plan_poses(
        task.start,
        task.count,
        criterion=task.criterion,
        region=region,
        user_effects=user_effects,
        candidates=given or CANDIDATES,
        seed=options.seed,
    )
    written = {} if options.out is None else {options.out: planned_file(plan)}
    for added in options.added:
        written |= added.files(plan)
    write_all_atomically(written)
    show(options, plan.to_dict(), plan.summary())
    return 0


def _check_outputs(options: PlanOptions, dataset: Dataset) -> None:
    outputs = [options.out, *(path for added in options.added for path in added.outputs())]
    inputs = [options.effects_file, *(path for added in options.added for path in added.inputs())]
    check_outputs(dataset, outputs, inputs)


def _refuse(options: PlanOptions, *cases: tuple[object, str]) -> None:
    """Raise CalibError for the first case that is given, with what is said of it."""
    for given, why in cases:
        if given:
            raise CalibError(f"{options.path}: {why}")


def _dataset_of(options: PlanOptions) -> tuple[Dataset, tuple[Family, ...]]:
    """Measured dataset, and the user's own effects for it."""
    _refuse(
        options,
        (options.poses is not None, "--poses is a first set; give --add for more of a dataset"),
        (options.noise_mm is not None, "the noise is known from the fit; leave out --noise-mm"),
        (options.scanner, "further poses are measured from where the scanner stood last; leave out --scanner"),
    )
    dataset = load(options.path, options, options.finder)
    _check_outputs(options, dataset)
    dataset = measured(dataset, options.residual)
    return dataset, loaded_effects(options.effects_file, dataset)


def _task(options: PlanOptions, purpose: PlanPurpose) -> PlanTask:
    """Poses that serve a purpose after a dataset's diagnosis, such as to tell confounded effects apart."""
    is_robot = not options.path.is_dir()
    _refuse(options, (is_robot, f"--for {purpose.name} settles what a dataset's diagnosis left open; give its folder"))
    dataset, user_effects = _dataset_of(options)
    with stages() as on_step:
        diagnosis = diagnose(
            dataset, options.fit_options(), effects=options.effect, user_effects=user_effects, on_step=on_step
        )
    return task_of_diagnosis(purpose, diagnosis, options.add, options.payload_kg)


def _dataset_start(options: PlanOptions) -> tuple[FromFit, Sequence[Family]]:
    dataset, user_effects = _dataset_of(options)
    effects = effects_named(dataset, options.effect, user_effects)
    with stages() as on_step:
        start = start_of_dataset(
            dataset, options.fit_options(), effects=effects, user_effects=user_effects, on_step=on_step
        )
    return start, user_effects


def _first_start(options: PlanOptions) -> FromRobot:
    """Start of a plan from a robot, or from a dataset's arm and cell without its measurements."""
    is_dataset = options.path.is_dir()
    of_fit = options.effects_file is not None or options.effect
    _refuse(
        options,
        (options.add is not None, "--add is more of a dataset, --poses a first set: give the one that you want"),
        (of_fit, "effects are of a dataset's fit; name those that you suspect with --for"),
        (is_dataset and options.scanner, "the scanner stands where it stood; leave out --scanner with --poses"),
    )
    if is_dataset:
        dataset = load(options.path, options, options.finder)
        _check_outputs(options, dataset)
        noise_mm = options.noise_mm or dataset.scanner.point_sigma_mm or DEFAULT_NOISE_MM
        return FromRobot(workcell_of_dataset(measured(dataset)), noise_mm, options.fit_options())
    jig = None if options.target == BALL else CUBE_CORNER
    around = Surroundings(boxes=tuple(Box(f"box {k + 1}", *_corners(box)) for k, box in enumerate(options.boxes)))
    robot = _robot(options)
    placed = None if options.scanner is None else _placed(options.scanner, robot)
    cell = workcell_of_robot(robot, base_T_scanner=placed, jig=jig, surroundings=around)
    return FromRobot(cell, options.noise_mm or DEFAULT_NOISE_MM, options.fit_options())


def _candidates(path: Path, start: Start) -> Poses:
    """Poses of a table to choose from, without those that were measured already. Raises CalibError."""
    poses = load_targets(path, start.dataset.robot).poses
    repeated = [pose_id for pose_id, times in Counter(poses.ids).items() if times > 1]
    if repeated:
        raise CalibError(f"{path}: column pose: {repeated[0]!r} stands there twice; each pose needs its own id")
    if start.measured is None:
        return poses
    known = dict(zip(start.measured.ids, start.measured.q, strict=True))
    again = [i for i, pose_id in enumerate(poses.ids) if pose_id in known]
    other = [i for i in again if not np.allclose(poses.q[i], known[poses.ids[i]], atol=_SAME)]
    if other:
        raise CalibError(
            f"{path}: column pose: {poses.ids[other[0]]!r} was measured at other joints; give the candidate another id"
        )
    new = np.setdiff1d(np.arange(len(poses)), again)
    if not len(new):
        raise CalibError(f"{path}: all {len(poses)} poses were measured already; give poses that were not")
    return poses.select(new)


def _corners(box: Sequence[float]) -> tuple[Vector, Vector]:
    """Least and largest x, y and z of a box given as x0, x1, y0, y1, z0, z1."""
    x0, x1, y0, y1, z0, z1 = box
    return (x0, y0, z0), (x1, y1, z1)


def _robot(options: PlanOptions) -> Robot:
    """Robot given by a built-in name or a file."""
    name, is_there = str(options.path), options.path.exists()
    builtin = not is_there and name.lower() in BUILTIN_ROBOTS
    if not builtin and not is_there:
        known = " or ".join(BUILTIN_ROBOTS)
        raise CalibError(f"{name}: no such file or folder; give a dataset's folder, a robot's file, or {known}")
    return named_robot(name.lower() if builtin else name, options.reading()).robot


def _placed(numbers: Sequence[float], robot: Robot) -> Array:
    """base_T_scanner of the option --scanner; the scanner looks at the default point where none is given."""
    if len(numbers) == 6:
        return scanner_at(np.array(numbers[:3]), np.array(numbers[3:]))
    usual = workcell_of_robot(robot).base_T_scanner
    assert usual is not None
    return scanner_at(np.array(numbers), usual[:3, 3] + JANG_FIELD.distance_mm * usual[:3, 2])
