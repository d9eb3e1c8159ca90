"""The simulated truth: held against calib.kinematics, against MuJoCo, and against the laws it claims."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from calib.dataset_file import load_dataset
from calib.errors import CalibError
from calib.kinematics import forward
from calib.pose_design import JANG_FIELD, place_scanner, random_poses, reach_apexes, spread_poses
from calib.robot import Joint, Robot, Tool
from calib.robot_file import builtin_robot
from calib.scan import load_scan
from calib.scan_simulation import jig_geometry
from calib.simulation import (
    SIMULATED_EFFECTS,
    Tolerances,
    draw_truth,
    simulate_dataset,
    write_simulation,
)
from calib.truth import Truth, frames, gravity_torques, scanner_T_target, settle

ARMS = ("rb5", "panda")
RIGID = Tolerances(length_mm=0.0, angle_deg=0.0)


def crooked(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with errors in all its parameters, beta too."""
    return robot.with_table(robot.table + rng.normal(0.0, 0.05, robot.table.shape))


def slider() -> Robot:
    """Two turning joints with a sliding one between them."""
    return Robot(
        name="slider",
        joints=(
            Joint(a_mm=100.0, alpha_rad=1.2, d_mm=200.0, mass_kg=2.0, com_mm=(10.0, 20.0, 30.0)),
            Joint(
                a_mm=10.0,
                alpha_rad=-0.7,
                beta_rad=0.1,
                type="prismatic",
                min=0.0,
                max=300.0,
                mass_kg=1.5,
                com_mm=(0, 5.0, 0),
            ),
            Joint(a_mm=50.0, d_mm=20.0, theta_rad=0.3, mass_kg=1.0, com_mm=(-20.0, 0.0, 4.0)),
        ),
        tool=Tool(a_mm=5.0, d_mm=70.0, mass_kg=0.4, com_mm=(0.0, 0.0, 30.0), payload_com_mm=(1.0, 2.0, 80.0)),
        gravity_m_s2=(0.5, -2.0, -9.5),
    )


@pytest.mark.parametrize(
    "robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name
)
def test_elementary_chain_is_the_multiplied_out_chain(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    robot = crooked(robot, rng)
    q = random_poses(robot, 20, rng=rng)
    np.testing.assert_allclose(
        np.stack(frames(robot, q), axis=1),
        forward(robot.table, q, robot.is_revolute).base_T_frame,
        atol=1e-10,
    )


def mujoco_model(robot: Robot, payload_kg: float = 0.0) -> Any:
    """The arm as a MuJoCo model in metres: one body a link, its joint at the frame before it."""
    chain = [T[0] for T in frames(robot, np.zeros((1, robot.n_joints)))]
    rest = [np.linalg.inv(before) @ after for before, after in itertools.pairwise(chain)]

    def numbers(values: Any) -> str:
        return " ".join(f"{v:.17g}" for v in np.asarray(values, dtype=float))

    def pose(T: NDArray) -> str:
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        return f'pos="{numbers(T[:3, 3] / 1e3)}" quat="{numbers([w, x, y, z])}"'

    def mass(kg: float, place_mm: Any) -> str:
        return f'<inertial pos="{numbers(np.array(place_mm) / 1e3)}" mass="{kg:.17g}" diaginertia="1e-4 1e-4 1e-4"/>'

    tool = f'<site name="target" {pose(rest[-1])}/>'
    for kg, place_mm in ((robot.tool.mass_kg, robot.tool.com_mm), (payload_kg, robot.tool.payload_com_mm)):
        tool += f"<body>{mass(kg, place_mm)}</body>" if kg else ""
    inner = tool
    for joint, T in reversed(list(zip(robot.joints, rest, strict=False))):
        axis, origin_mm = T[:3, :3].T @ [0.0, 0.0, 1.0], -T[:3, :3].T @ T[:3, 3]
        kind = "hinge" if joint.is_revolute else "slide"
        joint_xml = f'<joint type="{kind}" axis="{numbers(axis)}" pos="{numbers(origin_mm / 1e3)}"/>'
        inner = f"<body {pose(T)}>{joint_xml}{mass(joint.mass_kg or 0.0, joint.com_mm)}{inner}</body>"
    gravity = numbers(robot.gravity_m_s2)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}"/><worldbody>{inner}</worldbody></mujoco>'
    )


