"""Correlated errors that a scan shows: the likelihood, the kernels, and a wall behind the jig."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from calib.corners.correlated_noise import posterior
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.correlated_noise.likelihood import LENGTHS, ROUGH_FROM, SHAPES, evidence_of, gaussian_kernels
from calib.corners.correlated_noise.patches import PatchPlaces
from calib.corners.intersection import Corner
from calib.corners.refinement import refine
from calib.corners.search import find_corner
from calib.jig import Jig, jig_geometry
from calib.planes.clustering import PlaneGroup
from calib.scans.scan import Scan
from tests.support.joined_views import joined, one_per_cell
from tests.support.scan_scene import make_scene
from tests.support.smooth_fields import smooth_field

APEX = np.array([15.0, -10.0, 650.0])
WALL_MM = 950.0
WHITE_MM = 0.02
UNTURNED = np.eye(3)


def cloud(
    seed: int, smooth_mm: float, length_mm: float, wall: bool, bent_mm: float, kernel: str
) -> tuple[np.ndarray, list[PlaneGroup]]:
    """Points of a jig of 60 mm, 600 a face, before a wall 160 mm wide that may itself be bent, and their planes."""
    rng = np.random.default_rng(seed)
    edges, normals = jig_geometry(Jig())
    share = rng.uniform(0, 1, (3, 600, 2))
    share = np.where(share.sum(axis=2, keepdims=True) > 1, 1 - share, share)
    xyz = APEX + np.concatenate([share[i] @ edges[[(i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    groups = [PlaneGroup(np.zeros(1, dtype=np.int64), APEX, n, float(n @ APEX)) for n in normals]
    surface = np.repeat(normals, 600, axis=0)
    if wall:
        on = np.column_stack([rng.uniform(-80, 80, (4000, 2)) * WALL_MM / 650, np.full(4000, WALL_MM)])
        on[:, 2] += bent_mm * (on[:, 0] / 80) ** 2
        xyz, surface = np.vstack([xyz, on]), np.vstack([surface, np.tile([0, 0, -1.0], (4000, 1))])
        groups.append(PlaneGroup(np.zeros(50, dtype=np.int64), on[0], np.array([0, 0, -1.0]), -WALL_MM))
    rays = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    along = smooth_mm * smooth_field(xyz[:, :2] / xyz[:, 2:] * 650, length_mm, rng, kernel)
    white = surface * WHITE_MM * rng.standard_normal((len(xyz), 1))
    return xyz + rays * along[:, None] + white, groups


def corner(
    seed: int,
    *,
    smooth_mm: float = 0.0,
    length_mm: float = 60.0,
    wall: bool = True,
    bent_mm: float = 0.0,
    kernel: str = "gaussian",
    declared: DeclaredNoise = NOTHING_DECLARED,
    turn: np.ndarray = UNTURNED,
) -> Corner:
    """Corner of the jig in `cloud`, turned about the scanner."""
    xyz, groups = cloud(seed, smooth_mm, length_mm, wall, bent_mm, kernel)
    turned = [PlaneGroup(g.sets, turn @ g.centre_mm, turn @ g.normal, g.offset_mm) for g in groups]
    return refine(
        xyz @ turn.T, turned, (0, 1, 2), Jig(), Jig().outlines()[0], WHITE_MM,
        declared, WHITE_MM,
    )  # fmt: skip


def squared(found: Corner) -> float:
    error = found.xyz_mm - APEX
    return float(error @ np.linalg.solve(found.covariance_mm2, error))


def test_gaussian_kernels_make_an_exponential_one() -> None:
    """Kernels of points, not patches: exp(-r / l) as closely as steps of sqrt(2) in length allow."""
    places = PatchPlaces(np.column_stack([np.geomspace(2, 100, 12), np.zeros(12)]), np.zeros((12, 2, 2)))
    r = np.abs(places.centres_mm[:, None, 0] - places.centres_mm[:, 0])
    kernels = gaussian_kernels(places, 60 * LENGTHS)
    np.testing.assert_allclose(kernels[5], np.exp(-(r**2) / 2 / (60 * LENGTHS[5]) ** 2), atol=1e-12)
    for number in range(2, 6):
        rough = np.einsum("l,lij->ij", SHAPES[len(LENGTHS) + number], kernels)
        np.testing.assert_allclose(rough, np.exp(-r / (60 * LENGTHS[ROUGH_FROM + number])), atol=0.05)


def test_the_likelihood_is_that_of_the_contrasts() -> None:
    """Compared with scipy's normal density of an orthonormal basis of contrasts."""
    rng = np.random.default_rng(0)
    places = PatchPlaces(rng.uniform(0, 50, (18, 2)), np.tile(3 * np.eye(2), (18, 1, 1)))
    design = np.column_stack([np.ones(18), places.centres_mm])
    variance, mean = rng.uniform(0.5, 2, 18), 2 * rng.standard_normal(18)
    sizes = np.array([0.1, 1.0, 3.0])
    kernels = gaussian_kernels(places, 60 * LENGTHS)
    ours = evidence_of(mean, variance, design, kernels, sizes).log_likelihood
    root = np.sqrt(variance)
    free = np.linalg.svd(design / root[:, None])[0][:, 3:]
    values = free.T @ (mean / root)
    white = multivariate_normal(cov=np.eye(15)).logpdf(values)
    for shape in (0, 7, 20):
        kernel = np.einsum("l,lij->ij", SHAPES[shape], kernels) / np.outer(root, root)
        for column, size in enumerate(sizes):
            density = multivariate_normal(cov=np.eye(15) + size**2 * free.T @ kernel @ free).logpdf(values)
            assert ours[shape, column] == pytest.approx(density - white, abs=1e-6)


