"""The cell of a robot and of a dataset: what is assumed, and what measured points tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import load_robot
from calib.dataset.surroundings import Box, Surroundings
from calib.errors import CalibError
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_dataset, workcell_of_robot
from calib.workcell.measurable import BOX, FLOOR, LIMIT, measurable

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["rb5", "panda"])
def test_a_robot_alone_has_poses_that_can_be_measured(name: str) -> None:
    cell = workcell_of_robot(load_robot(ROOT / "calib" / "robots" / f"{name}.toml"))
    q = candidate_poses(cell, 50, rng=np.random.default_rng(1))
    assert q.shape == (50, len(cell.low))
    assert measurable(cell, q).ok.all()
    assert any(note.startswith("scanner: assumed") for note in cell.notes)
    again = candidate_poses(cell, 50, rng=np.random.default_rng(1))
    assert np.array_equal(q, again)


def test_measured_poses_can_be_measured() -> None:
    dataset = load_dataset(ROOT / "sample_data" / "ur10_ipa")
    cell = workcell_of_dataset(dataset)
    assert measurable(cell, dataset.poses.q).ok.mean() > 0.9
    assert measurable(cell, candidate_poses(cell, 100, rng=np.random.default_rng(0))).ok.all()


def test_what_is_in_the_way_is_told_in_counts() -> None:
    robot = load_robot(ROOT / "calib" / "robots" / "rb5.toml")
    everywhere = Box("wall", (-3000.0, -3000.0, -100.0), (3000.0, 3000.0, 3000.0))
    cell = workcell_of_robot(robot, surroundings=Surroundings(0.0, (everywhere,)))
    with pytest.raises(CalibError, match=r"found 0 of 5 .* tries .*\d+ the arm in a box"):
        candidate_poses(cell, 5, rng=np.random.default_rng(0))
    above = replace(cell, boxes=(), floor_z_mm=5000.0)
    q = candidate_poses(replace(cell, boxes=()), 20, rng=np.random.default_rng(0))
    assert set(measurable(cell, q).reason) == {BOX}
    assert set(measurable(above, q).reason) == {FLOOR}
    assert set(measurable(cell, q + 2.1 * np.pi).reason) == {LIMIT}
