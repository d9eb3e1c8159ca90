"""What a change moved, for drawing: the measured displacement, and the part that the proven causes explain."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate, frames
from calib.intervention.differences import PairDisplacements
from calib.intervention.proof import interventions_of
from calib.statistics import rms
from tests.support.changed import with_poses, with_xyz
from tests.support.engine.cell import Cell
from tests.support.paired_cell import ARMS, compliance, difference_mm, draw_pairs, measured, size_of

SIGMA_MM = 0.05


@pytest.fixture(scope="module")
def soft() -> tuple[Cell, float, PairDisplacements]:
    """A cell whose joint 2 is soft, by how much, and the displacements of it when the instrument was moved."""
    rng = np.random.default_rng(3)
    cell = draw_pairs(ARMS["UR10e"], rng, 20)
    cause = compliance(1).cause
    size = size_of(cell, cause, 10.0 * SIGMA_MM)
    made = measured(cell, [(cause, size)], rng, test_places=4)
    moved = frames.make_transform(frames.rotation_from_rotvec([0.1, 0.2, -0.1]), np.array([50.0, 20.0, 0.0]))
    loaded = made.poses.payload_kg == 2.0
    xyz_mm = np.where(loaded[:, None], frames.apply(moved, made.points.xyz_mm), made.points.xyz_mm)
    made = with_poses(made, setup=np.where(loaded, "b", "a"))
    (found,) = interventions_of(calibrate(with_xyz(made, xyz_mm)))
    assert found.proofs
    assert found.displacements is not None
    return cell, size, found.displacements


def test_what_is_explained_is_what_the_soft_joint_does(soft: tuple[Cell, float, PairDisplacements]) -> None:
    cell, size, shown = soft
    true_mm = difference_mm(cell, [(compliance(1).cause, size)])[shown.before]
    assert rms(shown.explained_mm - true_mm) < 0.1 * rms(true_mm)


def test_what_was_moved_is_measured_without_the_motion_of_the_instrument(
    soft: tuple[Cell, float, PairDisplacements],
) -> None:
    _, _, shown = soft
    off_mm = shown.moved_mm - shown.explained_mm
    # The noise of two points, less the nine unknowns that took some of it.
    assert 0.75 < rms(off_mm[~shown.held_out]) / (np.sqrt(2.0) * SIGMA_MM) < 1.1
    assert shown.held_out.sum() == 4
    assert np.array_equal(shown.after - shown.before, np.full(20, 20))
    assert shown.names[0].endswith("_run2")