def in_mujoco(model: Any, robot: Robot, q: NDArray) -> Any:
    data = mujoco.MjData(model)
    data.qpos[:] = np.where(robot.is_revolute, q, q / 1e3)
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize("payload_kg", [0.0, 3.0])
@pytest.mark.parametrize(
    "robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name
)
def test_chain_and_gravity_torques_agree_with_mujoco(robot: Robot, payload_kg: float) -> None:
    rng = np.random.default_rng(2)
    robot = crooked(robot, rng)
    model = mujoco_model(robot, payload_kg)
    q = random_poses(robot, 12, rng=rng)
    torque, target_mm = gravity_torques(robot, q, np.full(12, payload_kg)), frames(robot, q)[-1][:, :3, 3]
    assert np.abs(torque).max() > 1.0
    for k in range(12):
        data = in_mujoco(model, robot, q[k])
        np.testing.assert_allclose(data.site("target").xpos * 1e3, target_mm[k], atol=1e-9)
        np.testing.assert_allclose(
            torque[k], -data.qfrc_bias, atol=1e-9
        )  # at rest the bias is what holds the arm up


def soft(robot: Robot, scale: float = 1.0) -> Truth:
    truth = Truth.without_effects(robot, np.eye(4))
    compliance = scale * 1e-4 * np.linspace(0.5, 2.0, robot.n_joints) * robot.is_revolute
    return replace(truth, joint_compliance_rad_per_nm=compliance)


@pytest.mark.parametrize("arm", ARMS)
def test_mujoco_joint_springs_are_at_rest_where_the_arm_settles(arm: str) -> None:
    robot = builtin_robot(arm)
    truth = soft(robot, 3.0)
    model = mujoco_model(robot)
    q = random_poses(robot, 6, rng=np.random.default_rng(3))
    settled = settle(truth, q)
    model.jnt_stiffness[:] = 1.0 / truth.joint_compliance_rad_per_nm
    for k in range(len(q)):
        model.qpos_spring[:] = q[k]
        data = in_mujoco(model, robot, settled[k])
        assert np.abs(data.qfrc_bias).max() > 1.0
        np.testing.assert_allclose(data.qfrc_passive, data.qfrc_bias, atol=1e-8)


@pytest.mark.parametrize(
    "robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name
)
def test_equilibrium_law(robot: Robot) -> None:
    """Deflection = compliance x torque at the deflected pose, and that torque is not the one at the commanded pose."""
    truth = soft(robot, 5.0)
    q = random_poses(robot, 10, rng=np.random.default_rng(4))
    payload_kg = np.linspace(0.0, 4.0, 10)
    settled = settle(truth, q, payload_kg)
    compliance = truth.joint_compliance_rad_per_nm
    np.testing.assert_allclose(
        settled - q, compliance * gravity_torques(robot, settled, payload_kg), atol=1e-13
    )
    assert np.abs(settled - q - compliance * gravity_torques(robot, q, payload_kg)).max() > 1e-7


def test_pendulum_hangs_where_a_scalar_equation_says() -> None:
    """A horizontal axis, a mass m at radius r: theta = q - c m g r cos(theta)."""
    c, m, r_mm = 0.05, 2.0, 400.0
    joints = (Joint(a_mm=500.0, mass_kg=m, com_mm=(r_mm - 500.0, 0.0, 0.0)),)
    robot = Robot(name="pendulum", joints=joints, gravity_m_s2=(0.0, -9.81, 0.0))
    truth = replace(Truth.without_effects(robot, np.eye(4)), joint_compliance_rad_per_nm=np.array([c]))
    for q in (-1.0, 0.2, 1.4):
        wanted = brentq(
            lambda theta, q=q: theta - q + c * m * 9.81 * r_mm / 1e3 * np.cos(theta), -5.0, 5.0, xtol=1e-14
        )
        assert settle(truth, np.array([[q]]))[0, 0] == pytest.approx(wanted, abs=1e-12)


def test_arm_without_equilibrium_is_refused() -> None:
    truth = soft(builtin_robot("rb5"), 1e4)
    with pytest.raises(CalibError, match="no equilibrium"):
        settle(truth, random_poses(truth.robot, 4, rng=np.random.default_rng(0)))


def test_transmission_error_is_a_function_of_the_commanded_angle() -> None:
    robot = builtin_robot("rb5")
    cos_rad, sin_rad = np.zeros((6, 2)), np.zeros((6, 2))
    cos_rad[2] = [1e-4, 3e-4]
    sin_rad[4] = [2e-4, 0.0]
    truth = replace(
        Truth.without_effects(robot, np.eye(4)), transmission_cos_rad=cos_rad, transmission_sin_rad=sin_rad
    )
    q = random_poses(robot, 7, rng=np.random.default_rng(5))
    wanted = q.copy()
    wanted[:, 2] += 1e-4 * np.cos(q[:, 2]) + 3e-4 * np.cos(2 * q[:, 2])
    wanted[:, 4] += 2e-4 * np.sin(q[:, 4])
    np.testing.assert_allclose(settle(truth, q), wanted, atol=1e-15)
    assert truth.effects() == ("transmission_error",)


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("scans", [False, True])
def test_without_errors_the_measurement_is_the_nominal_chain(arm: str, scans: bool) -> None:
    simulation = simulate_dataset(
        builtin_robot(arm),
        rng=np.random.default_rng(6),
        poses=12,
        noise_mm=0.0,
        scans=scans,
        tolerances=RIGID,
    )
    dataset, truth = simulation.dataset, simulation.truth
    np.testing.assert_array_equal(settle(truth, dataset.poses.q), dataset.poses.q)
    chain = forward(dataset.robot.table, dataset.poses.q, dataset.robot.is_revolute)
    base_mm = simulation.apex_mm @ truth.base_T_scanner[:3, :3].T + truth.base_T_scanner[:3, 3]
    np.testing.assert_allclose(base_mm, chain.target_mm, atol=1e-9)
    if not scans:
        assert dataset.points is not None
        np.testing.assert_array_equal(dataset.points.xyz_mm, simulation.apex_mm)


