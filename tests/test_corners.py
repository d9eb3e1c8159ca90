"""The whole way from a scan to a corner: truths, laws, hard scenes, and input that holds no corner."""

from __future__ import annotations

import numpy as np
import pytest

from calib.corners import find_corner
from calib.jig import Jig
from scan_scene import make_scene


@pytest.mark.parametrize("seed", range(4))
def test_corner_lies_at_the_apex_within_its_own_uncertainty(seed: int) -> None:
    scene = make_scene(np.random.default_rng(seed), 12_000)
    corner = find_corner(scene.scan, Jig(), scan_sigma_mm=0.02).corner
    assert corner is not None
    error = corner.xyz_mm - scene.apex_mm
    assert np.linalg.norm(error) < 3 * scene.bound_mm
    assert error @ np.linalg.solve(corner.covariance_mm2, error) < 16  # chi^2 of 3: 99.9 %
