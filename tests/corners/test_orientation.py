"""The jig's orientation from three planes: exact for exact planes, with the covariance of its errors for noisy ones."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners.intersection import Corner, Face, intersect
from calib.corners.orientation import candidates
from calib.corners.quality import CornerQuality
from calib.corners.search import find_corner
from calib.jig import Jig, jig_normals
from tests.support.jig_corners import UNEVEN, corner_of, error_rad
from tests.support.scan_scene import make_scene


@pytest.mark.parametrize("jig", [Jig(), UNEVEN])
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 0, 1)])
def test_exact_planes_give_the_exact_rotation_whatever_their_order(jig, order):
    rng = np.random.default_rng(0)
    true = Rotation.random(random_state=1).as_matrix()
    normals = (jig_normals(jig.face_angles_deg) @ true.T)[list(order)]
    ways = candidates(corner_of(normals, rng, sigma_rad=1e-12), jig)
    best = min(ways, key=lambda o: np.linalg.norm(error_rad(true, o.scanner_R_jig)))
    np.testing.assert_allclose(best.scanner_R_jig, true, atol=1e-10)
    np.testing.assert_allclose(normals[list(best.order)], jig_normals(jig.face_angles_deg) @ true.T)
    w, x, y, z = best.quaternion()
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), best.scanner_R_jig, atol=1e-12)
    turns = [np.degrees(np.linalg.norm(error_rad(true, o.scanner_R_jig))) for o in ways]
    np.testing.assert_allclose(sorted(turns)[1:], 120.0, atol=2.0)


@pytest.mark.slow
def test_the_covariance_is_that_of_the_errors_and_the_misfit_that_of_three_angles():
    rng = np.random.default_rng(2)
    squared, misfit = [], []
    for _ in range(400):
        true = Rotation.random(random_state=rng).as_matrix()
        way = candidates(corner_of(true.T, rng), Jig())[0]
        error = error_rad(true, way.scanner_R_jig)
        squared.append(error @ np.linalg.solve(way.covariance_rad2, error))
        misfit.append(way.misfit)
    assert 2.6 < np.mean(squared) < 3.4  # ideal 3, the mean's own sigma 0.12
    assert 2.6 < np.mean(misfit) < 3.4


@pytest.mark.slow
def test_point_and_turn_err_together_as_the_cross_covariance_says():
    rng = np.random.default_rng(12)
    squared = []
    for _ in range(300):
        root = rng.normal(size=(9, 9)) * np.tile([0.01, 3e-4, 3e-4], 3)[:, None]
        true, apex = (
            Rotation.random(random_state=rng).as_matrix(),
            rng.normal(size=3) + np.array([0, 0, 700.0]),
        )
        error, faces = root @ rng.normal(size=9), []
        for i in range(3):  # the found plane is the true one, lower by h at its centre and tilted by the slopes
            axes = np.delete(true.T, i, axis=0)
            centre = apex - axes.T @ [20.0, 20.0]
            normal = true[:, i] + error[3 * i + 1 : 3 * i + 3] @ axes
            normal /= np.linalg.norm(normal)
            centre = centre - error[3 * i] * normal
            found_axes = axes - np.outer(axes @ normal, normal)
            face = Face(normal, float(normal @ centre), centre, 9, 0.02, np.zeros(0, int), i, found_axes, np.eye(3))
            faces.append(face)
        found_apex = intersect(np.array([f.normal for f in faces]), np.array([f.offset_mm for f in faces]))
        quality = cast(CornerQuality, None)
        way = candidates(
            Corner(
                found_apex,
                np.eye(3),
                (faces[0], faces[1], faces[2]),
                root @ root.T,
                quality,
                Jig().outlines()[0],
            ),
            Jig(),
        )[0]
        lever = np.zeros((3, 9))
        for i, face in enumerate(faces):
            lever[i, 3 * i : 3 * i + 3] = 1.0, *(face.axes @ (found_apex - face.centre_mm))
        by_planes = np.linalg.inv(np.array([f.normal for f in faces])) @ lever
        apex_covariance = by_planes @ root @ root.T @ by_planes.T
        whole = np.block([[apex_covariance, way.cross_mm_rad], [way.cross_mm_rad.T, way.covariance_rad2]])
        off = np.concatenate([apex - found_apex, error_rad(true, way.scanner_R_jig)])
        squared.append(off @ np.linalg.solve(whole, off))
    assert 5.3 < np.mean(squared) < 6.7  # ideal 6, the mean's own sigma 0.2


def test_faces_that_do_not_meet_as_told_widen_the_covariance():
    rng = np.random.default_rng(3)
    found = corner_of(jig_normals((90.0, 90.0, 90.3)), rng)
    told, true = candidates(found, Jig())[0], candidates(found, Jig(face_angles_deg=(90.0, 90.0, 90.3)))[0]
    assert told.misfit > 100.0 > 21.0 > true.misfit
    assert told.sigma_rad() > 3.0 * true.sigma_rad()


@pytest.mark.slow
@pytest.mark.parametrize("convex", [True, False])
def test_real_scans_give_the_orientation_within_its_own_sigma(convex):
    squared = []
    for seed in range(3):
        scene = make_scene(np.random.default_rng(seed), 12_000, convex=convex)
        jig = Jig(convex=convex)
        corner = find_corner(scene.scan, jig, scan_sigma_mm=0.02).corner
        assert corner is not None
        order = [0, 1, 2] if np.linalg.det(scene.normals) > 0 else [0, 2, 1]
        ways = candidates(corner, jig)
        errors = [error_rad(scene.normals[order].T, o.scanner_R_jig) for o in ways]
        k = int(np.argmin([np.linalg.norm(e) for e in errors]))
        assert np.linalg.norm(errors[k]) < 5e-4
        squared.append(errors[k] @ np.linalg.solve(ways[k].covariance_rad2, errors[k]))
    assert np.mean(squared) < 7.0
