"""The simulator `tests/support/third_engine` agrees with itself and with the chain."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.kinematics.chain import forward
from tests.support.sweeps import sweep
from tests.support.third_engine import cases as engine
from tests.support.third_engine.arms import FIXED, Make, erring, random_six
from tests.support.third_engine.cases import LAWS, Case, Plan, simulate
from tests.support.third_engine.folder import write_folder
from tests.support.third_engine.instruments import INSTRUMENTS, covariances, draw_noise
from tests.support.third_engine.joint_laws import dahl_friction
from tests.support.third_engine.load_laws import bent_link
from tests.support.third_engine.screws import Flex, Load, Motion, stand
from tests.support.third_engine.session import Session, draw_session

ARMS = {make.name: make for make in (*FIXED, random_six(np.random.default_rng(5)))}


def drawn(make: Make, seed: int = 1, count: int = 40, **more: Any) -> Session:
    session = draw_session(make, np.random.default_rng(seed), count=count, **more)
    assert session is not None
    return session


def some_flex(session: Session, rng: np.random.Generator) -> Flex:
    """A displacement of every part at once, of millimetres and milliradians."""
    still = session.still
    return Flex(
        joint=1e-3 * rng.standard_normal(still.joint.shape),
        lean=1e-3 * rng.standard_normal(still.lean.shape),
        bend=1e-3 * rng.standard_normal(still.bend.shape),
        give=rng.standard_normal(still.give.shape),
        foot_turn=1e-3 * rng.standard_normal(still.foot_turn.shape),
        foot_shift=rng.standard_normal(still.foot_shift.shape),
        growth=1e-4 * rng.standard_normal(still.growth.shape),
        tool=rng.standard_normal(still.tool.shape),
    )


def test_it_imports_nothing_of_calib_or_of_the_second_engine() -> None:
    imported = {
        name
        for path in Path(engine.__file__).parent.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else []
        )
    }
    assert not [name for name in imported if name.startswith(("calib", "inspector", "tests.support.engine"))]
    assert "numpy" in imported


@pytest.mark.parametrize("name", ARMS)
def test_its_screws_stand_where_the_table_says(name: str, tmp_path: Path) -> None:
    simulated = simulate(Case("nothing", 0))
    session = drawn(ARMS[name])
    simulated = replace(simulated, session=session, role=("reference",) + ("train",) * (session.count - 1))
    simulated = replace(simulated, pose=np.arange(session.count), reading_mm=session.plain.tip, covariance_mm2=None)
    dataset = load_dataset(write_folder(simulated, tmp_path / "cell"))
    chain = forward(dataset.robot.table, dataset.poses.q, dataset.robot.is_revolute)
    nominal = stand(ARMS[name].build(), dataset.poses.q, Flex.none(session.count, ARMS[name].n))
    np.testing.assert_allclose(nominal.tip, chain.target_mm, atol=1e-5)


@pytest.mark.parametrize("name", ARMS)
def test_its_torques_are_the_slope_of_the_potential_energy(name: str) -> None:
    session = drawn(ARMS[name])
    flex = some_flex(session, np.random.default_rng(3))

    def potential(joint: int, by: float) -> np.ndarray:
        q = session.q.copy()
        q[:, joint] += by
        return stand(session.build, q, flex, session.loads, session.gravity).potential

    here = stand(session.build, session.q, flex, session.loads, session.gravity)
    for j, slides in enumerate(session.make.slides):
        step = 1.0 if slides else 1e-4  # mm, rad
        slope = (potential(j, step) - potential(j, -step)) / (2.0 * step * (1e-3 if slides else 1.0))
        np.testing.assert_allclose(here.torque(j, slides=slides), -slope, atol=1e-5 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize("name", ["cobot 7R", "gantry with wrist"])
def test_a_turn_of_foot_and_gravity_turns_all_and_changes_no_torque(name: str) -> None:
    session, rng = drawn(ARMS[name]), np.random.default_rng(4)
    flex = replace(some_flex(session, rng), foot_turn=session.still.foot_turn, foot_shift=session.still.foot_shift)
    turn, shift = (
        np.tile(rng.standard_normal(3), (session.count, 1)),
        np.tile(rng.standard_normal(3), (session.count, 1)),
    )
    moved = Motion.along(shift) @ Motion.about(turn, np.zeros(3))
    gravity = moved.pointing(session.gravity)[0]
    before = stand(session.build, session.q, flex, session.loads, session.gravity)
    after = stand(session.build, session.q, replace(flex, foot_turn=turn, foot_shift=shift), session.loads, gravity)
    np.testing.assert_allclose(after.tip, moved.of(before.tip), atol=1e-9)
    for j, slides in enumerate(session.make.slides):
        np.testing.assert_allclose(
            after.torque(j, slides=slides), before.torque(j, slides=slides), rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("name", ARMS)
def test_geometry_imitates_every_error_of_the_build(name: str) -> None:
    session = drawn(ARMS[name], count=60, setups=2)
    worse = replace(session, build=erring(session.build, np.random.default_rng(6), 1e-2, 1e-5))
    shift = worse.seen(worse.plain.tip) - session.seen(session.plain.tip)
    assert session.left_mm(shift) < 1e-3 * np.sqrt(np.mean(shift**2))
    assert session.left_mm(np.random.default_rng(7).standard_normal(shift.shape)) > 0.5


def test_a_link_bends_as_a_cantilever_under_its_end_load() -> None:
    """By Euler and Bernoulli an end force P turns the end by P L^2 / 2 EI and shifts it by P L^3 / 3 EI."""
    drawn_session = drawn(ARMS["small 6R"])
    make, link = replace(drawn_session.make, mass_kg=(0.0,) * 6), 1
    session = replace(drawn_session, make=make, build=make.build())
    end_load = Load(
        link + 1, np.full(session.count, 2.0), session.build.end[link]
    )  # on the next joint's axis: at the end
    here = stand(session.build, session.q, session.still, [end_load], session.gravity)
    span = here.body[link].of(session.build.end[link]) - here.body[link].of(session.build.through[link])
    length = np.linalg.norm(span, axis=1)  # mm
    across = 2.0 * np.linalg.norm(np.cross(span / length[:, None], session.gravity), axis=1)  # N
    turn, shift = bent_link(session, here, link)  # with L / EI = 1
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), across * length / 1000.0 / 2.0, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(shift, axis=1), across * length**2 / 1000.0 / 3.0, rtol=1e-9)


def test_friction_depends_on_the_way_and_not_on_the_place() -> None:
    session = drawn(ARMS["small 6R"])
    way = np.tile([0.0, 0.3, 0.0, -0.3], 10)  # each place is come to from both sides
    session = replace(session, q=np.repeat(way[:, None], 6, axis=1))
    cause = dahl_friction(session, np.random.default_rng(0))
    wound = cause.flex(session, session.plain, 1.0).joint
    joint = int(np.argmax(np.abs(wound).max(axis=0)))
    np.testing.assert_allclose(wound[4::4, joint], -wound[2::4, joint][:9], rtol=1e-6)
    assert np.abs(wound[0, joint]) > 0.0


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_its_noise_has_the_covariance_that_is_told(instrument: str) -> None:
    rng = np.random.default_rng(8)
    seen = np.tile([[200.0, -300.0, 1500.0], [900.0, 400.0, 2500.0]], (20000, 1))
    told = covariances(instrument, seen, 0.05)
    noise = draw_noise(told, rng)
    for k in (0, 1):
        np.testing.assert_allclose(np.cov(noise[k::2].T), told[k], atol=0.05 * np.abs(told[k]).max())
    assert np.mean(np.trace(told, axis1=1, axis2=2)) / 3.0 == pytest.approx(0.05**2)


@pytest.mark.slow
@pytest.mark.parametrize("law", sweep(LAWS, every_run=list(LAWS)[::6]))
def test_a_cause_is_seen_as_it_was_asked_for(law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = ("joint_compliance",) if law in engine.UNSAID else ()
    setups = 3 if law in engine.DAYS else 1
    monkeypatch.setitem(engine.CLASSES, "alone", (lambda k, rng: Plan((*before, law), setups=setups), 1))
    simulated = simulate(Case("alone", 0))
    shift = simulated.reading_mm - simulated.freed_mm
    noise = simulated.session.left_mm(shift[np.unique(simulated.pose, return_index=True)[1]])
    assert all(1.4 < sigma < 26.0 for sigma in simulated.sigmas)
    assert noise > 0.0
    assert np.linalg.norm(shift, axis=1).max() < 0.01 * simulated.session.make.reach_mm