@pytest.mark.slow
def test_a_wall_shows_waves_as_long_as_the_jig() -> None:
    """An honest covariance gives 3. The faces alone show nothing of such errors, and their covariance is too small."""
    seeds = range(16)
    beside = np.mean([squared(corner(seed, smooth_mm=0.03)) for seed in seeds])
    alone = np.mean([squared(corner(seed, smooth_mm=0.03, wall=False)) for seed in seeds])
    assert 1.5 < beside < 6.0
    assert alone > 2.5 * beside


@pytest.mark.slow
@pytest.mark.parametrize("bent_mm", [0.05, 0.5])
def test_a_wall_that_is_bowed_by_itself_is_not_taken_for_the_scanner(bent_mm: float) -> None:
    found = [corner(seed, bent_mm=bent_mm).quality.smooth_factor for seed in range(6)]
    assert np.median(found) < 1.3


def test_what_is_declared_of_the_scanner_is_the_least_that_a_corner_has() -> None:
    """A declared shift of 0.03 mm along the sight, over 60 mm, counts at the apex whether the scan shows it or not."""
    declared = DeclaredNoise(0.03, 60.0)
    for smooth_mm in (0.0, 0.1):
        bare = corner(3, smooth_mm=smooth_mm, wall=False).free
        held = corner(3, smooth_mm=smooth_mm, wall=False, declared=declared).free
        assert held.sigma_mm() == pytest.approx(max(bare.sigma_mm(), 0.03), rel=0.25)
        assert np.linalg.norm(held.xyz_mm - bare.xyz_mm) < held.sigma_mm()
    along = APEX / np.linalg.norm(APEX)
    assert along @ held.covariance_mm2 @ along > 0.5 * np.trace(held.covariance_mm2)


