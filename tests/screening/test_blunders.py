"""Single wrong poses: every command does without the same ones, and an effect that is missing is none of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.calibration.calibrate import fit_measured
from calib.dataset.dataset import Dataset, Scanner
from calib.screening.blunders import without_blunders
from calib.simulation.simulate import simulate_dataset


def with_blunders(
    seed: int, sigma_mm: float | None, effects: tuple[str, ...] = ()
) -> tuple[Dataset, Dataset, set[str]]:
    """An arm's dataset, the same with two training points some millimetres off, and their poses."""
    clean = simulate_dataset("rb5", rng=seed, poses=60, effects=effects).dataset
    clean = replace(clean, scanner=Scanner(point_sigma_mm=sigma_mm))
    rows = np.flatnonzero(~clean.poses.is_test)[[12, 30]]
    points = clean.points
    xyz_mm = points.xyz_mm.copy()
    xyz_mm[rows] += [[6.0, -8.0, 5.0], [0.0, 9.0, 0.0]]
    return clean, clean.with_points(replace(points, xyz_mm=xyz_mm)), {clean.poses.ids[k] for k in rows}


@pytest.mark.parametrize("sigma_mm", [0.05, None])
def test_plan_and_diagnose_do_without_the_same_poses(sigma_mm: float | None) -> None:
    clean, spoilt, wrong = with_blunders(3, sigma_mm)
    fit = without_blunders(fit_measured(spoilt))
    assert wrong <= set(fit.dataset.left_out)
    assert set(calib.diagnose(spoilt).calibration.dataset.left_out) == set(fit.dataset.left_out)
    asked, found = (calib.plan(known, 1, seed=1).now.geometry_mm for known in (clean, spoilt))
    assert found == pytest.approx(asked, rel=0.3)


def test_poses_of_a_missing_effect_are_no_blunders() -> None:
    clean, spoilt, wrong = with_blunders(4, 0.05, ("backlash",))
    plain = fit_measured(clean)
    assert plain.sigma_mm > 0.07
    assert without_blunders(plain) is plain
    assert set(without_blunders(fit_measured(spoilt)).dataset.left_out) == wrong


def test_few_poses_show_no_blunders() -> None:
    fit = fit_measured(simulate_dataset("rb5", rng=2, poses=11).dataset)
    assert without_blunders(fit) is fit
