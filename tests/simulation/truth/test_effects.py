"""Every simulated effect: nothing at size zero, the law it claims, and the visible size that was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import catalogue_names
from calib.errors import CalibError
from calib.kinematics.chain import target_jacobian
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Joint, Robot, Tool
from calib.simulation.pose_design import draw_scanner_pose, draw_setups
from calib.simulation.simulate import draw_conditions
from calib.simulation.truth.arm_sampling import OUTSIDE_EFFECTS, SIMULATED, SIMULATED_EFFECTS, draw_truth
from calib.simulation.truth.equilibrium import Truth, base_T_target, scanner_T_target, solve_equilibrium
from calib.simulation.truth.joint_effects import (
    AsymmetricScale,
    AxisWobble,
    Backlash,
    CableDrag,
    HighHarmonic,
    JointCoupling,
    JointDent,
    JointScale,
    StrainWave,
    ThermalGrowth,
)
from calib.simulation.truth.load_effects import (
    BaseCompliance,
    GravityBacklash,
    HosePull,
    LinkBending,
    ToolSag,
)
from calib.simulation.truth.mechanism import Arm, Conditions, TrueEffect
from calib.simulation.truth.order_effects import (
    BaseLoosening,
    FollowingError,
    JointStep,
    ScannerStep,
    TargetStep,
    WarmUp,
)
from calib.simulation.truth.sampling import SimulatedCell
from calib.simulation.truth.scanner_effects import (
    FieldBump,
    IncidenceBias,
    ScannerDistortion,
    ScannerDrift,
    ScannerScale,
)

ALL = (*SIMULATED_EFFECTS, *OUTSIDE_EFFECTS)


def cell_of(arm: str, seed: int = 0, poses: int = 40, setups: int = 1) -> SimulatedCell:
    """An arm with link errors, poses and conditions."""
    rng, robot = np.random.default_rng(seed), builtin_robot(arm)
    q = random_poses(robot, poses, rng=rng)
    around = draw_conditions(robot, poses, rng=rng)
    scanners = {"": draw_scanner_pose(robot, rng=rng)}
    if setups > 1:
        scanners = draw_setups(scanners[""], setups, rng=rng)
        around = replace(around, setup=np.resize(list(scanners), poses))
    truth = draw_truth(robot, scanners, q, rng=rng, conditions=around)
    return SimulatedCell(robot, truth, q, around)


def drawn(name: str, cell: SimulatedCell) -> TrueEffect:
    return SIMULATED[name].draw(cell, np.random.default_rng(1))


@pytest.fixture(scope="module")
def rb5() -> SimulatedCell:
    return cell_of("rb5")


def stands(cell: SimulatedCell, effect: TrueEffect) -> NDArray:
    """(N, n) where the joints stand, less the command."""
    return solve_equilibrium(cell.truth.with_effects(effect), cell.q, cell.conditions).q - cell.q


# ---- all of them ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ALL)
def test_size_zero_is_no_effect_bit_for_bit(name: str, rb5: SimulatedCell) -> None:
    effect = drawn(name, rb5)
    assert effect.name == name
    assert not effect.is_absent
    nothing = effect.scaled(0.0)
    assert nothing.is_absent
    rigid = Arm.commanded_to(rb5.truth.robot, rb5.q, rb5.conditions)
    moved = nothing.change_arm(rigid, rigid)
    for before, after in zip(rigid.base_T_frame, moved.base_T_frame, strict=True):
        np.testing.assert_array_equal(after, before)
    seen = scanner_T_target(rb5.truth, rb5.q, rb5.conditions)
    np.testing.assert_array_equal(nothing.change_measurement(seen, rb5.conditions, -1.0), seen)
    np.testing.assert_array_equal(rb5.moved_mm(nothing), 0.0)
    assert rb5.truth.with_effects(nothing).effect_names == ()
    assert rb5.truth.with_effects(effect).effect_names == (name,)


@pytest.mark.parametrize("name", ALL)
def test_a_small_effect_is_proportional_to_its_size(name: str, rb5: SimulatedCell) -> None:
    small = rb5.scaled_to_moved(drawn(name, rb5), 0.05)
    assert rb5.moved_rms_mm(small) == pytest.approx(0.05, rel=1e-8)
    double = rb5.moved_mm(small.scaled(2.0))
    assert np.linalg.norm(double - 2.0 * rb5.moved_mm(small)) < 0.02 * np.linalg.norm(double)


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "setups"), [("rb5", 1), ("panda", 3)])
def test_visible_rms_is_what_independent_least_squares_leave(arm: str, setups: int) -> None:
    """Against the analytic Jacobian of calib.kinematics.chain, in the base frame."""
    cell = cell_of(arm, seed=3, setups=setups)
    jacobian = target_jacobian(cell.nominal, cell.q)  # (N, 3, P)
    at_mm = base_T_target(Truth(cell.nominal, cell.truth.scanners), cell.q)[:, :3, 3]
    setup = np.full(len(cell.q), "") if cell.conditions.setup is None else cell.conditions.setup
    columns = [jacobian.reshape(-1, jacobian.shape[2])]
    for name in cell.truth.scanners:
        here = (setup == name)[:, None, None]
        columns.append((here * np.eye(3)).reshape(-1, 3))
        columns.append((here * np.cross(np.eye(3)[None], at_mm[:, None])).swapaxes(1, 2).reshape(-1, 3))
    columns = np.concatenate(columns, axis=1)
    columns /= np.where((size := np.linalg.norm(columns, axis=0)) > 1e-6, size, np.inf)
    base_R_scanner = np.stack([cell.truth.scanners[name][:3, :3] for name in setup])
    for name in (
        "joint_compliance",
        "backlash",
        "axis_wobble",
        "tool_sag",
        "joint_step",
        "scanner_distortion",
    ):
        effect = cell.scaled_to_visible(drawn(name, cell), 0.123)
        moved = np.einsum("nij,nj->ni", base_R_scanner, cell.moved_mm(effect)).ravel()
        left = moved - columns @ np.linalg.lstsq(columns, moved, rcond=1e-9)[0]
        assert np.sqrt(np.mean(left**2)) == pytest.approx(0.123, rel=1e-5), name


def test_what_geometry_imitates_has_no_visible_size(rb5: SimulatedCell) -> None:
    effect = drawn("scanner_scale", rb5)
    assert rb5.moved_rms_mm(effect) > 0.1
    assert rb5.visible_rms_mm(effect) < 1e-6
    with pytest.raises(CalibError, match="scanner_scale: a geometric fit can imitate all of it"):
        rb5.scaled_to_visible(effect, 0.05)


# ---- joints ---------------------------------------------------------------------------------------------------------


def test_joint_laws(rb5: SimulatedCell) -> None:
    q, n = rb5.q, rb5.nominal.n_joints
    assert rb5.conditions.approach is not None
    size = 1e-4 * np.arange(1.0, n + 1)
    ratio = np.full(n, 101.0)
    coupling = np.zeros((n, n))
    coupling[4, 3] = 2e-4
    two = np.column_stack([size, 2 * size])
    pulled = np.append(size[:-1], 0.0)
    after = (np.arange(len(q)) >= 7)[:, None]
    near = np.remainder(q - 3.0 + np.pi, 2 * np.pi) - np.pi  # a bump at 3 rad reaches over to -pi
    laws = [
        (StrainWave(two, 0 * two, ratio), size * np.cos(101 * q) + 2 * size * np.cos(202 * q)),
        (StrainWave(0 * two, two, ratio), size * np.sin(101 * q) + 2 * size * np.sin(202 * q)),
        (HighHarmonic(size[:, None], 0 * size[:, None]), size * np.cos(5 * q)),
        (AsymmetricScale(size), size * np.abs(q)),
        (CableDrag(pulled, 0.4, -1.0, 2), pulled * np.cos(2 * (q - np.roll(q, -1, axis=1)) - 0.4)),
        (FollowingError(size), size * np.vstack([np.zeros(n), q[1:] - q[:-1]])),
        (JointScale(size), size * q),
        (JointCoupling(coupling), np.outer(q[:, 3], 2e-4 * np.eye(n)[4])),
        (Backlash(size), 0.5 * size * rb5.conditions.approach),
        (JointStep(size, 7), after * size),
        (JointDent(size, np.full(n, 3.0), 0.3), size * np.exp(-0.5 * (near / 0.3) ** 2)),
    ]
    for effect, wanted in laws:
        assert np.abs(wanted).max() > 1e-5
        np.testing.assert_allclose(stands(rb5, effect), wanted, atol=1e-14, err_msg=effect.name)


def test_gravity_backlash_lies_at_the_loaded_side(rb5: SimulatedCell) -> None:
    effect = GravityBacklash(np.full(6, 2e-4))
    truth = rb5.truth.with_effects(effect)
    arm = solve_equilibrium(truth, rb5.q, rb5.conditions)
    loaded = np.abs(arm.gravity_torques) > effect.friction_nm
    assert 0.5 < loaded.mean() < 1.0
    wanted = 1e-4 * np.sign(arm.gravity_torques)
    np.testing.assert_allclose((arm.q - rb5.q)[loaded], wanted[loaded], atol=1e-15)
    assert np.all(np.abs(arm.q - rb5.q) <= 1e-4 + 1e-15)


def test_missing_conditions_and_masses_are_said(rb5: SimulatedCell) -> None:
    for effect, what in (
        (Backlash(np.ones(6)), "approach"),
        (ThermalGrowth(1e-5), "temperature"),
        (ScannerDrift(np.ones(3), np.zeros(3)), "time"),
    ):
        with pytest.raises(CalibError, match=f"{effect.name} needs .*{what}"):
            scanner_T_target(rb5.truth.with_effects(effect), rb5.q)
    robot = builtin_robot("rb5")
    bare = replace(robot, joints=tuple(replace(j, mass_kg=None, gear_ratio=None) for j in robot.joints))
    for name, what in (("link_bending", "mass_kg for J1"), ("strain_wave", "gear_ratio for J1")):
        with pytest.raises(CalibError, match=what):
            drawn(name, SimulatedCell(bare, Truth.without_effects(bare, np.eye(4)), rb5.q, rb5.conditions))


def test_a_sliding_joint_has_no_gear_and_carries_no_turn() -> None:
    joints = tuple(
        Joint(a_mm=200.0, alpha_rad=0.5, d_mm=50.0, type=kind, min=-2.0, max=2.0, gear_ratio=ratio, mass_kg=1.0)
        for kind, ratio in (("revolute", 80.0), ("prismatic", None), ("revolute", 120.0))
    )
    robot = Robot("slide", joints, Tool(a_mm=40.0))
    rng = np.random.default_rng(0)
    cell = SimulatedCell(robot, Truth.without_effects(robot, np.eye(4)), random_poses(robot, 20, rng=rng))
    for name in ("strain_wave", "transmission_error", "joint_compliance", "joint_dent", "joint_step"):
        turned = stands(cell, drawn(name, cell))
        assert np.any(turned)
        assert not np.any(turned[:, 1]), name


def test_changes_are_there_from_their_pose_on(rb5: SimulatedCell) -> None:
    """Against the same effect at all poses, or a rigid motion worked out by hand."""
    after, plain = np.arange(len(rb5.q)) >= 9, rb5.plain_mm
    c = np.array([3e-6, 1e-6, 0.0])
    loose, soft = BaseLoosening(c, 9), BaseCompliance(c)
    np.testing.assert_allclose(rb5.moved_mm(loose), after[:, None] * rb5.moved_mm(soft), atol=1e-9)
    shift, turn, middle = np.array([0.3, -0.1, 0.2]), np.array([1e-4, 2e-4, -3e-4]), plain.mean(axis=0)
    knocked = rb5.moved_mm(ScannerStep(shift, turn, middle, 9))
    np.testing.assert_allclose(knocked, after[:, None] * (shift + np.cross(turn, plain - middle)), atol=2e-4)
    slid = rb5.moved_mm(TargetStep(shift, 9))
    np.testing.assert_allclose(np.linalg.norm(slid, axis=1), after * np.linalg.norm(shift), atol=1e-9)
    time_s = rb5.conditions.time_s
    warm, now = WarmUp(2e-4, 900.0), 2e-4 * (1.0 - np.exp(-(time_s - time_s[0]) / 900.0))
    told = replace(rb5.conditions, temperature_c=20.0 + now / 2e-5)
    cell = replace(rb5, conditions=told)
    np.testing.assert_allclose(rb5.moved_mm(warm), cell.moved_mm(ThermalGrowth(2e-5)), atol=1e-9)


# ---- loads ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["rb5", "panda"])
def test_load_and_deflection_agree_at_rest(arm: str) -> None:
    """All that gives way, together: one more look at the loads changes nothing."""
    cell = cell_of(arm, seed=5)
    effects = [
        cell.scaled_to_moved(drawn(name, cell), 1.0)
        for name in ("joint_compliance", "link_bending", "base_compliance", "tool_sag", "hose_pull")
    ]
    equilibrium = solve_equilibrium(cell.truth.with_effects(*effects), cell.q, cell.conditions)
    once_more = Arm.commanded_to(cell.truth.robot, cell.q, cell.conditions)
    for effect in effects:
        once_more = effect.change_arm(once_more, equilibrium)
    for part in ("q", "base_turn_rad", "link_turn_rad", "link_shift_mm", "target_shift_mm"):
        assert np.abs(getattr(equilibrium, part) - (cell.q if part == "q" else 0.0)).max() > 1e-7
        np.testing.assert_allclose(getattr(once_more, part), getattr(equilibrium, part), atol=2e-12)


@pytest.mark.parametrize("arm", ["rb5", "panda"])
def test_torques_are_slopes_of_the_potential_energy(arm: str) -> None:
    """Gravity's torque and the hose's, payload included: tau_j = - dV / dq_j by central differences."""
    cell = cell_of(arm, seed=6, poses=8)
    robot, n, gravity = cell.nominal, cell.nominal.n_joints, np.array(cell.nominal.gravity_m_s2)
    rng = np.random.default_rng(0)
    hose = HosePull(0.2, 100.0, np.array([-400.0, 200.0, 900.0]), rng.uniform(-80, 80, 3), 2, np.full(n, 1e-12))

    def energies(q: NDArray) -> NDArray:
        """(2, N) J: of all weights, of the stretched hose."""
        at = Arm.commanded_to(robot, q, cell.conditions)
        falls = [-np.sum(w.weight_n * 1e-3 * w.place_mm, axis=1) for w in at.weights]
        stretch_mm = np.linalg.norm(hose.anchor_mm - at.place_mm(2, hose.held_mm), axis=1) - 100.0
        return np.array([sum(falls), 0.5 * 0.2 * np.maximum(stretch_mm, 0) ** 2 * 1e-3])

    at = Arm.commanded_to(robot, cell.q, cell.conditions)
    total_kg = sum(joint.mass_kg or 0.0 for joint in robot.joints) + (robot.tool.mass_kg or 0.0)
    carried = sum(np.linalg.norm(w.weight_n, axis=1) for w in at.weights) / np.linalg.norm(gravity)
    np.testing.assert_allclose(carried, total_kg + cell.conditions.payload_kg)
    hose_torque = (hose.change_arm(at, at).q - cell.q) / 1e-12
    for j in range(n):
        step = 1e-5 * np.eye(n)[j]
        slope = (energies(cell.q + step) - energies(cell.q - step)) / 2e-5
        np.testing.assert_allclose(at.gravity_torques[:, j], -slope[0], atol=1e-6)
        np.testing.assert_allclose(hose_torque[:, j], -slope[1], atol=5e-3)
    assert np.abs(hose_torque[:, :3]).max() > 5.0


@pytest.mark.parametrize(("beam_kg", "tip_kg"), [(0.0, 2.0), (3.0, 0.0), (3.0, 2.0)])
def test_link_bends_as_a_cantilever_does(beam_kg: float, tip_kg: float) -> None:
    """Tip load: slope F L^2 / 2EI, sag F L^3 / 3EI. Own weight: W L^2 / 6EI and W L^3 / 8EI. c = L / EI."""
    length_m, c = 0.5, 2e-6
    robot = Robot("beam", (Joint(a_mm=500.0, mass_kg=beam_kg, com_mm=(-250.0, 0, 0)),), Tool(mass_kg=tip_kg or None))
    robot = replace(robot, gravity_m_s2=(0.0, -9.81, 0.0))
    truth = Truth.without_effects(robot, np.eye(4)).with_effects(LinkBending(np.array([c])))
    flange = solve_equilibrium(truth, [[0.0]]).base_T_frame[1][0]
    force_n, own_n = 9.81 * tip_kg, 9.81 * beam_kg
    slope = c * (force_n * length_m / 2 + own_n * length_m / 6)
    sag_mm = 1e3 * c * (force_n * length_m**2 / 3 + own_n * length_m**2 / 8)
    assert np.arctan2(-flange[1, 0], flange[0, 0]) == pytest.approx(slope, rel=1e-4)
    assert -flange[1, 3] == pytest.approx(sag_mm, rel=1e-4)
    np.testing.assert_allclose(flange[:3, :3] @ flange[:3, :3].T, np.eye(3), atol=1e-15)


def test_end_moment_bends_a_link_into_a_circle_and_torsion_does_nothing() -> None:
    """A mass beside the end, gravity along the link: moment M alone, slope c M, shift c M L / 2."""
    joints = (Joint(a_mm=500.0, mass_kg=0.0),)
    tool = Tool(mass_kg=2.0, com_mm=(0.0, 100.0, 0.0))
    moment_nm = 2.0 * 9.81 * 0.1
    for gravity, slope in (((-9.81, 0.0, 0.0), 2e-6 * moment_nm), ((0.0, 0.0, -9.81), None)):
        robot = Robot("mast", joints, tool, gravity_m_s2=gravity)
        truth = Truth.without_effects(robot, np.eye(4)).with_effects(LinkBending(np.array([2e-6])))
        flange = solve_equilibrium(truth, [[0.0]]).base_T_frame[1][0]
        if slope is None:  # torsion along the link is left out, the weight's own bending stays
            assert flange[2, 1] == pytest.approx(0.0, abs=1e-12)
            assert flange[2, 3] < -1e-4
        else:
            assert np.arctan2(flange[1, 0], flange[0, 0]) == pytest.approx(
                slope, rel=1e-4
            )  # the weight moves a little, too
            assert flange[1, 3] == pytest.approx(slope * 250.0, rel=1e-4)


def test_base_turns_under_the_overturning_moment(rb5: SimulatedCell) -> None:
    c = np.array([3e-6, 1e-6, 0.0])
    arm = solve_equilibrium(rb5.truth.with_effects(BaseCompliance(c)), rb5.q, rb5.conditions)
    moment = sum(np.cross(1e-3 * w.place_mm, w.weight_n) for w in arm.weights)
    np.testing.assert_allclose(arm.base_turn_rad, c * moment, atol=1e-15)
    assert np.abs(arm.base_turn_rad).max() > 5e-5
    np.testing.assert_allclose(arm.base_T_frame[0][:, :3, 3], 0.0)


def test_tool_sags_straight_down_where_its_springs_are_alike(rb5: SimulatedCell) -> None:
    def shift(c_mm: tuple[float, float, float]) -> NDArray:
        bent = base_T_target(rb5.truth.with_effects(ToolSag(np.array(c_mm))), rb5.q)
        return bent[:, :3, 3] - base_T_target(rb5.truth, rb5.q)[:, :3, 3]

    np.testing.assert_allclose(shift((0.3, 0.3, 0.3)), np.tile([0.0, 0.0, -0.3], (len(rb5.q), 1)), atol=1e-12)
    z = base_T_target(rb5.truth, rb5.q)[:, :3, 2]
    np.testing.assert_allclose(shift((0.0, 0.0, 0.3)), -0.3 * z[:, 2:] * z, atol=1e-12)


def test_joints_that_do_not_yield_feel_no_hose(rb5: SimulatedCell) -> None:
    hose = drawn("hose_pull", rb5)
    assert isinstance(hose, HosePull)
    assert np.any(stands(rb5, hose))
    assert not np.any(stands(rb5, replace(hose, c_rad_per_nm=np.zeros(6))))
    assert not np.any(stands(rb5, replace(hose, rest_length_mm=1e5)))  # it hangs loose


# ---- links and axes -------------------------------------------------------------------------------------------------


def test_axis_tilts_at_the_joints_own_origin(rb5: SimulatedCell) -> None:
    for joint in range(6):
        cos_rad, sin_rad = np.zeros((2, 6, 2, 2))
        cos_rad[joint] = [[3e-3, 0.0], [0.0, 1e-3]]
        sin_rad[joint] = [[0.0, 2e-3], [0.0, 0.0]]
        arm = solve_equilibrium(rb5.truth.with_effects(AxisWobble(cos_rad, sin_rad)), rb5.q)
        plain = solve_equilibrium(rb5.truth, rb5.q)
        q = rb5.q[:, joint]
        tilt = np.hypot(3e-3 * np.cos(q) + 2e-3 * np.sin(2 * q), 1e-3 * np.cos(2 * q))
        here, there = arm.base_T_axis[joint], plain.base_T_axis[joint]
        np.testing.assert_allclose(here[:, :3, 3], there[:, :3, 3], atol=1e-10)
        angle = np.linalg.norm(np.cross(here[:, :3, 2], there[:, :3, 2]), axis=1)
        np.testing.assert_allclose(angle, np.sin(tilt), atol=1e-12)
        np.testing.assert_allclose(arm.base_T_frame[joint], plain.base_T_frame[joint], atol=1e-12)


def test_warm_arm_is_the_arm_with_longer_links(rb5: SimulatedCell) -> None:
    effect = ThermalGrowth(2e-5)
    warm = Conditions(temperature_c=np.full(len(rb5.q), 30.0))
    robot = rb5.truth.robot
    longer = robot.with_table(robot.table * np.array([1.0002, 1.0, 1.0002, 1.0, 1.0]))
    np.testing.assert_allclose(
        base_T_target(rb5.truth.with_effects(effect), rb5.q, warm),
        base_T_target(Truth.without_effects(longer, np.eye(4)), rb5.q),
        atol=1e-10,
    )
    cold = Conditions(temperature_c=np.full(len(rb5.q), 20.0))
    np.testing.assert_array_equal(
        base_T_target(rb5.truth.with_effects(effect), rb5.q, cold), base_T_target(rb5.truth, rb5.q)
    )


# ---- scanner --------------------------------------------------------------------------------------------------------


def test_scanner_laws(rb5: SimulatedCell) -> None:
    plain = scanner_T_target(rb5.truth, rb5.q, rb5.conditions)
    p, count = plain[:, :3, 3], len(rb5.q)
    middle = np.array([10.0, -20.0, 700.0])
    x, y, z = (p - middle).T
    shift = np.array([0.1, -0.2, 0.3])
    near = np.exp(-0.5 * np.sum((p - p[3]) ** 2, axis=1) / 150.0**2)[:, None]
    ray = p / np.linalg.norm(p, axis=1)[:, None]
    cos_phi = np.sum(plain[:, :3, 2] * ray, axis=1)[:, None]  # d_mm < 0: the jig points to -z, the ray comes along z
    radial = 1e-10 * (x**2 + y**2)
    laws = [
        (ScannerScale(3e-4), 3e-4 * p),
        (ScannerDistortion(2e-4, 0.0, 0.0, middle), np.outer(2e-4 * z, [0, 0, 1])),
        (ScannerDistortion(0.0, 2e-7, 0.0, middle), np.outer(2e-7 * z**2, [0, 0, 1])),
        (
            ScannerDistortion(0.0, 0.0, 1e-10, middle),
            np.column_stack([radial * x, radial * y, np.zeros(count)]),
        ),
        (FieldBump(shift, p[3], 150.0), near * shift),
        (IncidenceBias(0.4), 0.4 * (1.0 - cos_phi) * ray),
    ]
    for effect, wanted in laws:
        np.testing.assert_allclose(rb5.moved_mm(effect), wanted, atol=1e-11, err_msg=effect.name)
    np.testing.assert_allclose(rb5.moved_mm(FieldBump(shift, p[3], 150.0))[3], shift, atol=1e-12)


def test_error_of_a_tool_without_length_does_not_turn_the_jig_round() -> None:
    cell = cell_of("panda")
    for d_mm in (0.4, -0.4):
        robot = replace(cell.nominal, tool=replace(cell.nominal.tool, d_mm=d_mm))
        truth = Truth.without_effects(robot, cell.truth.base_T_scanner)
        seen = scanner_T_target(truth, cell.q)
        p = seen[:, :3, 3]
        ray = p / np.linalg.norm(p, axis=1)[:, None]
        wanted = 0.4 * (1.0 + np.sum(seen[:, :3, 2] * ray, axis=1)[:, None]) * ray
        moved = scanner_T_target(truth.with_effects(IncidenceBias(0.4)), cell.q)[:, :3, 3] - p
        np.testing.assert_allclose(moved, wanted, atol=1e-11)


def test_drifting_scanner_moves_as_a_rigid_body(rb5: SimulatedCell) -> None:
    v, w = (
        np.array([1e-4, -2e-4, 0.0]),
        np.array([0.0, 1e-3, 2e-3]),
    )  # far too fast: no small-angle formula would do
    seen = scanner_T_target(rb5.truth.with_effects(ScannerDrift(v, w)), rb5.q, rb5.conditions)
    plain = scanner_T_target(rb5.truth, rb5.q, rb5.conditions)
    assert rb5.conditions.time_s is not None
    t = rb5.conditions.time_s
    motion = seen @ np.linalg.inv(plain)
    angle = np.arccos(np.clip((np.trace(motion[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    turned = np.remainder(np.linalg.norm(w) * t, 2 * np.pi)
    np.testing.assert_allclose(angle, np.minimum(turned, 2 * np.pi - turned), atol=1e-6)
    np.testing.assert_allclose(motion[:, :3, 3], t[:, None] * v, atol=1e-9)
    np.testing.assert_allclose(motion[0], np.eye(4), atol=1e-12)


def test_every_family_can_be_simulated_and_names_are_unique() -> None:
    assert sorted(catalogue_names()) == list(SIMULATED_EFFECTS)
    assert len(set(ALL)) == len(ALL)
