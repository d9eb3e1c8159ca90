"""Simulated scans obey the noise model that they declare, lie on the jig that they claim, and return from a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.errors import CornerError, ScanError
from calib.jig import Jig, jig_geometry
from calib.simulation.scanner import FLYING, ScanModel, SimulatedScan, simulate_scan

APEXES_MM = (
    (-73.7, 42.9, 661.4),
    (105.4, 46.9, 689.9),
    (134.8, -16.4, 748.8),
    (-93.4, 21.3, 593.5),
)  # Jang, Table 1


def placed(apex_mm: tuple[float, ...], tilt_deg: float = 8.0, turn_deg: float = 25.0) -> NDArray:
    """scanner_T_jig with the jig's axis `tilt_deg` from the line of sight."""
    sight = np.array(apex_mm) / np.linalg.norm(apex_mm)
    facing, _ = Rotation.align_vectors([sight], [[0.0, 0.0, 1.0]])
    out = np.eye(4)
    out[:3, :3] = (facing * Rotation.from_euler("xz", [tilt_deg, turn_deg], degrees=True)).as_matrix()
    out[:3, 3] = apex_mm
    return out


def scan(apex_mm: tuple[float, ...] = APEXES_MM[0], seed: int = 5, jig: Jig | None = None, **model) -> SimulatedScan:
    return simulate_scan(
        placed(apex_mm), jig or Jig(), rng=np.random.default_rng(seed), model=replace(ScanModel(), **model)
    )


def range_errors(simulated: SimulatedScan, face: int) -> tuple[NDArray, NDArray]:
    """Errors along the ray (K,) of the points of a face against its true plane, and their declared sigmas (K,)."""
    points_mm = simulated.scan.points_mm[simulated.label == face]
    normal = simulated.normals[face - 1]
    distance_mm = np.linalg.norm(points_mm, axis=1)
    true_mm = (simulated.apex_mm @ normal) / ((points_mm / distance_mm[:, None]) @ normal)
    return distance_mm - true_mm, simulated.noise_sigma_mm[simulated.label == face]


def fitted_planes(simulated: SimulatedScan) -> tuple[NDArray, NDArray]:
    """Least-squares planes of the three faces by the true labels: normals (3, 3) to the scanner, offsets (3,)."""
    normals, offsets = [], []
    for face in (1, 2, 3):
        points_mm = simulated.scan.points_mm[simulated.label == face]
        centre = points_mm.mean(axis=0)
        normal = np.linalg.svd(points_mm - centre, full_matrices=False)[2][2]
        normal *= -np.sign(normal @ centre)
        normals.append(normal)
        offsets.append(normal @ centre)
    return np.array(normals), np.array(offsets)


def test_impossible_corner_is_refused() -> None:
    with pytest.raises(CornerError, match="no corner has faces at"):
        jig_geometry(Jig(face_angles_deg=(20.0, 20.0, 20.0)))


@pytest.mark.slow
@pytest.mark.parametrize("apex_mm", APEXES_MM)
def test_face_points_scatter_as_declared(apex_mm: tuple[float, ...]) -> None:
    simulated = scan(apex_mm)
    for face in (1, 2, 3):
        error_mm, sigma_mm = range_errors(simulated, face)
        n = len(error_mm)
        assert n > 250
        z = error_mm / sigma_mm
        assert abs(z.mean()) < 4.0 / np.sqrt(n)
        assert abs(z.std() - 1.0) < 4.0 / np.sqrt(2 * n)
        points_mm = simulated.scan.points_mm[simulated.label == face]
        cosine = -(points_mm @ simulated.normals[face - 1]) / np.linalg.norm(points_mm, axis=1)
        np.testing.assert_allclose(sigma_mm, 0.02 * (0.5 + 0.5 / cosine**2), rtol=1e-3)


@pytest.mark.slow
def test_without_noise_the_points_are_on_the_faces() -> None:
    simulated = scan(scan_sigma_mm=0.0)
    for face in (1, 2, 3):
        error_mm, _ = range_errors(simulated, face)
        assert np.abs(error_mm).max() < 1e-9


@pytest.mark.parametrize("jig", [Jig(), Jig(convex=False), Jig(edge_mm=40.0), Jig(face_angles_deg=(90.4, 89.7, 90.0))])
def test_three_planes_meet_in_the_true_apex(jig: Jig) -> None:
    simulated = scan(APEXES_MM[1], jig=jig, points=50_000)
    normals, offsets = fitted_planes(simulated)
    assert np.linalg.norm(np.linalg.solve(normals, offsets) - simulated.apex_mm) < 0.03
    np.testing.assert_allclose(normals, simulated.normals, atol=3e-4)


@pytest.mark.parametrize("points", [8_000, 12_000, 200_000])
def test_resolution_gives_the_wanted_number_of_points(points: int) -> None:
    assert len(scan(points=points).scan.points_mm) == pytest.approx(points, rel=0.06)


def test_flying_pixels_are_the_wanted_share_of_the_edges_and_lie_between() -> None:
    few, many, none = (scan(points=60_000, flying_share=share) for share in (0.35, 0.7, 0.0))
    counts = [np.sum(s.label == FLYING) for s in (few, many)]
    assert np.sum(none.label == FLYING) == 0
    assert counts[1] / counts[0] == pytest.approx(2.0, rel=0.1)
    flying_mm = few.scan.points_mm[few.label == FLYING]
    solid_mm = few.scan.points_mm[few.label != FLYING]
    assert flying_mm[:, 2].min() > solid_mm[:, 2].min() - 0.1
    assert flying_mm[:, 2].max() < solid_mm[:, 2].max() + 0.1
    off_face_mm = np.abs((flying_mm - few.apex_mm) @ few.normals.T).min(axis=1)
    assert np.median(off_face_mm) > 1.0


@pytest.mark.slow
def test_waviness_has_its_size_and_does_not_average_out() -> None:
    waves = {"scan_sigma_mm": 0.0, "correlated_sigma_mm": 0.1, "points": 50_000}
    short = [range_errors(scan(seed=s, correlation_length_mm=3.0, **waves), 1)[0] for s in range(6)]
    assert np.std(np.concatenate(short)) == pytest.approx(0.1, rel=0.12)
    long = [range_errors(scan(seed=s, correlation_length_mm=40.0, **waves), 1)[0] for s in range(6)]
    assert np.mean([np.std(e) for e in long]) < 0.04  # one face sees little of the wave's shape,
    assert np.max(np.abs([np.mean(e) for e in long])) > 0.05  # and moves with it as a whole


def test_seed_makes_the_scan() -> None:
    np.testing.assert_array_equal(scan(seed=5).scan.points_mm, scan(seed=5).scan.points_mm)
    first, other = scan(seed=5), scan(seed=6)
    assert first.scan.points_mm.shape != other.scan.points_mm.shape or np.any(
        first.scan.points_mm != other.scan.points_mm
    )


def test_jig_that_looks_away_or_stands_behind_is_refused() -> None:
    with pytest.raises(ScanError, match="does not see the jig"):
        simulate_scan(placed(APEXES_MM[0], tilt_deg=180.0), rng=np.random.default_rng(0))
    with pytest.raises(ScanError, match="100 mm or more"):
        simulate_scan(placed((0.0, 0.0, -500.0)), rng=np.random.default_rng(0))
