"""The jig's geometry: normals that meet at the given angles, and angles that no corner has."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import CornerError
from calib.jig import jig_normals
from tests.support.jig_corners import UNEVEN


@pytest.mark.parametrize("angles", [(90.0, 90.0, 90.0), UNEVEN.face_angles_deg, (80.0, 95.0, 100.0)])
def test_the_known_normals_meet_at_the_angles_and_lie_closest_to_the_axes(angles):
    normals = jig_normals(angles)
    between = np.degrees(np.arccos(-np.array([normals[i] @ normals[j] for i, j in ((0, 1), (1, 2), (2, 0))])))
    np.testing.assert_allclose(between, angles, atol=1e-9)
    closest, _ = Rotation.align_vectors(np.eye(3), normals)
    np.testing.assert_allclose(closest.as_matrix(), np.eye(3), atol=1e-7)


def test_angles_of_no_corner_are_refused():
    with pytest.raises(CornerError, match="face_angles_deg"):
        jig_normals((50.0, 55.0, 60.0))
