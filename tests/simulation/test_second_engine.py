"""The second simulator, `tests/support/engine`: it shares no code with calib's own, and does what it says."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.effects.gravity import GravityLoads
from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot
from tests.support.engine import cases, cell
from tests.support.engine.arms import FIXED, random_six
from tests.support.engine.cases import Case, simulate
from tests.support.engine.cell import draw_cell
from tests.support.engine.classes import cases as standard_cases
from tests.support.engine.joint_causes import axis_wobble
from tests.support.engine.load_causes import bent_rod
from tests.support.engine.noise import KINDS, draw_noise
from tests.support.sweeps import sweep

ARMS = {arm.name: arm for arm in (*FIXED, random_six(np.random.default_rng(5)))}
VALUES = {"calib.dataset.dataset", "calib.kinematics.robot"}  # what a dataset is written with


def nominal(name: str, rng: np.random.Generator) -> tuple[cell.Cell, Robot]:
    """An arm as its table says, without errors, and the robot that its dataset has."""
    drawn = draw_cell(ARMS[name], rng, poses=12)
    exact = replace(drawn, rows=np.array(drawn.arm.rows))
    return exact, cases.robot_of(exact)


def test_it_imports_values_alone() -> None:
    folder = Path(cases.__file__).parent
    imported = {
        node.module or ""
        for path in folder.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
    }
    assert {name for name in imported if name.startswith(("calib", "inspector"))} == VALUES


@pytest.mark.parametrize("name", ARMS)
def test_its_arms_stand_where_the_chain_says(name: str) -> None:
    exact, robot = nominal(name, np.random.default_rng(1))
    chain = forward(robot.table, exact.q, robot.is_revolute)
    np.testing.assert_allclose(exact.plain.point, chain.target_mm, atol=1e-9)


@pytest.mark.parametrize("name", ["UR5e", "gantry", "SCARA"])
def test_its_torques_are_those_of_the_masses(name: str) -> None:
    exact, robot = nominal(name, np.random.default_rng(2))
    loads = GravityLoads(robot, forward(robot.table, exact.q, robot.is_revolute), exact.payload_kg)
    torques = np.column_stack([exact.plain.load(j, exact.arm.slides[j]) for j in range(exact.arm.n)])
    np.testing.assert_allclose(torques, loads.joint_torques, atol=1e-9)


def test_its_rods_bend_as_cantilevers_do() -> None:
    exact, robot = nominal("UR5e", np.random.default_rng(3))
    loads = GravityLoads(robot, forward(robot.table, exact.q, robot.is_revolute), exact.payload_kg)
    turn, shift_mm = bent_rod(exact, exact.plain, 1)
    in_base = np.einsum("nij,nj->ni", exact.plain.end[1][:, :3, :3], shift_mm)
    np.testing.assert_allclose(turn, loads.bending(1)[0], rtol=0.02, atol=0.02 * np.abs(turn).max())
    np.testing.assert_allclose(in_base, loads.bending(1)[1], rtol=0.02, atol=0.02 * np.abs(in_base).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", sweep(cases.CAUSES, every_run=list(cases.CAUSES)[::4]))
def test_a_cause_is_as_visible_as_was_asked(name: str) -> None:
    simulated = simulate(Case("size", (name,), 0, sigmas=(4.0,)))
    sigma_mm = simulated.dataset.scanner.point_sigma_mm
    assert simulated.cell.visible_mm(simulated.causes) == pytest.approx(4.0 * (sigma_mm or 0.0), rel=0.1)


def test_without_a_cause_the_true_geometry_leaves_white_noise() -> None:
    simulated = simulate(Case("null", (), 3, poses=300))
    found = calibrate(simulated.dataset)
    assert found.sigma_mm == pytest.approx(simulated.dataset.scanner.point_sigma_mm, rel=0.08)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_has_the_size_that_is_declared(kind: str) -> None:
    rng = np.random.default_rng(4)
    seen = rng.uniform(-500.0, 500.0, (20_000, 3)) + np.array([0.0, 0.0, 2000.0])
    noise = draw_noise(kind, seen, np.arange(len(seen)), 0.05, rng)
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(0.05, rel=0.15)
    along, across = noise[:, 2].std(), noise[:, :2].std()
    assert along / across == pytest.approx(3.0 if kind == "deep" else 1.0, rel=0.15)


@pytest.mark.slow
def test_the_same_case_gives_the_same_dataset() -> None:
    case = standard_cases(only=("new",))[0]
    one, other = simulate(case).dataset.points, simulate(case).dataset.points
    np.testing.assert_array_equal(one.xyz_mm, other.xyz_mm)


def test_the_twins_are_twins() -> None:
    """The last joint's axis leaning in a circle twice a turn moves the tool as its angle's error once a turn does."""
    drawn = draw_cell(ARMS["UR5e"], np.random.default_rng(6))
    wobble = axis_wobble(drawn, np.random.default_rng(7), joint=5, order=2)
    moved = drawn.reported([(wobble, 1.0)])["jig"] - drawn.seen(drawn.plain.point)
    waves = []
    for wave in (np.cos, np.sin):
        turned = replace(drawn, q=drawn.q + 1e-5 * np.outer(wave(drawn.q[:, 5]), np.eye(6)[5]))
        waves.append((turned.seen(turned.plain.point) - drawn.seen(drawn.plain.point)).ravel())
    columns = np.column_stack([drawn.geometry, *waves])
    left = moved.ravel() - columns @ np.linalg.lstsq(columns, moved.ravel(), rcond=None)[0]
    assert np.linalg.norm(left) < 0.01 * drawn.visible_mm([(wobble, 1.0)]) * np.sqrt(len(left))
