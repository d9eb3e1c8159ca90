"""Versions of a model: each with its own errors at the same points."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.model_versions import EFFECTS, LINKS, NOMINAL, fits_same_points, versions
from calib.calibration.result import Calibration
from calib.effects.catalogue import effects_for
from calib.simulation.simulate import simulate_dataset


@pytest.fixture(scope="module")
def fits() -> tuple[Calibration, Calibration]:
    """Fits of the link errors alone, and with the effect that is in the data."""
    dataset = simulate_dataset(
        "rb5", rng=8, effects=[("transmission_error", 4.0)], poses=45,
    ).dataset  # fmt: skip
    effects = next(f.members for f in effects_for(dataset) if f.name == "transmission_error")
    assert effects
    return calibrate(dataset), calibrate(dataset, effects=effects)


def test_each_version_has_the_numbers_of_its_own_fit(fits: tuple[Calibration, Calibration]) -> None:
    links, full = fits
    found = versions(full)
    assert [v.name for v in found] == [NOMINAL, LINKS, EFFECTS]
    expected = (full.before.train, links.after.train, full.after.train)
    rmse = [v.evaluation.train.rmse_mm for v in found if v.evaluation.train]
    assert rmse == pytest.approx([e.rmse_mm for e in expected if e], rel=1e-9)
    assert rmse[0] > rmse[1] > 1.5 * rmse[2]
    assert [v.name for v in versions(links)] == [NOMINAL, LINKS]


def test_a_known_fit_of_the_link_errors_is_used_only_for_the_same_points(
    fits: tuple[Calibration, Calibration],
) -> None:
    links, full = fits
    assert versions(full, links)[1].calibration is links
    other = calibrate(simulate_dataset("rb5", rng=9, poses=45).dataset)
    assert not fits_same_points(other, full)
    made = versions(full, other)[1].calibration
    assert made is not other
    np.testing.assert_allclose(made.fit.x, links.fit.x, atol=1e-9)


def test_errors_by_pose_are_those_of_its_points(fits: tuple[Calibration, Calibration]) -> None:
    _, full = fits
    version = versions(full)[-1]
    length, vector = version.pose_errors_mm(), version.pose_error_vectors_mm()
    for pose in range(len(full.dataset.poses)):
        own = version.evaluation.error_mm[version.evaluation.pose == pose]
        assert length[pose] == pytest.approx(np.sqrt(np.mean(np.sum(own**2, axis=1))))
        np.testing.assert_allclose(vector[pose], own.mean(axis=0))
