"""Whole datasets with known truth: an arm with link errors and effects, its poses, its points or scans.

The arm's errors are drawn in `calib.simulation.truth.arm_sampling`, its poses in `calib.simulation.pose_design`. The
true positions follow from `calib.simulation.truth.equilibrium`; `calib.simulation.measured_dataset` measures them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.jig import Jig
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import ending_at_tool_point
from calib.robot_formats.robots import load_robot
from calib.simulation.carried_scanner import draw_jig_in_view, poses_with_jig_in_view
from calib.simulation.measured_dataset import Simulation, measure
from calib.simulation.pose_design import (
    draw_flange_mount,
    draw_jig_place,
    draw_scanner_pose,
    draw_setups,
    facing_poses,
    scan_poses,
    spread_poses,
)
from calib.simulation.scanner import STRUCTURED_LIGHT, ScanModel
from calib.simulation.scene import CUBE_CORNER
from calib.simulation.truth.arm_sampling import (
    SIMULATED,
    TYPICAL,
    EffectRequest,
    Tolerances,
    check_effects,
    draw_truth,
    effect_name,
)
from calib.simulation.truth.mechanism import Conditions
from calib.workcell.jig_on_tool import with_jig

PAYLOADS_KG = (0.0, 1.0, 2.5)


def draw_conditions(robot: Robot, count: int, *, rng: np.random.Generator) -> Conditions:
    """Random conditions of `count` consecutive poses: every column of poses.csv except the setup.

    A pose takes 25 to 60 s. The cell warms up by about 10 K in the first hour or so and swings by 2 K with the
    air conditioning, so that temperature and time are not confounded. Joints come from either side at random.
    """
    time_s = np.asarray(np.round(np.cumsum(np.append(0.0, rng.uniform(25.0, 60.0, count - 1))), 1), dtype=float)
    swing = np.sin(2.0 * np.pi * (time_s / rng.uniform(900.0, 1500.0) + rng.random()))
    warming = 1.0 - np.exp(-time_s / rng.uniform(1200.0, 2400.0))
    temperature_c = 20.0 + rng.uniform(9.0, 12.0) * warming + rng.uniform(1.5, 2.5) * swing
    return Conditions(
        payload_kg=rng.choice(np.array(PAYLOADS_KG), count),
        temperature_c=np.round(temperature_c, 2),
        time_s=time_s,
        approach=rng.choice(np.array([-1.0, 1.0]), (count, robot.n_joints)),
    )


def simulate_dataset(
    robot: Robot | str | Path,
    *,
    rng: np.random.Generator | int,
    effects: Sequence[EffectRequest] = (),
    visible_sigmas: float | None = None,
    conditions: bool | None = None,
    poses: int = 64,
    noise_mm: float = 0.05,
    scans: bool = False,
    name: str = "simulated",
    description: str = "",
    jig: Jig = CUBE_CORNER,
    tolerances: Tolerances = TYPICAL,
    scan_model: ScanModel = STRUCTURED_LIGHT,
    payloads_kg: Sequence[float] = (),
    every_payload: bool = False,
    repeats: int = 1,
    setups: int = 1,
    orientation_sigma_rad: float | None = None,
) -> Simulation:
    """A simulated dataset of an arm near the given nominal robot, with the known truth.

    Where the arm carries the scanner, the scanner is on the flange and the jig stands in front of the arm.

    Args:
        robot: a robot, its file, or the name of a built-in one.
        rng: generator of all that is drawn, or a seed of one.
        effects: of the true arm, each by name (`SIMULATED_EFFECTS`, `OUTSIDE_EFFECTS`), as (name, visible magnitude in
            noise sigmas), or with all parameters; the rest is drawn.
        visible_sigmas: visible magnitude of effects given by name alone; None: each moves the point by 0.2 to 0.5 mm.
        conditions: payload, temperature, time and approach vary and are columns of poses.csv; None: where an effect
            needs them.
        poses: their number; one is the reference, the others are split 50 : 13 into train and test (Jang 2025).
        noise_mm: standard deviation of a measured point along each axis; scans have that of `scan_model` instead.
        scans: poses keep the jig in the scanner's field, and scans are cast. Otherwise points over the work space.
        payloads_kg: each pose carries one of these; (): no payload and no such column, or those of `conditions`.
        every_payload: all poses are measured under each of `payloads_kg`, in one run a payload: `poses` of each.
        repeats: measurements of each pose (points only).
        setups: number of placements of the scanner that share the poses (points only).
        orientation_sigma_rad: noise about each axis of the jig's orientation at each point; None: no orientations.

    Raises:
        CalibError: an unknown effect, too few poses, or a robot that lacks what the effect needs.

    >>> import calib
    >>> calib.simulate_dataset("rb5", rng=0, effects=["joint_compliance"], poses=40).dataset
    Dataset(simulated: RB5-850, 6 joints; 40 poses (1 reference, 31 train, 8 test); 40 points)
    """
    robot, rng = load_robot(robot), np.random.default_rng(rng)
    if poses < 2:
        raise CalibError(f"found {poses} poses, a dataset needs 2 or more: the reference and one to compare with")
    if not np.isfinite(noise_mm) or noise_mm < 0:
        raise CalibError(f"noise_mm is {noise_mm:g}; a standard deviation is 0 or more")
    check_effects(effects)
    if every_payload and len(payloads_kg) < 2:
        raise CalibError(
            f"found {len(payloads_kg)} payloads; every_payload takes 2 or more, such as payloads_kg=(0, 2.5)"
        )
    if setups < 1 or (setups > 1 and (scans or 4 * setups > poses)):
        raise CalibError(
            f"found {setups} setups for {poses} poses; simulate points, with 4 poses or more for each setup"
        )
    kinds = [SIMULATED[effect_name(effect)] for effect in effects]
    facing = [kind.name for kind in kinds if kind.needs_facing_jig]
    if robot.carries_scanner and facing:
        raise CalibError(
            f"cannot simulate the effect {facing[0]} with a scanner on the flange: no fit takes it there; simulate a "
            "scanner beside the arm"
        )
    robot = ending_at_tool_point(robot)
    if scans and not robot.carries_scanner:
        robot = with_jig(robot, jig)
    base_T_scanner = draw_scanner_pose(robot, rng=rng)
    placed, base_T_jig = base_T_scanner, None
    if scans:
        if robot.carries_scanner:
            placed = draw_flange_mount(rng=rng)
            base_T_jig = draw_jig_in_view(robot, placed, rng=rng, jig=jig)
            candidates = poses_with_jig_in_view(robot, placed, base_T_jig, 4 * poses, rng=rng, jig=jig)
        else:
            candidates = scan_poses(robot, base_T_scanner, 4 * poses, rng=rng, jig=jig)
        q = candidates[spread_poses(np.where(robot.is_revolute, candidates, candidates / 300.0), poses)]
    elif facing:
        q = facing_poses(robot, base_T_scanner, poses, rng=rng)
    else:
        q = random_poses(robot, poses, rng=rng)
    q = rounded(robot, q)
    role = draw_roles(poses, rng=rng) if every_payload else None
    if role is not None:
        again = np.tile(np.where(role == "reference", "train", role), len(payloads_kg) - 1)
        q, role = np.tile(q, (len(payloads_kg), 1)), np.concatenate([role, again])
    poses = len(q)
    if conditions is None:
        conditions = any(kind.needs_conditions for kind in kinds)
    drawn = draw_conditions(robot, poses, rng=rng) if conditions else Conditions()
    drawn = replace(drawn, **{column: None for kind in kinds for column in kind.unrecorded})
    if len(payloads_kg):
        loads_kg = np.asarray(payloads_kg, dtype=float)
        each = len(q) // len(loads_kg)
        drawn = replace(drawn, payload_kg=np.repeat(loads_kg, each) if every_payload else rng.choice(loads_kg, poses))
    if robot.carries_scanner and base_T_jig is None:
        placed, base_T_jig = draw_flange_mount(rng=rng), draw_jig_place(robot, rng=rng)
    scanners = {"": placed}
    if setups > 1:
        scanners = draw_setups(placed, setups, rng=rng)
        drawn = replace(drawn, setup=np.sort(rng.permutation(np.resize(list(scanners), poses))))
    truth = draw_truth(
        robot,
        scanners,
        q,
        base_T_jig=base_T_jig,
        effects=effects,
        tolerances=tolerances,
        conditions=drawn,
        noise_mm=noise_mm,
        visible_sigmas=visible_sigmas,
        rng=rng,
    )
    width = max(2, len(str(poses)))
    ids = tuple(f"p{i + 1:0{width}d}" for i in range(poses))
    table = Poses(
        ids=ids,
        role=draw_roles(poses, rng=rng) if role is None else role,
        q=q,
        setup=np.full(poses, "") if drawn.setup is None else drawn.setup,
        scan_names=tuple(f"{pose_id}.ply" for pose_id in ids),
        payload_kg=drawn.payload_kg,
        temperature_c=drawn.temperature_c,
        time_s=drawn.time_s,
        approach=drawn.approach,
    )
    return measure(
        robot,
        truth,
        table,
        rng=rng,
        name=name,
        description=description,
        jig=jig,
        noise_mm=None if scans else noise_mm,
        scan_model=scan_model if scans else None,
        repeats=repeats,
        orientation_sigma_rad=orientation_sigma_rad,
    )


def draw_roles(count: int, *, rng: np.random.Generator) -> NDArray[np.str_]:
    """Random roles (count,): the first pose is the reference, and 13 in 63 of the other poses are test poses."""
    role = np.full(count, "train", dtype="<U9")
    role[0] = "reference"
    role[1 + rng.permutation(count - 1)[: round((count - 1) * 13 / 63)]] = "test"
    return role


def rounded(robot: Robot, q: Array) -> Array:
    """Joint vectors rounded as a controller would command them: to 0.001 deg, or 0.001 mm."""
    return np.where(robot.is_revolute, np.radians(np.round(np.degrees(q), 3)), np.round(q, 3))
