"""Smooth noise has the correlation that a public sheet under structured light has, at any number of rays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.simulation.scanner import STRUCTURED_LIGHT
from calib.simulation.smooth_noise import smooth_noise

# Residuals of a plane through a sheet that a structured-light scanner measured (RegHEC, data/Plane), several scans.
MEASURED = {1.5: (0.96, 0.98), 10.0: (0.80, 0.87), 22.0: (0.57, 0.72), 45.0: (0.17, 0.31)}


def raster(step_mm: float, side_mm: float = 150.0) -> NDArray:
    """(H, W, 2) places across the view."""
    steps = np.arange(0.0, side_mm, step_mm)
    return np.stack(np.meshgrid(steps, steps), axis=-1)


def test_its_correlation_is_that_of_a_measured_sheet() -> None:
    """Facing the scanner, white noise included; the estimate over 120 fields is good to 0.01 to 0.04."""
    rng = np.random.default_rng(0)
    model = STRUCTURED_LIGHT
    places = raster(0.5)[::20]  # rows 10 mm apart, places 0.5 mm apart
    products: dict[float, list[float]] = {way_mm: [] for way_mm in MEASURED}
    squares = []
    for _ in range(120):
        error_mm = model.correlated_sigma_mm * smooth_noise(
            places, model.correlation_length_mm, model.short_share, rng=rng
        )
        error_mm += model.scan_sigma_mm * rng.standard_normal(error_mm.shape)
        squares.append(np.mean(error_mm**2))
        for way_mm in MEASURED:
            apart = round(way_mm / 0.5)
            products[way_mm].append(float(np.mean(error_mm[:, apart:] * error_mm[:, :-apart])))
    total = model.correlated_sigma_mm**2 + model.scan_sigma_mm**2
    assert np.mean(squares) == pytest.approx(total, rel=0.06)
    for way_mm, (least, most) in MEASURED.items():
        assert least - 0.02 < np.mean(products[way_mm]) / np.mean(squares) < most + 0.02


def test_it_has_variance_one_and_does_not_repeat_across_the_view() -> None:
    rng = np.random.default_rng(1)
    corners = np.array([[0.0, 0.0], [150.0, 0.0], [0.0, 150.0], [75.0, 75.0]])
    values = np.array([smooth_noise(corners, 30.0, 0.2, rng=rng) for _ in range(600)])
    np.testing.assert_allclose(values.var(axis=0), 1.0, atol=0.2)
    apart = np.corrcoef(values.T)[np.triu_indices(4, 1)]
    assert np.abs(apart).max() < 0.17


def test_it_is_one_surface_whatever_the_number_of_rays() -> None:
    coarse, fine = (
        smooth_noise(raster(step)[:1], 12.0, 0.0, rng=np.random.default_rng(2)) for step in (2.0, 0.5)
    )
    np.testing.assert_allclose(fine[:, ::4][:, : coarse.shape[1]], coarse, atol=1e-9)
