"""The robust plane, compared with a general minimiser of Tukey's loss and with a known plane."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from calib.planes.robust_fit import TUKEY, PlaneFit, fit_plane_robustly


def points_on_a_plane(seed: int, count: int, stray: float) -> tuple[NDArray, NDArray, float]:
    """Points with noise of 0.02 mm on a plane, a share of them 0.3 mm below to 1 mm above it; its normal and offset."""
    rng = np.random.default_rng(seed)
    local = np.c_[rng.uniform(-20, 20, count), rng.uniform(-5, 5, count), 0.02 * rng.standard_normal(count)]
    off = rng.random(count) < stray
    local[off, 2] = rng.uniform(-0.3, 1, off.sum())
    turn = Rotation.random(rng=rng).as_matrix()
    middle = rng.uniform(-30, 30, 3)
    return local @ turn.T + middle, turn[:, 2], float(turn[:, 2] @ middle)


def fitted(points: NDArray, normal: NDArray, offset: float, tilt_deg: float, lift_mm: float) -> PlaneFit:
    """Robust fit from a start plane with the given errors."""
    across = np.cross(normal, [0.6, 0.64, 0.48])
    start = Rotation.from_rotvec(np.radians(tilt_deg) * across / np.linalg.norm(across)).apply(normal)
    middle = points.mean(axis=0)
    return fit_plane_robustly(points, np.arange(len(points)), start, float(start @ middle) + lift_mm)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_minimum_of_tukeys_loss(seed: int) -> None:
    points, normal, offset = points_on_a_plane(seed, 400, 0.15)
    fit = fitted(points, normal, offset, tilt_deg=0.2, lift_mm=0.01)

    def loss(x: NDArray) -> float:
        way = fit.normal + x[1:] @ fit.axes
        height = points @ way / np.linalg.norm(way) - fit.offset_mm - x[0]
        return -float(np.sum(np.clip(1 - (height / (TUKEY * fit.sigma_mm)) ** 2, 0, None) ** 3))

    best = minimize(loss, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    assert abs(best[0]) < 0.03 * 0.02 / np.sqrt(400)  # of the offset's standard error
    assert np.linalg.norm(best[1:]) < 0.03 * 0.02 / (3 * np.sqrt(400))  # of the weaker slope's
    heights = points[fit.indices] @ fit.normal - fit.offset_mm
    np.testing.assert_allclose(fit.psi_mm, heights * (1 - (heights / (TUKEY * fit.sigma_mm)) ** 2) ** 2, atol=1e-9)


def test_exact_points_give_the_exact_plane() -> None:
    rng = np.random.default_rng(1)
    points = np.c_[rng.uniform(0, 60, (50, 2)), np.full(50, 3.0)]
    fit = fitted(points, np.array([0.0, 0.0, 1.0]), 3.0, tilt_deg=0.5, lift_mm=0.2)
    np.testing.assert_allclose(fit.normal, [0, 0, 1], atol=1e-9)
    assert abs(fit.offset_mm - 3.0) < 1e-7
    assert len(fit.indices) == 50
