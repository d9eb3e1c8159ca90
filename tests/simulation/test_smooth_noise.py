"""Smooth noise has the correlation that a public sheet under structured light has, at any number of rays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.simulation.scanner import STRUCTURED_LIGHT, smooth_noise

# How views of one sheet differ that a structured-light scanner took (RegHEC, data/Plane, aligned in the sheet's frame):
# correlation of the median pair over that at 2.2 mm, by distance in mm. All views share the sheet's own shape.
MEASURED = {4.5: 0.8, 9.0: 0.7, 18.0: 0.54, 36.0: 0.3, 72.0: 0.0}
NEXT_MM = 2.2


def raster(step_mm: float, side_mm: float = 150.0) -> NDArray:
    """(H, W, 2) places across the view."""
    steps = np.arange(0.0, side_mm, step_mm)
    return np.stack(np.meshgrid(steps, steps), axis=-1)


@pytest.mark.slow
def test_its_correlation_is_that_of_a_measured_sheet() -> None:
    """The estimate over 120 fields is good to 0.01 to 0.04."""
    rng = np.random.default_rng(0)
    model = STRUCTURED_LIGHT
    step_mm = 0.1
    places = np.stack(np.meshgrid(np.arange(0.0, 150.0, step_mm), np.arange(0.0, 150.0, 15.0)), axis=-1)
    products: dict[float, list[float]] = {way_mm: [] for way_mm in (0.0, NEXT_MM, *MEASURED)}
    for _ in range(120):
        error = smooth_noise(places, model.correlation_length_mm, model.short_share, rng=rng)
        for way_mm, values in products.items():
            apart = round(way_mm / step_mm)
            values.append(float(np.mean(error[:, apart:] * error[:, : error.shape[1] - apart])))
    found = {way_mm: np.mean(values) for way_mm, values in products.items()}
    assert found[0.0] == pytest.approx(1.0, abs=0.06)
    for way_mm, measured in MEASURED.items():
        assert found[way_mm] / found[NEXT_MM] == pytest.approx(measured, abs=0.12)


@pytest.mark.slow
def test_it_has_variance_one_and_does_not_repeat_across_the_view() -> None:
    rng = np.random.default_rng(1)
    corners = np.array([[0.0, 0.0], [150.0, 0.0], [0.0, 150.0], [75.0, 75.0]])
    values = np.array([smooth_noise(corners, 30.0, 0.2, rng=rng) for _ in range(400)])
    np.testing.assert_allclose(values.var(axis=0), 1.0, atol=0.25)
    apart = np.corrcoef(values.T)[np.triu_indices(4, 1)]
    assert np.abs(apart).max() < 0.2


def test_it_is_one_surface_whatever_the_number_of_rays() -> None:
    coarse, fine = (smooth_noise(raster(step)[:1], 12.0, 0.0, rng=np.random.default_rng(2)) for step in (2.0, 0.5))
    np.testing.assert_allclose(fine[:, ::4][:, : coarse.shape[1]], coarse, atol=1e-9)