@pytest.mark.thorough
@pytest.mark.parametrize("kernel", ["gaussian", "exponential"])
def test_points_that_share_their_errors_count_less(kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighed by their covariance the points give a better corner than by equal weights, and an honest covariance."""

    def corners() -> list[Corner]:
        return [corner(seed, smooth_mm=0.05, length_mm=15.0, kernel=kernel) for seed in range(24)]

    found = corners()
    monkeypatch.setattr(posterior, "_FOUND", 2.0)  # no probability reaches it
    error, equal = (np.sqrt(np.mean([np.sum((one.xyz_mm - APEX) ** 2) for one in each])) for each in (found, corners()))
    assert error < 0.85 * equal
    assert 1.5 < np.mean([squared(one) for one in found]) < 5.0


def test_a_scan_turned_about_the_scanner_turns_its_corner() -> None:
    """Errors that neighbours share are weighed in the scanner's image, which turns with the scan."""
    turn = Rotation.from_rotvec([0.1, -0.2, 0.5]).as_matrix()
    first = corner(2, smooth_mm=0.05, length_mm=20.0)
    second = corner(2, smooth_mm=0.05, length_mm=20.0, turn=turn)
    assert first.quality.smooth_factor > 2
    # The wall's patches are squares along the image's axes, so what it shows of the noise differs a little.
    np.testing.assert_allclose(second.xyz_mm, turn @ first.xyz_mm, atol=0.1 * first.sigma_mm())
    covariance = turn @ first.covariance_mm2 @ turn.T
    np.testing.assert_allclose(second.covariance_mm2, covariance, atol=0.1 * first.sigma_mm() ** 2)


def test_what_would_show_more_is_said() -> None:
    short = corner(6, smooth_mm=0.04, length_mm=8.0).quality
    assert "only repeats with the jig moved in the view show what is smoother than" in " ".join(short.doubts())
    assert short.smooth_shown_mm > 100
    alone = corner(6, smooth_mm=0.04, length_mm=8.0, wall=False).quality
    assert alone.smooth_shown_mm < 70 < short.smooth_shown_mm
    long = corner(6, smooth_mm=0.04, length_mm=25.0, wall=False).quality
    assert "the shape of a face" in " ".join(long.doubts())


def test_errors_shared_by_neighbours_ask_how_views_were_joined() -> None:
    def asks(found: Corner) -> bool:
        return "neighbouring points share their errors" in " ".join(found.quality.doubts())

    assert asks(corner(0, smooth_mm=0.02, length_mm=2.0))
    assert not asks(corner(0, smooth_mm=0.02, length_mm=2.0, declared=DeclaredNoise(0.02, 2.0)))
    assert not asks(corner(0))


@pytest.mark.parametrize(("seed", "views", "kept"), [(0, 2, 1.0), (5, 3, 0.4)])
def test_joined_views_of_undeclared_registration_are_noticed(seed: int, views: int, kept: float) -> None:
    """Points of two cameras' grids come nearer to each other than those of one; by how much these differ counts."""
    rng = np.random.default_rng(seed)
    points, apex_mm = joined(rng, views, 0.03)
    found = find_corner(Scan("joined", points[rng.random(len(points)) < kept]), Jig(), scan_sigma_mm=0.02).corner
    single = find_corner(make_scene(rng).scan, Jig(), scan_sigma_mm=0.02).corner
    assert any("several views that were joined" in doubt for doubt in found.quality.doubts())
    assert not any("joined" in doubt for doubt in single.quality.doubts())
    error = found.xyz_mm - apex_mm
    assert error @ np.linalg.solve(found.covariance_mm2, error) < 12


@pytest.mark.parametrize("cell_mm", [1.5, 2.5])
def test_means_over_cells_hide_how_views_were_joined(cell_mm: float) -> None:
    """They would leave a covariance that the error exceeds 1000 times, without a word."""
    points, apex_mm = joined(np.random.default_rng(9), 2, 0.03, rays=20_000)
    means = one_per_cell(points, cell_mm)
    found = find_corner(Scan("means", means), Jig(), scan_sigma_mm=0.02).corner
    assert any("joined" in doubt for doubt in found.quality.doubts())
    error = found.xyz_mm - apex_mm
    assert error @ np.linalg.solve(found.covariance_mm2, error) < 12
