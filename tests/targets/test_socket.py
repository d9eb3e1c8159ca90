"""A touch probe's contacts: the centre over its Cramer-Rao bound, contacts that touched something else, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from calib.errors import TargetError
from calib.scans.scan import Scan
from calib.target_shapes import Socket
from calib.targets.protocol.finder import Wanted
from calib.targets.spheres.socket import find_socket

CENTRE, RADIUS, SIGMA = np.array([310.0, -45.0, 820.0]), 8.0, 0.004


def contacts(rng: np.random.Generator, count: int, cap_deg: float = 80.0) -> np.ndarray:
    """Contacts of a probe on a cap below its opening, with errors along the surface's normal."""
    polar = np.arccos(rng.uniform(np.cos(np.radians(cap_deg)), 1.0, count))
    around = rng.uniform(0, 2 * np.pi) + 2.4 * np.arange(count)
    way = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), -np.cos(polar)], axis=1)
    return CENTRE + way * (RADIUS + SIGMA * rng.standard_normal(count))[:, None]


def wanted(diameter_mm: float | None) -> Wanted:
    return Wanted(Socket(diameter_mm, SIGMA))


@pytest.mark.parametrize("diameter_mm", [2 * RADIUS, None])
@pytest.mark.parametrize("count", [8, 40])
def test_the_centre_is_at_its_bound(diameter_mm: float | None, count: int) -> None:
    rng = np.random.default_rng(count)
    ratios, squares = [], []
    for _ in range(60):
        points = contacts(rng, count)
        found = find_socket(Scan("s", points), wanted(diameter_mm))[0]
        way = points - CENTRE
        rows = way / np.linalg.norm(way, axis=1)[:, None]
        rows = rows if diameter_mm else np.c_[rows, np.ones(count)]
        bound = SIGMA**2 * np.linalg.inv(rows.T @ rows)[:3, :3]
        error = found.xyz_mm - CENTRE
        ratios.append(error @ error / np.trace(bound))
        squares.append(error @ np.linalg.solve(found.covariance_mm2, error))
    assert np.sqrt(np.mean(ratios)) < 1.2
    assert 1.8 < np.mean(squares) < 4.5


def test_a_contact_that_touched_the_rim_is_left_out() -> None:
    points = contacts(np.random.default_rng(1), 12)
    points[5] += [0.0, 0.3, 0.4]
    found = find_socket(Scan("s", points), wanted(2 * RADIUS))[0]
    assert found.points == 11
    assert "1 of 12 contacts" in found.doubts[0]
    assert np.linalg.norm(found.xyz_mm - CENTRE) < 0.02


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (contacts(np.random.default_rng(2), 3), "holds 3 contacts"),
        (contacts(np.random.default_rng(3), 12) * [1, 1, 1.05], "lie on one sphere|scatter"),
        (np.random.default_rng(4).uniform(0, 20, (30, 3)), "lie on one sphere|scatter"),
        (contacts(np.random.default_rng(5), 12, 0.05), "open in one direction|lie on one sphere"),
    ],
)
def test_contacts_that_tell_no_sphere_are_refused(points: np.ndarray, reason: str) -> None:
    with pytest.raises(TargetError, match=reason):
        find_socket(Scan("s", points), wanted(2 * RADIUS))
