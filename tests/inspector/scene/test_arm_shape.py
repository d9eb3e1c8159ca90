"""The solids of an arm stand where the model says its parts are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import frames
from calib.dataset.dataset import Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_for
from calib.fitting.model import Model, geometric_model
from calib.kinematics.robot import Joint, Robot, Target, Tool
from calib.simulation.simulate import simulate_dataset
from calib.workcell.bodies.arm_bodies import reach_mm
from inspector.scene.arm_shape import ArmShape, arm_shape


def poses_at(q: np.ndarray) -> Poses:
    n = len(q)
    ids = tuple(f"p{i}" for i in range(n))
    return Poses(ids, np.array(["reference"] + ["train"] * (n - 1)), q, np.full(n, ""), ids)


def shape_of(robot: Robot, q: list[float]) -> ArmShape:
    model = geometric_model(robot)
    return arm_shape(model, np.zeros(len(model.parameters)), poses_at(np.array([q])), 0)


ELBOW = Robot(  # a post of 100 mm, an arm of 50 mm that turns about it, then a slide along the same axis
    "elbow",
    (Joint(a_mm=50.0, d_mm=100.0, name="turn"), Joint(name="slide", type="prismatic", min=0.0, max=200.0)),
    Tool(a_mm=7.0),
    targets=(Target("ball", (0.0, 3.0, 0.0)),),
)


def test_an_arm_whose_parts_can_be_worked_out_by_hand() -> None:
    shape = shape_of(ELBOW, [np.pi / 2, 30.0])
    parts = {(str(part), int(link)) for part, link in zip(shape.part, shape.link, strict=True)}
    assert parts == {("revolute", 0), ("link", 0), ("prismatic", 1), ("link", 1), ("tool", 2)}
    links = shape.part == "link"
    np.testing.assert_allclose(shape.start_mm[links], [[0, 0, 0], [0, 0, 100], [0, 50, 100]], atol=1e-12)
    np.testing.assert_allclose(shape.end_mm[links], [[0, 0, 100], [0, 50, 100], [0, 50, 130]], atol=1e-12)
    tools = shape.part == "tool"  # a quarter turn: the tool's x is the base's y, the target's y its -x
    np.testing.assert_allclose(shape.end_mm[tools], [[0, 57, 130], [-3, 50, 130]], atol=1e-12)
    np.testing.assert_allclose(shape.tip_mm, [0, 57, 130], atol=1e-12)
    np.testing.assert_allclose(shape.ball_mm, [[0, 0, 100]], atol=1e-12)
    middle = 0.5 * (shape.start_mm + shape.end_mm)
    np.testing.assert_allclose(middle[shape.part == "revolute"], [[0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(middle[shape.part == "prismatic"], [[0, 50, 100]], atol=1e-12)
    assert reach_mm(ELBOW) == 350.0


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["rb5", "panda"])
@given(seed=st.integers(0, 2**32 - 1))
def test_joints_lie_along_their_axes_and_solids_join_up(name: str, seed: int) -> None:
    robot = builtin_robot(name)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, robot.n_joints)
    shape = shape_of(robot, list(q))
    later = q.copy()
    for joint in range(robot.n_joints):  # a turn of the joint leaves its own cylinder where it is
        later[joint] += 0.7
        turned = shape_of(robot, list(later))
        own = (shape.link == joint) & (shape.part == "revolute")
        np.testing.assert_allclose(turned.start_mm[own], shape.start_mm[own], atol=1e-9)
        np.testing.assert_allclose(turned.end_mm[own], shape.end_mm[own], atol=1e-9)
        later[joint] -= 0.7
    pieces = np.isin(shape.part, ["link", "tool"])
    start, end = shape.start_mm[pieces], shape.end_mm[pieces]
    assert np.linalg.norm(start[1:] - end[:-1], axis=1).max() < 2e-3 * reach_mm(robot)
    assert (shape.radius_mm > 0).all()


def test_the_tip_is_where_every_effect_of_the_arm_predicts_it() -> None:
    dataset = simulate_dataset("rb5", rng=4, poses=20, conditions=True).dataset
    rng = np.random.default_rng(5)
    tried = 0
    for family in effects_for(dataset):
        model = Model(dataset.robot, (*geometric_model(dataset.robot).effects, *family.members))
        x = rng.normal(size=len(model.parameters)) * model.scales
        predicted = model.predict(x, dataset.poses)
        for pose in (0, 7, 19):
            shape = arm_shape(model, x, dataset.poses, pose)
            np.testing.assert_allclose(shape.tip_mm, predicted[pose], atol=1e-9)
        tried += 1
    assert tried > 10


def test_moved_solids_keep_their_size_and_meshes_their_frames() -> None:
    shape = shape_of(builtin_robot("rb5"), [0.3, -0.8, 1.1, 0.2, -0.4, 0.9])
    motion = frames.make_transform(frames.rotation_from_rotvec([0.4, -1.2, 0.3]), [10.0, -20.0, 300.0])
    moved = shape.moved(motion)
    length = np.linalg.norm(shape.end_mm - shape.start_mm, axis=1)
    np.testing.assert_allclose(np.linalg.norm(moved.end_mm - moved.start_mm, axis=1), length)
    np.testing.assert_allclose(moved.base_T_link, motion @ shape.base_T_link)
    back = moved.moved(frames.invert(motion))
    np.testing.assert_allclose(back.start_mm, shape.start_mm, atol=1e-9)
    np.testing.assert_allclose(back.tip_mm, shape.tip_mm, atol=1e-9)


def test_an_arm_of_no_length_is_drawn_too() -> None:
    shape = shape_of(Robot("point", (Joint(name="J1"),)), [0.0])
    assert list(shape.part) == ["revolute"]
    assert np.linalg.norm(shape.end_mm - shape.start_mm) > 0
