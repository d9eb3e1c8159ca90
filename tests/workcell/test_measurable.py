"""Poses called measurable, compared with MuJoCo in rebuilt cells: rays to every face, distances of every body."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Surroundings
from calib.frames import make_transform
from calib.kinematics.robot import FixedFrame
from calib.workcell.candidates import candidate_poses, likely_poses
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.measurable import (
    BOX,
    BOX_HIDES,
    FIELD,
    FLOOR,
    HIDDEN,
    SELF,
    SINGULAR,
    counted,
    measurable,
)
from calib.workcell.scan_field import JANG_FIELD
from calib.workcell.workcell import Workcell
from tests.support.checked_cells import ARMS, BOXES, in_mujoco, is_fine, looking_from
from tests.support.sweeps import sweep

ROBOTS = Path(__file__).parents[2] / "calib" / "robots"


@pytest.mark.slow
@pytest.mark.parametrize("name", sweep(ARMS, every_run=["panda", "gantry"]))
def test_an_independent_ray_caster_finds_no_hidden_face_and_no_collision(name: str) -> None:
    rng = np.random.default_rng(7)
    told = Surroundings(-400.0, BOXES)
    base = workcell_of_robot(ARMS[name], surroundings=told)
    there, pairs = in_mujoco(base)
    seen = wrong = strict = 0
    for cell in [base, *(looking_from(base, rng) for _ in range(4))]:
        eye_mm = cell.base_T_scanner[:3, 3]
        q = candidate_poses(cell, 40, rng=rng) if cell is base else likely_poses(cell, rng)
        judged = measurable(cell, q)
        for row in np.flatnonzero(judged.ok)[:12]:
            seen += 1
            assert is_fine(there, pairs, q[row], eye_mm)
        for row in np.flatnonzero(np.isin(judged.reason, (HIDDEN, BOX_HIDES, SELF, BOX, FLOOR)))[:10]:
            wrong += 1
            strict += is_fine(there, pairs, q[row], eye_mm)
    assert seen > 30
    assert wrong > 20 or name == "gantry"
    assert strict <= 0.3 * wrong  # the jig's body is taken for the ball around it


# Franka's own volumes of links 3 to 7 (franka_ros, franka_description, franka_arm.xacro): link, ends and radius, mm, in
# the frames of Craig's convention, in which the maker prints its table.
CRAIG = (  # a_(i-1), alpha_(i-1), d_i
    (0.0, 0.0, 333.0),
    (0.0, -np.pi / 2, 0.0),
    (0.0, np.pi / 2, 316.0),
    (82.5, np.pi / 2, 0.0),
    (-82.5, -np.pi / 2, 384.0),
    (0.0, np.pi / 2, 0.0),
    (88.0, np.pi / 2, 0.0),
)
FRANKA = (
    (3, (0.0, 0.0, -220.0), (0.0, 0.0, -70.0), 60.0),
    (4, (0.0, 0.0, -60.0), (0.0, 0.0, 60.0), 60.0),
    (5, (0.0, 0.0, -310.0), (0.0, 0.0, -210.0), 60.0),
    (5, (0.0, 80.0, -200.0), (0.0, 80.0, -60.0), 25.0),
    (6, (0.0, 0.0, -70.0), (0.0, 0.0, 10.0), 50.0),
    (7, (0.0, 0.0, -60.0), (0.0, 0.0, 80.0), 40.0),
    (7, (38.9, 38.9, 82.0), (46.0, 46.0, 82.0), 30.0),
)


@pytest.mark.slow
def test_franka_s_own_volumes_hide_no_face_of_a_pose_called_measurable() -> None:
    """Points every few millimetres of each line of sight, compared with the distance from each volume's axis."""
    cell = workcell_of_robot(ARMS["panda"])
    eye_mm = cell.base_T_scanner[:3, 3]
    flat, deep = np.sqrt(2.0 / 3.0), np.sqrt(1.0 / 3.0)
    edges = 60.0 * np.array([[flat * np.cos(a), flat * np.sin(a), deep] for a in np.radians([180, 300, 60])])
    for q in candidate_poses(cell, 60, rng=np.random.default_rng(3)):
        links, base_T_link = [], np.eye(4)
        for (a, alpha, d), angle in zip(CRAIG, q, strict=True):
            turn = Rotation.from_euler("x", alpha)
            place = np.array([a, 0.0, 0.0]) + turn.apply([0.0, 0.0, d])
            step = make_transform((turn * Rotation.from_euler("z", angle)).as_matrix(), place)
            base_T_link = base_T_link @ step
            links.append(base_T_link)
        apex = (base_T_link @ [0.0, 0.0, 107.0 + 88.0, 1.0])[:3]
        assert np.allclose(apex, cell.chain(q[None]).target_mm[0], atol=1.0)
        there = edges @ (base_T_link[:3, :3] @ np.diag([1.0, -1.0, -1.0])).T
        points = np.array(
            [
                apex + s * there[i] + t * there[j]
                for i, j in ((0, 1), (1, 2), (2, 0))
                for s, t in ((0.05, 0.05), (0.45, 0.45), (0.9, 0.05), (0.05, 0.9))
            ]
        )
        rays = eye_mm + np.linspace(0.3, 1.0, 300)[:, None, None] * (points - eye_mm)
        for link, start, end, radius in FRANKA:
            frame = links[link - 1]
            first, last = frame[:3, :3] @ start + frame[:3, 3], frame[:3, :3] @ end + frame[:3, 3]
            along = last - first
            share = np.clip((rays - first) @ along / (along @ along), 0.0, 1.0)
            off_mm = np.linalg.norm(rays - first - share[..., None] * along, axis=-1)
            assert off_mm.min() > radius


