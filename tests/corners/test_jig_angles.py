"""Angles between a jig's faces by all scans together: held where they agree, learned where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners.intersection import Corner, Face, intersect, intersection_covariance
from calib.corners.jig_angles import JigAngles, with_common_angles
from calib.corners.quality import CornerQuality, FaceQuality
from calib.jig import Jig, jig_normals
from calib.planes.robust_fit import height_lever

APEX = np.array([5.0, -8.0, 700.0])
SKEW = (90.08, 89.90, 90.05)
QUALITY = CornerQuality(
    (FaceQuality(900, 50.0, 0.9, 0.02, 1.0, 0.01),) * 3, (90.0,) * 3, (0.01,) * 3, (0.0,) * 3,
    1.0, 2.0, 0.0, 10.0, 1.0, 0.3,
)  # fmt: skip


def measured(
    angles_deg: tuple[float, float, float], rng: np.random.Generator, shared: np.ndarray | float = 0.0
) -> Corner:
    """A corner of three planes that are off by errors of the covariance it states, and by `shared` (9,) besides.

    Tilts of half a milliradian; the faces are numbered from any one on, in either direction.
    """
    turned = jig_normals(angles_deg) @ Rotation.random(random_state=rng).as_matrix()
    turned = turned[rng.permutation(3)]
    root = rng.normal(size=(9, 9)) * np.tile([0.005, 2e-4, 2e-4], 3)[:, None]
    error = root @ rng.normal(size=9) + shared
    faces = []
    for i, normal in enumerate(turned):
        axes = np.linalg.svd(normal[None])[2][1:]
        centre = APEX + axes.T @ [18.0, 12.0]
        found = normal + error[3 * i + 1 : 3 * i + 3] @ axes
        found /= np.linalg.norm(found)
        centre = centre - error[3 * i] * found
        axes = axes - np.outer(axes @ found, found)
        faces.append(Face(found, float(found @ centre), centre, 900, 0.02, np.zeros(0, np.uint8), i, axes, np.eye(3)))
    normals = np.array([f.normal for f in faces])
    apex = intersect(normals, np.array([f.offset_mm for f in faces]))
    lever = height_lever(faces, apex)
    planes_mm2 = root @ root.T
    apex_mm2 = intersection_covariance(normals, lever @ planes_mm2 @ lever.T)
    return Corner(apex, apex_mm2, (faces[0], faces[1], faces[2]), planes_mm2, QUALITY, Jig().outlines()[0])


def of_set(
    scans: int, angles_deg: tuple[float, float, float], seed: int, jig: Jig = Jig()
) -> tuple[dict[str, Corner], dict[str, Corner], JigAngles]:
    """Corners of so many scans with free planes, the same with common angles, and those angles."""
    rng = np.random.default_rng(seed)
    free = {f"p{k}": measured(angles_deg, rng) for k in range(scans)}
    held, angles = with_common_angles(free, jig)
    assert angles is not None
    return free, held, angles


def rms_mm(corners: dict[str, Corner]) -> float:
    """RMS of the apexes' errors."""
    return float(np.sqrt(np.mean([np.sum((c.xyz_mm - APEX) ** 2) for c in corners.values()])))


def squared(corners: dict[str, Corner]) -> float:
    """Mean squared error in units of the covariance: 3 is honest."""
    off = [(c.xyz_mm - APEX, c.covariance_mm2) for c in corners.values()]
    return float(np.mean([error @ np.linalg.solve(covariance, error) for error, covariance in off]))


def test_scans_of_a_square_jig_hold_right_angles() -> None:
    free, held, angles = of_set(40, (90.0, 90.0, 90.0), 1)
    assert angles.held == "jig"
    assert rms_mm(held) < 0.9 * rms_mm(free)
    assert 2.0 < squared(held) < 4.0
    assert all(corner.quality.rigid for corner in held.values())


@pytest.mark.parametrize("certified", [False, True])
def test_scans_of_a_jig_out_of_square_tell_its_angles(certified: bool) -> None:
    """The three angles come out in the order round the corner, whichever face each scan begins with."""
    free, held, angles = of_set(40, SKEW, 4, Jig(certified=certified))
    assert angles.held == "scans"
    assert angles.angles_deg is not None
    ways = [np.roll(order, turn) for order in (SKEW, SKEW[::-1]) for turn in range(3)]
    off = min(np.abs((np.array(angles.angles_deg) - way) / angles.sigmas_deg).max() for way in ways)
    assert off < 4
    assert max(angles.sigmas_deg) < 0.015
    assert rms_mm(held) < 0.9 * rms_mm(free)
    assert 2.0 < squared(held) < 4.0
    doubts = next(iter(held.values())).quality.doubts()
    assert any("contradict the certified face_angles_deg" in doubt for doubt in doubts) == certified


def test_single_scans_are_honest_whether_the_jig_is_square_or_not() -> None:
    rng = np.random.default_rng(3)
    for angles in ((90.0, 90.0, 90.0), (90.02, 89.97, 90.01), SKEW):
        held = {str(k): with_common_angles({"": measured(angles, rng)}, Jig())[0][""] for k in range(80)}
        assert 1.9 < squared(held) < 4.2


def test_angles_are_the_same_however_often_they_are_told() -> None:
    _, held, angles = of_set(12, SKEW, 4)
    again, same = with_common_angles(held, Jig())
    assert same == angles
    for name, corner in held.items():
        np.testing.assert_array_equal(again[name].xyz_mm, corner.xyz_mm)


def test_an_error_that_all_scans_share_does_not_make_a_square_jig_look_unsquare() -> None:
    """A fifth of a scan's own sigma does not average out over 100 scans: twice what they would scatter by chance."""
    rng = np.random.default_rng(5)
    unsquare = 0
    for _ in range(5):
        shared = 4e-5 * np.tile([0.0, 1.0, 0.0], 3)
        _, angles = with_common_angles({str(k): measured((90.0, 90.0, 90.0), rng, shared) for k in range(100)}, Jig())
        unsquare += angles.held == "scans"
    assert unsquare == 0


def test_one_scan_that_is_far_off_is_left_free_and_named() -> None:
    rng = np.random.default_rng(6)
    corners = {f"p{k}": measured((90.0, 90.0, 90.0), rng) for k in range(20)}
    corners["p7"] = measured((90.9, 89.2, 90.6), rng)
    held, angles = with_common_angles(corners, Jig())
    assert angles.outlying == ("p7",)
    assert angles.held == "jig"
    np.testing.assert_array_equal(held["p7"].xyz_mm, corners["p7"].xyz_mm)
    assert not held["p7"].quality.rigid


@pytest.mark.parametrize("given_deg", [(88.0, 91.0, 90.5), SKEW, SKEW[::-1]])
def test_given_angles_that_differ_are_held_in_their_order(given_deg: tuple[float, float, float]) -> None:
    """Even where single scans cannot tell which angle is which."""
    jig = Jig(face_angles_deg=given_deg)
    free, held, angles = of_set(30, given_deg, 7, jig)
    assert angles.held == "jig"
    assert rms_mm(held) < 0.9 * rms_mm(free)
    assert 1.8 < squared(held) < 4.2
