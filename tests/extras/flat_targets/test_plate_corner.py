"""A plate's corner in scans of the tests' own rays: found within its own covariance, refused where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.errors import TargetError
from calib.extras.flat_targets.plate_corner import find_plate_corner
from calib.scans.scan import Scan
from calib.target_shapes import Plate
from calib.targets.protocol.finder import FoundPoint, Wanted
from tests.support.flat_scene import FlatScan, placed
from tests.support.scan_scene import Patch


def plate(angle_deg: float = 90.0) -> list[Patch]:
    """Plate with a corner at the part's origin, one edge of 46 and one of 40 mm."""
    angle = np.radians(angle_deg)
    return [Patch(np.zeros(3), np.array([46.0, 0, 0]), 40.0 * np.array([np.cos(angle), np.sin(angle), 0.0]))]


def corner_of(scene: FlatScan, angle_deg: float = 90.0) -> FoundPoint:
    """Nearest of the plate's corners of that angle: a rectangle has four."""
    names = ("a", "b", "c", "d") if angle_deg == 90.0 else ("a", "b")
    found = find_plate_corner(scene.scan, Wanted(Plate(35.0, angle_deg), names, 0.02))
    return min(found, key=lambda place: float(np.linalg.norm(place.xyz_mm - scene.origin_mm)))


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [90.0, 70.0])
def test_the_corner_is_where_its_covariance_says(angle_deg: float) -> None:
    squares, heights = [], []
    for seed in range(5):
        scene = placed(np.random.default_rng(seed), plate(angle_deg), rays=20_000, others=2)
        found = corner_of(scene, angle_deg)
        error = found.xyz_mm - scene.origin_mm
        assert np.linalg.norm(error) < 1.5 * found.facts["points_apart_mm"]
        squares.append(error @ np.linalg.solve(found.covariance_mm2, error))
        heights.append((error @ scene.scanner_R_part[:, 2] / found.facts["height_sigma_mm"]) ** 2)
    assert 0.3 < np.mean(squares) < 7
    assert np.mean(heights) < 5  # across the plate it is known a hundred times better than along it


def test_four_corners_are_not_one() -> None:
    scene = placed(np.random.default_rng(1), plate(), rays=20_000, others=2)
    with pytest.raises(TargetError, match="more than 1 corners of 90 deg"):
        find_plate_corner(scene.scan, Wanted(Plate(35.0), scan_sigma_mm=0.02))


def test_a_round_plate_and_a_small_one_have_no_corner() -> None:
    disk = [Patch(np.zeros(3), np.array([40.0, 0, 0]), np.array([0.0, 40, 0]), "disk")]
    for pieces in (
        disk,
        [*disk, Patch(np.array([0.0, 60, -20]), np.array([15.0, 0, 0]), np.array([0.0, 15, 0]))],
    ):
        scene = placed(np.random.default_rng(2), pieces, rays=12_000, others=0)
        with pytest.raises(TargetError, match="none of which meet at 90 deg"):
            find_plate_corner(scene.scan, Wanted(Plate(60.0), scan_sigma_mm=0.02))


@pytest.mark.parametrize("seed", range(3))
def test_where_the_field_ends_is_no_corner_of_a_plate(seed: int) -> None:
    """A plate whose own corner is out of view, before a wall: its borders and the wall's are the rim of the scan."""
    plate_out_of_view = [Patch(np.array([-150.0, -20.0, 0.0]), np.array([600.0, 0, 0]), np.array([0.0, 600.0, 0]))]
    scene = placed(np.random.default_rng(seed), plate_out_of_view, rays=12_000, others=1)
    with pytest.raises(TargetError, match="none of which meet at 90 deg"):
        find_plate_corner(scene.scan, Wanted(Plate(35.0), ("a", "b", "c", "d"), 0.02))


@pytest.mark.parametrize(("jitter", "bend"), [(0.0, 0.0), (0.2, 0.0), (0.5, 0.0), (0.0, -0.1)])
def test_where_a_lone_wall_ends_is_no_corner_of_a_plate(jitter: float, bend: float) -> None:
    """Pixels off their rows by a share of their distance, and a lens that bends the rim; a real plate has a corner."""
    rng = np.random.default_rng(3)
    pixels = np.stack(np.meshgrid(*[(np.arange(110) + 0.5) / 110 - 0.5] * 2), axis=-1).reshape(-1, 2)
    pixels += jitter / 110 * rng.standard_normal(pixels.shape)
    pixels *= 1 + bend * np.sum(pixels**2, axis=1, keepdims=True)
    rays = np.column_stack([160 / 700 * pixels, np.ones(len(pixels))])
    wall = rays * (700 / (rays @ [0.2, -0.1, 1.0]) * (1 + 0.02 / 700 * rng.standard_normal(len(rays))))[:, None]
    with pytest.raises(TargetError, match="none of which meet at 90 deg"):
        find_plate_corner(Scan("wall", wall), Wanted(Plate(35.0), ("a", "b", "c", "d"), 0.02))
    turn = Rotation.from_euler("z", 25, degrees=True).as_matrix()[:2, :2]
    on = np.all((pixels @ turn > -0.15) & (pixels @ turn < 0.2), axis=1)  # a plate alone, askew to the rows
    if jitter < 0.5:
        found = find_plate_corner(Scan("plate", wall[on]), Wanted(Plate(35.0), ("a", "b", "c", "d"), 0.02))
        assert len(found) >= 1
