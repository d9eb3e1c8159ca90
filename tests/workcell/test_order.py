"""Order of poses: every pose once, paths near the shortest, around obstacles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest

from calib.array_types import Array
from calib.dataset.dataset import Box
from calib.kinematics.robot import Joint, Robot, Tool
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.order import clear_ways, order_poses, way_lengths
from calib.workcell.workcell import Workcell

# Two prismatic joints side by side: ways in joint space are ways on a table.
PLOTTER = Robot(
    "plotter",
    (
        Joint(alpha_rad=-np.pi / 2, theta_rad=-np.pi / 2, type="prismatic", min=0.0, max=2000.0, name="x"),
        Joint(alpha_rad=-np.pi / 2, theta_rad=-np.pi / 2, type="prismatic", min=0.0, max=2000.0, name="y"),
    ),
    Tool(d_mm=400.0),
)


@pytest.fixture(scope="module")
def cell() -> Workcell:
    return workcell_of_robot(PLOTTER, jig=None)


def moved(q: Array) -> float:
    """Sum of the largest joint movements from row to row."""
    return float(way_lengths(PLOTTER, q[:-1], q[1:]).trace())


@pytest.mark.parametrize("seed", range(4))
def test_the_order_is_near_the_shortest_of_all(cell: Workcell, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(500.0, 2000.0, (7, 2))
    lengths = [moved(q[list(order)]) for order in permutations(range(7))]
    found = order_poses(cell, q)
    assert sorted(found) == list(range(7))
    assert moved(q[found]) <= 1.1 * min(lengths)


def test_it_begins_near_where_the_arm_stands(cell: Workcell) -> None:
    q = np.column_stack([np.arange(10) * 100.0, np.zeros(10)])[np.random.default_rng(0).permutation(10)]
    found = order_poses(cell, q, start=[900.0, 0.0])
    assert np.array_equal(q[found, 0], np.arange(10)[::-1] * 100.0)
    assert len(order_poses(cell, np.zeros((0, 2)))) == 0
    assert list(order_poses(cell, q[:1])) == [0]


def test_ways_lead_around_a_box(cell: Workcell) -> None:
    q = np.array([[0.0, 300.0], [0.0, 1300.0], [800.0, 1300.0], [800.0, 300.0]])
    tip_mm = cell.chain(q).target_mm
    between = 0.5 * (tip_mm[0] + tip_mm[3])  # the short way from the first to the last is closed
    low, high = between - 100.0, between + 100.0
    corners = (float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2]))
    boxed = replace(cell, boxes=(Box("post", *corners),))
    assert not clear_ways(boxed, q[[0, 3]])[0]
    free, around = order_poses(cell, q, start=q[0]), order_poses(boxed, q, start=q[0])
    assert {0, 3} in [set(pair) for pair in pairwise(free)]
    assert {0, 3} not in [set(pair) for pair in pairwise(around)]
    assert clear_ways(boxed, q[around]).all()