@pytest.mark.parametrize("arm", ARMS)
def test_scan_poses_show_three_faces_inside_the_field(arm: str) -> None:
    simulation = simulate_dataset(builtin_robot(arm), rng=np.random.default_rng(7), scans=True)
    q, robot = simulation.dataset.poses.q, simulation.dataset.robot
    for k, joint in enumerate(robot.joints):
        assert joint.min is not None
        assert joint.max is not None
        assert np.all((q[:, k] >= joint.min) & (q[:, k] <= joint.max))
    apex_mm, T = simulation.apex_mm, simulation.scanner_T_jig
    sight = apex_mm / np.linalg.norm(apex_mm, axis=1, keepdims=True)
    normals = np.einsum("nij,kj->nki", T[:, :3, :3], jig_geometry(simulation.dataset.jig)[1])
    incidence_deg = np.degrees(np.arccos(-np.einsum("nki,ni->nk", normals, sight)))
    assert (
        incidence_deg.max() < JANG_FIELD.max_incidence_deg + 1.0
    )  # the true arm is a little off the nominal one
    across_mm = np.abs(apex_mm[:, :2]) * (JANG_FIELD.distance_mm / apex_mm[:, 2:])
    assert np.all(across_mm < 0.5 * JANG_FIELD.width_mm - JANG_FIELD.margin_mm + 10.0)
    assert np.ptp(apex_mm[:, 2]) > 150.0
    assert np.degrees(np.std(q, axis=0)).min() > 10.0
    assert np.linalg.matrix_rank(np.cos(q) - np.cos(q).mean(axis=0)) == robot.n_joints
    role = simulation.dataset.poses.role
    assert [int(np.sum(role == r)) for r in ("reference", "train", "test")] == [1, 50, 13]
    assert role[0] == "reference"


def test_poses_spread_farther_than_the_first_ones() -> None:
    q = random_poses(builtin_robot("rb5"), 200, rng=np.random.default_rng(8))

    def closest(rows: NDArray) -> float:
        circles = np.concatenate([np.cos(rows), np.sin(rows)], axis=1)
        gaps = np.linalg.norm(circles[:, None] - circles[None], axis=2)
        return float(gaps[~np.eye(len(rows), dtype=bool)].min())

    chosen = spread_poses(q, 30)
    assert len(set(chosen)) == 30
    assert closest(q[chosen]) > 1.5 * closest(q[:30])


def test_wanted_apexes_are_reached() -> None:
    robot = builtin_robot("rb5")
    rng = np.random.default_rng(9)
    base_T_scanner = place_scanner(robot, rng=rng)
    wanted_mm = np.array([[-73.7, 42.9, 661.4], [134.8, -16.4, 748.8]])
    q = reach_apexes(robot, base_T_scanner, wanted_mm, rng=rng)
    at_mm = scanner_T_target(Truth.without_effects(robot, base_T_scanner), q)[:, :3, 3]
    np.testing.assert_allclose(at_mm, wanted_mm, atol=1.0)
    with pytest.raises(CalibError, match="cannot hold the jig"):
        reach_apexes(robot, base_T_scanner, [[0.0, 0.0, 4000.0]], rng=rng)


@pytest.mark.parametrize("arm", ARMS)
def test_drawn_compliance_sags_visibly(arm: str) -> None:
    simulation = simulate_dataset(
        builtin_robot(arm), rng=np.random.default_rng(10), effects=("joint_compliance",)
    )
    truth, q = simulation.truth, simulation.dataset.poses.q
    rigid = replace(truth, joint_compliance_rad_per_nm=np.zeros(truth.robot.n_joints))
    sag_mm = np.linalg.norm(simulation.apex_mm - scanner_T_target(rigid, q)[:, :3, 3], axis=1)
    assert 0.15 < np.sqrt(np.mean(sag_mm**2)) < 0.6
    assert np.all(truth.joint_compliance_rad_per_nm < 2e-4)
    down_mm = (simulation.apex_mm - scanner_T_target(rigid, q)[:, :3, 3]) @ truth.base_T_scanner[:3, :3].T
    assert np.mean(down_mm[:, 2] < 0) > 0.9


