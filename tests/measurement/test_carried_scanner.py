"""Attitudes by which a jig's faces are labelled, where the arm carries the scanner and the jig is fixed in the cell."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from calib import frames
from calib.corners.intersection import Corner
from calib.measurement.face_labels import predicted_attitudes
from tests.support.arms import flange_dataset_of, random_arm


def test_the_jig_stands_in_the_room_alike_at_all_poses() -> None:
    rng = np.random.default_rng(1)
    arm = random_arm(rng, 6)
    dataset = flange_dataset_of(arm, arm, rng, poses=25, full_poses=True)
    points = dataset.points
    corners = {  # of which only place and covariance count
        pose_id: cast(Corner, SimpleNamespace(xyz_mm=points.xyz_mm[row], covariance_mm2=1e-4 * np.eye(3)))
        for row, pose_id in enumerate(dataset.poses.ids)
    }
    predicted, why = predicted_attitudes(replace(dataset, points=None), corners)
    assert why == {}
    stands = np.stack([predicted[i].T @ points.orientations.scanner_R_jig[k] for k, i in enumerate(dataset.poses.ids)])
    off_rad = frames.rotvec_from_rotation(np.swapaxes(stands[:1], 1, 2) @ stands)
    np.testing.assert_allclose(off_rad, 0.0, atol=1e-6)
