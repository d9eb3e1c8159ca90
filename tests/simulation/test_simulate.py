"""Simulated datasets: poses that can be measured, errors of the declared size, files that come back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.jig import jig_geometry
from calib.kinematics.chain import forward
from calib.kinematics.joint_range import random_poses
from calib.scans.scan import load_scan
from calib.simulation.simulate import PAYLOADS_KG, simulate_dataset, write_simulation
from calib.simulation.truth.arm_sampling import (
    OUTSIDE_EFFECTS,
    SIMULATED,
    SIMULATED_EFFECTS,
    Tolerances,
    draw_truth,
)
from calib.simulation.truth.equilibrium import Truth, scanner_T_target, solve_equilibrium
from calib.simulation.truth.joint_effects import JointScale
from calib.simulation.truth.load_effects import JointCompliance
from calib.simulation.truth.mechanism import Conditions
from calib.statistics import rms_length
from calib.workcell.scan_field import JANG_FIELD

ARMS = ("rb5", "panda")
SOME = ("joint_compliance", "transmission_error", "tool_sag")
RIGID = Tolerances(length_mm=0.0, angle_deg=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("scans", [False, True])
def test_without_errors_the_measurement_is_the_nominal_chain(arm: str, scans: bool) -> None:
    simulation = simulate_dataset(
        arm,
        rng=6,
        poses=12,
        noise_mm=0.0,
        scans=scans,
        tolerances=RIGID,
    )
    dataset, truth = simulation.dataset, simulation.truth
    np.testing.assert_array_equal(solve_equilibrium(truth, dataset.poses.q).q, dataset.poses.q)
    chain = forward(dataset.robot.table, dataset.poses.q, dataset.robot.is_revolute)
    base_mm = simulation.apex_mm @ truth.base_T_scanner[:3, :3].T + truth.base_T_scanner[:3, 3]
    np.testing.assert_allclose(base_mm, chain.target_mm, atol=1e-9)
    if not scans:
        np.testing.assert_array_equal(dataset.points.xyz_mm, simulation.apex_mm)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_scan_poses_show_three_faces_inside_the_field(arm: str) -> None:
    simulation = simulate_dataset(arm, rng=7, scans=True)
    q, robot = simulation.dataset.poses.q, simulation.dataset.robot
    for k, joint in enumerate(robot.joints):
        assert np.all((q[:, k] >= joint.min) & (q[:, k] <= joint.max))
    apex_mm, T = simulation.apex_mm, simulation.scanner_T_jig
    sight = apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True)
    normals = np.einsum("nij,kj->nki", T[:, :3, :3], jig_geometry(simulation.dataset.jig)[1])
    incidence_deg = np.degrees(np.arccos(-np.einsum("nki,ni->nk", normals, sight)))
    assert incidence_deg.max() < JANG_FIELD.max_incidence_deg + 1.0  # the true arm is a little off the nominal one
    across_mm = np.abs(apex_mm[:, :2]) * (JANG_FIELD.distance_mm / apex_mm[:, 2:])
    assert np.all(across_mm < 0.5 * JANG_FIELD.width_mm - JANG_FIELD.margin_mm + 10.0)
    assert np.ptp(apex_mm[:, 2]) > 150.0
    assert np.degrees(np.std(q, axis=0)).min() > 10.0
    assert np.linalg.matrix_rank(np.cos(q) - np.cos(q).mean(axis=0)) == robot.n_joints
    role = simulation.dataset.poses.role
    assert [int(np.sum(role == r)) for r in ("reference", "train", "test")] == [1, 50, 13]
    assert role[0] == "reference"


def test_noise_and_repeats_are_as_asked() -> None:
    simulation = simulate_dataset(
        "rb5",
        rng=12,
        poses=100,
        noise_mm=0.07,
        repeats=4,
        payloads_kg=(0.0, 2.5),
    )
    points = simulation.dataset.points
    assert len(points) == 400
    error_mm = points.xyz_mm - simulation.apex_mm[points.pose]
    assert error_mm.std() == pytest.approx(0.07, rel=0.1)
    assert abs(error_mm.mean()) < 4 * 0.07 / np.sqrt(1200)
    assert set(simulation.dataset.poses.payload_kg) == {0.0, 2.5}


@pytest.mark.slow
@pytest.mark.parametrize("scans", [True, False])
def test_seed_makes_the_dataset(scans: bool) -> None:
    def once(seed: int) -> NDArray:
        simulation = simulate_dataset(
            "panda",
            rng=seed,
            poses=12,
            scans=scans,
            effects=(*SOME, "backlash", "joint_step"),
        )
        points = simulation.dataset.points
        assert (points is None) == scans
        return simulation.apex_mm if points is None else points.xyz_mm

    np.testing.assert_array_equal(once(1), once(1))
    assert np.all(np.abs(once(1) - once(2)).max(axis=1) > 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("effect", [*SIMULATED_EFFECTS, *OUTSIDE_EFFECTS])
def test_every_effect_is_simulated_by_its_name_alone(effect: str) -> None:
    """With the conditions that it needs, and 0.2 to 0.5 mm large."""
    simulation = simulate_dataset("rb5", rng=15, effects=(effect,), poses=12)
    truth, poses = simulation.truth, simulation.dataset.poses
    assert truth.effect_names == (effect,)
    plain = scanner_T_target(truth.with_effects(), poses.q, Conditions.of(poses))[:, :3, 3]
    moved_mm = rms_length(simulation.apex_mm - plain)
    assert 0.2 <= moved_mm <= 0.5
    kind = SIMULATED[effect]
    assert (poses.time_s is not None) == kind.needs_conditions
    assert (poses.temperature_c is not None) == (kind.needs_conditions and "temperature_c" not in kind.unrecorded)
    document = simulation.document()
    assert list(document["effects"]) == [effect]
    assert json.loads(json.dumps(document)) == document


@pytest.mark.slow
def test_effects_are_as_visible_as_asked() -> None:
    """All alike, one by one, or given with all parameters; the noise is what a sigma means."""
    given = JointScale(np.array([0.0, 1e-4, 0.0, 0.0, 0.0, 0.0]))
    simulation = simulate_dataset(
        "rb5",
        rng=16,
        effects=("backlash", ("tool_sag", 5.0), ("joint_step", 0.0), given),
        visible_sigmas=2.0,
        noise_mm=0.02,
    )
    visible = simulation.document()["visible_rms_mm"]
    assert visible["backlash"] == pytest.approx(0.04, rel=1e-6)
    assert visible["tool_sag"] == pytest.approx(0.1, rel=1e-6)
    assert set(visible) == {"backlash", "tool_sag", "joint_scale"}
    assert simulation.document()["effects"]["joint_scale"]["k"] == given.k.tolist()
    dataset = simulation.dataset
    np.testing.assert_allclose((dataset.points.xyz_mm - simulation.apex_mm).std(), 0.02, rtol=0.15)


def test_conditions_and_setups_come_back_from_the_files(tmp_path: Path) -> None:
    simulation = simulate_dataset("panda", rng=17, conditions=True, setups=3, poses=30)
    write_simulation(simulation, tmp_path / "cell")
    made, read = simulation.dataset.poses, load_dataset(tmp_path / "cell").poses
    for name in ("payload_kg", "temperature_c", "time_s", "approach", "setup"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    assert made.payload_kg is not None
    assert made.time_s is not None
    assert made.temperature_c is not None
    assert set(made.payload_kg) == set(PAYLOADS_KG)
    assert np.all(np.diff(made.time_s) >= 25.0)
    assert 5.0 < np.ptp(made.temperature_c) < 20.0
    assert list(dict.fromkeys(made.setup)) == ["A", "B", "C"]  # one placement after the other
    document = json.loads((tmp_path / "cell" / "truth.json").read_text())
    assert list(document["setups"]) == ["A", "B", "C"]
    for setup, place in simulation.truth.scanners.items():
        np.testing.assert_allclose(document["setups"][setup]["base_T_scanner_mm"], place)
        rows = made.setup == setup
        seen = scanner_T_target(Truth(simulation.truth.robot, {"": place}), made.q[rows])
        np.testing.assert_allclose(seen[:, :3, 3], simulation.apex_mm[rows], atol=1e-9)


def test_incidence_is_simulated_where_the_jig_faces_the_scanner() -> None:
    simulation = simulate_dataset("rb5", rng=18, effects=("incidence_bias",))
    T = simulation.scanner_T_jig  # z into the material, away from the scanner
    ray = T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.sum(T[:, :3, 2] * ray, axis=1))).max() < 76.0


@pytest.mark.slow
def test_written_simulation_comes_back_with_its_truth(tmp_path: Path) -> None:
    simulation = simulate_dataset("panda", rng=13, poses=3, scans=True, effects=SOME)
    seen: list[str] = []
    write_simulation(
        simulation, tmp_path / "cell", on_progress=lambda done, of, name: seen.append(f"{done}/{of} {name}")
    )
    assert seen == ["1/3 p01", "2/3 p02", "3/3 p03"]
    dataset = load_dataset(tmp_path / "cell")
    assert dataset.warnings == ()
    assert dataset.poses.ids == simulation.dataset.poses.ids
    np.testing.assert_allclose(dataset.poses.q, simulation.dataset.poses.q, atol=1e-14)
    path = dataset.scan_path(1)
    assert path is not None
    np.testing.assert_allclose(load_scan(path).points_mm, simulation.scan(1).scan.points_mm, atol=1e-4)

    document = json.loads((tmp_path / "cell" / "truth.json").read_text())
    effect = simulation.truth.effects[0]
    assert isinstance(effect, JointCompliance)
    assert document["effects"]["joint_compliance"]["c_rad_per_nm"] == list(effect.c_rad_per_nm)
    assert set(document["effects"]) == set(SOME)
    rows = [*(f"J{j + 1}" for j in range(7)), "TCP"]
    lengths = np.array([[document["links"][row][key] for key in ("a_mm", "d_mm")] for row in rows])
    np.testing.assert_allclose(lengths, simulation.truth.robot.table[:, [0, 2]], atol=1e-12)
    error_deg = np.array([document["link_errors"][row]["alpha_deg"] for row in rows])
    nominal_deg = np.degrees(dataset.robot.table[:, 1])
    np.testing.assert_allclose(
        error_deg, [document["links"][row]["alpha_deg"] for row in rows] - nominal_deg, atol=1e-10
    )
    assert document["apex_mm"]["p02"] == simulation.apex_mm[1].tolist()


@pytest.mark.slow
def test_arm_that_cannot_show_the_jig_says_so() -> None:
    rb5 = builtin_robot("rb5")
    stiff = replace(rb5, joints=tuple(replace(joint, min=-0.05, max=0.05) for joint in rb5.joints))
    with pytest.raises(CalibError, match=r"found 0 of 8 poses that turn the jig at the scanner"):
        simulate_dataset(stiff, rng=0, poses=2, scans=True)


@pytest.mark.parametrize(
    ("wishes", "says"),
    [
        ({"effects": ("warp",)}, "'warp'; there are .*joint_step.*field_bump"),
        ({"effects": ("tool_sag", ("tool_sag", 1.0))}, "tool_sag is asked for twice"),
        ({"effects": ("tool_sag",), "visible_sigmas": 1.0, "noise_mm": 0.0}, "counted in noise sigmas"),
        ({"effects": ("scanner_scale",), "visible_sigmas": 1.0}, "no size makes it visible"),
        ({"poses": 10, "setups": 5}, "found 5 setups for 10 poses"),
        ({"poses": 1}, "found 1 poses"),
        ({"noise_mm": -0.1}, "noise_mm"),
    ],
)
def test_bad_wishes_are_one_clear_line(wishes: dict[str, Any], says: str) -> None:
    with pytest.raises(CalibError, match=says):
        simulate_dataset("rb5", rng=0, **wishes)


def test_what_a_robot_or_its_data_lack_is_said() -> None:
    robot = builtin_robot("rb5")
    bare = replace(robot, joints=tuple(replace(joint, mass_kg=None) for joint in robot.joints))
    with pytest.raises(CalibError, match=r"no mass_kg for J1, J2"):
        simulate_dataset(bare, rng=0, effects=("joint_compliance",))
    with pytest.raises(CalibError, match="simulated as points"):
        simulate_dataset(robot, rng=0, poses=3).scan(0)


def test_joint_limits_beyond_half_a_turn_leave_no_room_for_poses() -> None:
    robot = builtin_robot("panda")
    joints = list(robot.joints)
    joints[3] = replace(joints[3], min=3.5, max=6.0)  # rad
    with pytest.raises(CalibError, match="joint J4 has no range"):
        random_poses(replace(robot, joints=tuple(joints)), 3, rng=np.random.default_rng(0))


def test_draw_truth_follows_the_tolerances() -> None:
    robot = builtin_robot("rb5")
    rng = np.random.default_rng(14)
    q = random_poses(robot, 4, rng=rng)
    errors = np.array(
        [draw_truth(robot, np.eye(4), q, rng=rng).robot.table - robot.table for _ in range(200)]
    )  # (200, 7, 5)
    assert errors[..., [0, 2]].std() == pytest.approx(0.3, rel=0.05)
    assert np.degrees(errors[..., [1, 3, 4]].std()) == pytest.approx(0.1, rel=0.05)
    with pytest.raises(CalibError, match="there are"):
        draw_truth(robot, np.eye(4), q, rng=rng, effects=("nothing",))


def test_every_payload_is_hung_on_at_every_pose() -> None:
    made = simulate_dataset("rb5", rng=1, poses=20, payloads_kg=(0.0, 1.0, 2.5), every_payload=True).dataset
    poses = made.poses
    assert poses.payload_kg.tolist() == [0.0] * 20 + [1.0] * 20 + [2.5] * 20
    assert np.array_equal(poses.q[:20], poses.q[20:40])
    assert np.array_equal(poses.is_test[:20], poses.is_test[40:])
    assert np.count_nonzero(poses.role == "reference") == 1
    with pytest.raises(CalibError, match="2 or more"):
        simulate_dataset("rb5", rng=1, payloads_kg=(2.5,), every_payload=True)