def test_payload_makes_the_arm_sag_more() -> None:
    robot = builtin_robot("rb5")
    q = random_poses(robot, 30, rng=np.random.default_rng(11))
    truth = soft(robot, 0.3)
    drop_mm = [frames(robot, settle(truth, q, np.full(30, kg)))[-1][:, 2, 3].mean() for kg in (0.0, 5.0)]
    assert drop_mm[1] < drop_mm[0] - 0.05


def test_noise_and_repeats_are_as_asked() -> None:
    simulation = simulate_dataset(
        builtin_robot("rb5"),
        rng=np.random.default_rng(12),
        poses=100,
        noise_mm=0.07,
        repeats=4,
        payloads_kg=(0.0, 2.5),
    )
    points = simulation.dataset.points
    assert points is not None
    assert len(points) == 400
    error_mm = points.xyz_mm - simulation.apex_mm[points.pose]
    assert error_mm.std() == pytest.approx(0.07, rel=0.1)
    assert abs(error_mm.mean()) < 4 * 0.07 / np.sqrt(1200)
    assert set(simulation.dataset.poses.payload_kg) == {0.0, 2.5}


def test_seed_makes_the_dataset() -> None:
    def once(seed: int) -> NDArray:
        return simulate_dataset(
            builtin_robot("panda"),
            rng=np.random.default_rng(seed),
            poses=5,
            scans=True,
            effects=SIMULATED_EFFECTS,
        ).apex_mm

    np.testing.assert_array_equal(once(1), once(1))
    assert np.all(np.abs(once(1) - once(2)).max(axis=1) > 1.0)


def test_written_simulation_comes_back_with_its_truth(tmp_path: Path) -> None:
    simulation = simulate_dataset(
        builtin_robot("panda"), rng=np.random.default_rng(13), poses=3, scans=True, effects=SIMULATED_EFFECTS
    )
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
    assert document["effects"]["joint_compliance"]["c_rad_per_nm"] == list(
        simulation.truth.joint_compliance_rad_per_nm
    )
    assert set(document["effects"]) == set(SIMULATED_EFFECTS)
    rows = [*(f"J{j + 1}" for j in range(7)), "TCP"]
    lengths = np.array([[document["links"][row][key] for key in ("a_mm", "d_mm")] for row in rows])
    np.testing.assert_allclose(lengths, simulation.truth.robot.table[:, [0, 2]], atol=1e-12)
    error_deg = np.array([document["link_errors"][row]["alpha_deg"] for row in rows])
    nominal_deg = np.degrees(dataset.robot.table[:, 1])
    np.testing.assert_allclose(
        error_deg, [document["links"][row]["alpha_deg"] for row in rows] - nominal_deg, atol=1e-10
    )
    assert document["apex_mm"]["p02"] == simulation.apex_mm[1].tolist()


def test_jig_needs_a_tool_row_that_reaches_it() -> None:
    panda, rb5 = (
        simulate_dataset(builtin_robot(arm), rng=np.random.default_rng(0), poses=2, scans=True).dataset.robot
        for arm in ("panda", "rb5")
    )
    assert panda.tool.d_mm == 88.0  # the built-in one ends at the flange
    assert rb5.tool.d_mm == -88.0


def test_bad_wishes_are_one_clear_line() -> None:
    rng, robot = np.random.default_rng(0), builtin_robot("rb5")
    with pytest.raises(CalibError, match=r"'warp'; there are joint_compliance, transmission_error"):
        simulate_dataset(robot, rng=rng, effects=("warp",))
    with pytest.raises(CalibError, match="found 1 poses"):
        simulate_dataset(robot, rng=rng, poses=1)
    with pytest.raises(CalibError, match="noise_mm"):
        simulate_dataset(robot, rng=rng, noise_mm=-0.1)
    bare = replace(robot, joints=tuple(replace(joint, mass_kg=None) for joint in robot.joints))
    with pytest.raises(CalibError, match=r"no mass_kg for J1, J2"):
        simulate_dataset(bare, rng=rng, effects=("joint_compliance",))
    with pytest.raises(CalibError, match="simulated as points"):
        simulate_dataset(robot, rng=rng, poses=3).scan(0)


def test_joint_limits_leave_no_room_for_poses_at_zero_range() -> None:
    robot = builtin_robot("panda")  # joint 4 turns from -176 to -4 degrees
    with pytest.raises(CalibError, match="joint J4 has no room"):
        random_poses(robot, 3, rng=np.random.default_rng(0), range_deg=2.0)


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
