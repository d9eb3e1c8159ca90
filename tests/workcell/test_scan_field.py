"""The field in which a scanner measures, as a frustum."""

from __future__ import annotations

import numpy as np

from calib.workcell.scan_field import ScanField


def test_the_frustum_holds_every_apex_and_its_corners_see_the_declared_size() -> None:
    field = ScanField(700.0, 450.0, 360.0, 280.0, margin_mm=0.0)
    near, far = field.corners_mm
    assert np.ptp(near[:, 2]) == np.ptp(far[:, 2]) == 0.0
    np.testing.assert_allclose(0.5 * (np.ptp(near[:, :2], axis=0) + np.ptp(far[:, :2], axis=0)), [450.0, 360.0])
    np.testing.assert_allclose(near[:, :2] / near[:, 2:], far[:, :2] / far[:, 2:])
    assert field.contains(0.999 * (np.vstack([near, far]) - [0, 0, 700]) + [0, 0, 700]).all()