@pytest.fixture(scope="module")
def rb5_cell() -> Workcell:
    return replace(workcell_of_robot(ARMS["rb5"]), floor_z_mm=100.0)


@pytest.fixture(scope="module")
def likely(rb5_cell: Workcell) -> NDArray:
    return likely_poses(rb5_cell, np.random.default_rng(0))[:250]


@settings(max_examples=15, deadline=None)
@given(
    x=st.floats(-2000.0, 2000.0),
    y=st.floats(-2000.0, 2000.0),
    z=st.floats(0.0, 1500.0),
    turn=st.floats(-np.pi, np.pi),
)
def test_moving_the_whole_cell_changes_nothing(
    rb5_cell: Workcell, likely: NDArray, x: float, y: float, z: float, turn: float
) -> None:
    cell, q = rb5_cell, likely
    moved_T_base = make_transform(Rotation.from_euler("z", turn).as_matrix(), [x, y, z])
    moved = replace(
        cell,
        robot=replace(cell.robot, base=FixedFrame((x, y, z), (0.0, 0.0, turn))),
        base_T_scanner=moved_T_base @ cell.base_T_scanner,
        floor_z_mm=100.0 + z,
    )
    assert np.array_equal(measurable(cell, q).reason, measurable(moved, q).reason)


@settings(max_examples=20, deadline=None)
@given(larger=st.tuples(*[st.floats(1.0, 2.0)] * 4))
def test_a_larger_field_never_loses_a_pose(
    rb5_cell: Workcell, likely: NDArray, larger: tuple[float, float, float, float]
) -> None:
    cell, q = replace(rb5_cell, field=JANG_FIELD), likely
    width, height, depth, incidence = larger
    wider = replace(
        JANG_FIELD,
        width_mm=width * JANG_FIELD.width_mm,
        height_mm=height * JANG_FIELD.height_mm,
        depth_mm=depth * JANG_FIELD.depth_mm,
        max_incidence_deg=min(89.0, incidence * JANG_FIELD.max_incidence_deg),
    )
    before, after = measurable(cell, q).ok, measurable(replace(cell, field=wider), q).ok
    assert before.any()
    assert not np.any(before & ~after)


def test_singularities_are_kept_away_from_as_far_as_is_asked() -> None:
    cell = workcell_of_robot(ARMS["rb5"])
    straight = candidate_poses(cell, 200, rng=np.random.default_rng(0))
    shares = [
        float(np.mean(measurable(replace(cell, least_manipulability=least), straight).reason == SINGULAR))
        for least in (0.0, 0.02, 0.1, 0.9)
    ]
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    stretched = np.array([[0.3, 0.2, 0.0, 0.4, 0.7, 0.1]])  # upper arm and forearm in one line
    free = replace(cell, base_T_scanner=None, floor_z_mm=None, least_manipulability=1e-6)
    assert measurable(free, stretched).reason[0] == SINGULAR


def test_reasons_are_counted_the_most_frequent_first() -> None:
    cell = workcell_of_robot(ARMS["rb5"])
    q = np.random.default_rng(0).uniform(cell.low, cell.high, (300, 6))
    said = measurable(cell, q)
    first = counted([said.reason, said.reason]).split(", ")[0]
    assert first == f"{2 * np.sum(said.reason == FIELD)} {FIELD}"
    assert counted([measurable(cell, q[:0]).reason]) == ""
