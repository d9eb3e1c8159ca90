"""Covariance of three planes under white and correlated noise, and the information that certified angles add."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners import refinement
from calib.corners.correlated_noise.plane_uncertainty import PlaneUncertainty
from calib.corners.intersection import Corner, intersect
from calib.corners.refinement import refine
from calib.errors import CornerError
from calib.jig import Jig, jig_geometry
from calib.planes.clustering import PlaneGroup

APEX = np.array([10.0, -20.0, 650.0])
NO_SETS = np.zeros(0, dtype=np.int64)


def waves(points: np.ndarray, length_mm: float, rng: np.random.Generator) -> np.ndarray:
    """Random field of variance 1 and correlation exp(-r^2 / 2 l^2) at points (N, 2), by random Fourier features."""
    turns = rng.standard_normal((2, 300)) / length_mm
    return np.sqrt(2 / 300) * np.cos(points @ turns + rng.uniform(0, 2 * np.pi, 300)).sum(axis=1)


def turned(rng: np.random.Generator, jig: Jig) -> tuple[np.ndarray, np.ndarray]:
    """Edge ends and face normals of the jig in some orientation that shows all faces."""
    turn = Rotation.from_euler("zx", [rng.uniform(0, 6.28), rng.uniform(0, 0.3)])
    edges, normals = jig_geometry(jig)
    return turn.apply(edges), turn.apply(normals)


def corner(
    rng: np.random.Generator,
    jig: Jig,
    *,
    told: Jig | None = None,
    white_mm: float = 0.02,
    smooth_mm: float = 0.0,
    length_mm: float = 15.0,
    points: int = 600,
) -> Corner:
    """The corner refined from points on a jig's three faces with white noise and a smooth error along the ray."""
    edges, normals = turned(rng, jig)
    share = rng.uniform(0, 1, (3, points, 2))
    share = np.where(share.sum(axis=2, keepdims=True) > 1, 1 - share, share)
    xyz = APEX + np.concatenate([share[i] @ edges[[(i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    rays = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    along = smooth_mm * waves(xyz[:, :2], length_mm, rng)
    white = np.repeat(normals, points, axis=0) * white_mm * rng.standard_normal((3 * points, 1))
    start = tuple(PlaneGroup(NO_SETS, APEX, n, float(n @ APEX)) for n in normals)
    return refine(
        xyz + rays * along[:, None] + white,
        start,
        (0, 1, 2),
        told or jig,
        jig.outlines()[0],
        white_mm,
        scan_sigma_mm=white_mm,
    )


def squared(found: Corner) -> float:
    error = found.xyz_mm - APEX
    return float(error @ np.linalg.solve(found.covariance_mm2, error))


@pytest.fixture(scope="module")
def free() -> list[Corner]:
    """Corners under white noise, one for each of the seeds 0, 1, ..."""
    return [corner(np.random.default_rng(seed), Jig()) for seed in range(50)]


@pytest.mark.slow
def test_white_noise_is_taken_for_white(free: list[Corner]) -> None:
    assert 2.1 < np.mean([squared(f) for f in free]) < 4.0  # ideal 3; the mean of 50 has a sigma of 0.35 itself
    assert np.median([f.quality.smooth_factor for f in free]) < 1.1


@pytest.mark.parametrize("length_mm", [5.0, 15.0])
@pytest.mark.thorough
def test_the_covariance_holds_under_a_smooth_error(length_mm: float) -> None:
    """Squared error over covariance within a factor of 2 of 3; points taken as independent give 20 and more."""
    scans = (np.random.default_rng(seed) for seed in range(24))
    found = [squared(corner(rng, Jig(), smooth_mm=0.02, length_mm=length_mm)) for rng in scans]
    assert 1.5 < np.mean(found) < 6.0


@pytest.mark.slow
def test_the_size_and_the_length_of_a_smooth_error_are_seen() -> None:
    found = [corner(np.random.default_rng(s), Jig(), smooth_mm=0.04, length_mm=8.0, points=1500) for s in range(6)]
    sizes = [f.quality.smooth_error_mm for f in found]
    lengths = [f.quality.smooth_length_mm for f in found]
    assert np.median(sizes) == pytest.approx(0.04, rel=0.4)
    assert np.median(lengths) == pytest.approx(8.0, rel=0.4)
    assert all("smooth over" in " ".join(f.quality.doubts()) for f in found)


@pytest.mark.slow
def test_plane_covariance_is_what_repeats_show(free: list[Corner]) -> None:
    """Height and slopes of the true planes over the fitted ones, compared with the covariance of each face."""
    found = []
    for seed, one in enumerate(free):
        _, normals = turned(np.random.default_rng(seed), Jig())
        for face, normal in zip(one.faces, normals, strict=True):
            off = np.array([normal @ (APEX - face.centre_mm), *(face.axes @ (face.normal - normal))])
            found.append(off @ np.linalg.solve(face.covariance, off))
    assert np.mean(found) == pytest.approx(3.0, abs=0.6)  # the mean of 150 has a sigma of 0.2 itself


@pytest.mark.thorough
@pytest.mark.parametrize("certified", [False, True])
def test_held_angles_gain_what_the_covariance_says(free: list[Corner], certified: bool) -> None:
    held = [corner(np.random.default_rng(s), Jig(certified=certified)) for s in range(len(free))]
    assert np.mean([r.quality.rigid for r in held]) > 0.9
    loose = [one.free for one in held if one.free is not None]
    gain = np.sqrt(
        np.sum([np.sum((r.xyz_mm - APEX) ** 2) for r in held]) / np.sum([np.sum((f.xyz_mm - APEX) ** 2) for f in loose])
    )
    said = np.sqrt(
        np.sum([np.trace(r.covariance_mm2) for r in held]) / np.sum([np.trace(f.covariance_mm2) for f in loose])
    )
    assert said < 0.85
    assert gain == pytest.approx(said, rel=0.2)
    assert 2.0 < np.mean([squared(r) for r in held]) < 3.9


def test_a_certified_jig_has_its_angles_to_the_bit() -> None:
    jig = Jig(face_angles_deg=(90.3, 89.6, 90.1), certified=True)
    found = corner(np.random.default_rng(1), jig, points=3000)
    normals = [face.normal for face in found.faces]
    angles = sorted(np.degrees(np.arccos(-normals[i] @ normals[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    np.testing.assert_allclose(angles, [89.6, 90.1, 90.3], atol=1e-7)
    offsets = np.array([face.offset_mm for face in found.faces])
    np.testing.assert_allclose(intersect(np.array(normals), offsets), found.xyz_mm, atol=1e-7)
    for face in found.faces:
        assert face.normal @ face.centre_mm == pytest.approx(face.offset_mm, abs=1e-7)


def test_a_wrong_certificate_is_not_believed() -> None:
    """Angles a tenth of a degree off the certified ones leave the planes as good as free, with the reason."""
    skew = Jig(face_angles_deg=(90.1, 90.0, 89.9))
    found = corner(np.random.default_rng(2), skew, told=Jig(certified=True), points=2000)
    assert np.linalg.norm(found.xyz_mm - found.free.xyz_mm) < 0.3 * found.sigma_mm()
    assert not found.quality.rigid
    assert any("contradicts the certified face_angles_deg" in doubt for doubt in found.quality.doubts())


def test_angles_too_alike_to_name_the_faces_are_held_as_far_as_they_are_known() -> None:
    jig = Jig(face_angles_deg=(90.02, 90.0, 89.98), certified=True)
    found = corner(np.random.default_rng(3), jig, points=200)
    assert found.quality.rigid
    assert found.sigma_mm() < 0.95 * found.free.sigma_mm()
    assert squared(found) < 12


def test_exact_points_have_no_uncertainty_to_speak_of() -> None:
    found = corner(np.random.default_rng(4), Jig(), white_mm=0.0)
    assert found.sigma_mm() < 1e-6
    assert np.isfinite(found.plane_covariance).all()


def test_the_joint_covariance_is_positive_and_its_blocks_are_the_faces() -> None:
    found = corner(np.random.default_rng(5), Jig(), smooth_mm=0.03)
    assert np.linalg.eigvalsh(found.plane_covariance)[0] > 0
    for i, face in enumerate(found.faces):
        np.testing.assert_array_equal(face.covariance, found.plane_covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3])


def test_faces_of_hardly_known_direction_are_no_corner(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without this check any three planes would do: a twisted cube's gave an apex a metre off, sigma six metres."""
    uncertainty = refinement.plane_uncertainty

    def hardly(*arguments: Any, **named: Any) -> PlaneUncertainty:
        known = uncertainty(*arguments, **named)
        turns = np.sqrt(np.linalg.eigvalsh(known.covariance[1:3, 1:3])[-1])
        return replace(known, covariance=known.covariance * (np.radians(5.0) / turns) ** 2)

    monkeypatch.setattr(refinement, "plane_uncertainty", hardly)
    for angle_deg in (80.0, 90.0):
        with pytest.raises(CornerError, match=r"its direction to \S+ deg only"):
            corner(np.random.default_rng(1), Jig(face_angles_deg=(angle_deg, 90.0, 90.0)), told=Jig())
