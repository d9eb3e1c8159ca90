"""What a model misses alike at neighbouring poses: its covariance, where a check counts it, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset, Scanner
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import TOOL, Change, ChangeModel
from calib.extras.watch.misfit import Misfit
from calib.extras.watch.present.changes import change_verdict
from calib.extras.watch.watch import watch
from calib.fitting.discrepancy import Discrepancy
from calib.rendering.text import block_text
from calib.simulation.simulate import simulate_dataset


@pytest.fixture(scope="module")
def clean() -> Dataset:
    return simulate_dataset("rb5", rng=0, poses=48).dataset


def test_nothing_is_proven_where_the_model_is_right(clean: Dataset) -> None:
    misfit = Misfit.of(calibrate(clean))
    assert (misfit.inflation, misfit.discrepancy, misfit.tails) == (1.0, None, 1.0)
    assert misfit.root_mm(clean.poses.q).shape == (48, 0)


def test_the_covariance_is_that_of_a_brownian_motion_from_the_training_poses() -> None:
    known = Discrepancy(0.01, 0.4, np.array([[0.0], [10.0]]), np.array([1.0]))
    root = Misfit(1.0, known, 1.0).root_mm(np.array([[0.5], [1.5], [-0.5]]))
    # 0.5 and 1.5 lie on one way from the pose at 0, of which they share half a unit; -0.5 lies on another way.
    expected = np.array([[0.21, 0.2, 0.0], [0.2, 0.61, 0.0], [0.0, 0.0, 0.21]])
    np.testing.assert_allclose(root @ root.T, expected, atol=1e-12)


def test_a_change_that_no_part_can_make_is_refused(clean: Dataset) -> None:
    tests = CellTests.of(calibrate(clean), [clean])
    points = len(tests.models[0].columns)
    model = ChangeModel(TOOL, None, "", "mm", np.broadcast_to(np.eye(3), (points, 3, 3)))

    def tool_by(size_mm: float) -> Change:
        return Change(TOOL, None, "", size_mm, 0.3 * size_mm, "mm", 1e-4, (), (size_mm, 0.0, 0.0))

    assert tests.rmse_mm < 0.3
    assert tests.no_part_makes(tool_by(369.0), model)
    assert not tests.no_part_makes(tool_by(2.0), model)


def test_a_fit_that_leaves_many_times_the_noise_says_so(clean: Dataset) -> None:
    fine = replace(clean, scanner=Scanner(point_sigma_mm=0.01))
    for dataset, is_said in ((clean, False), (fine, True)):
        seen = watch(calibrate(dataset), dataset)
        told = block_text(*change_verdict(seen))
        assert ("times the declared noise" in " ".join(told.split())) == is_said
        assert seen.times_noise == pytest.approx(1.0 if not is_said else 5.0, rel=0.2)
