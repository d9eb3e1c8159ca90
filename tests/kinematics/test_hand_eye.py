"""A scanner on the flange and targets in the world, located by points alone: exact, wherever they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.kinematics.hand_eye import HandEye, solve_hand_eye
from tests.support.arms import random_transform


def _seen(
    rng: np.random.Generator, count: int, setups: int, targets: int, *, flat: bool = False
) -> tuple[HandEye, np.ndarray, np.ndarray, HandEye]:
    """The placement by exact points of flanges that stand anyhow, those flanges, the points, and the truth."""
    mounted = np.stack([random_transform(rng) for _ in range(setups)])
    places = rng.normal(size=(targets, 3)) * 1500.0
    setup, target = np.arange(count) % setups, rng.integers(0, targets, count)
    turns = Rotation.random(count, rng=rng)
    if flat:  # turns about z alone: the points seen lie in a plane
        turns = Rotation.from_rotvec(rng.uniform(-3.0, 3.0, (count, 1)) * [0.0, 0.0, 1.0])
    flange = np.tile(np.eye(4), (count, 1, 1))
    flange[:, :3, :3] = turns.as_matrix()
    flange[:, :3, 3] = rng.normal(size=(count, 3)) * 600.0 * [1.0, 1.0, not flat]
    base_T_scanner = flange @ mounted[setup]
    points = np.linalg.inv(base_T_scanner) @ np.concatenate([places[target], np.ones((count, 1))], axis=1)[..., None]
    points = points[:, :3, 0]
    names = np.array(["A", "B", "C"])[setup], np.array(["jig", "west"])[target]
    truth = HandEye(
        {"ABC"[k]: mounted[k] for k in range(setups)},
        {("jig", "west")[k]: places[k] for k in range(targets)},
        False,
        np.zeros((0, 3)),
    )
    return solve_hand_eye(flange, points, *names), flange, points, truth


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), setups=st.integers(1, 3), targets=st.integers(1, 2))
def test_any_mount_and_any_place_is_found_exactly(seed: int, setups: int, targets: int) -> None:
    found, _, _, truth = _seen(np.random.default_rng(seed), 8 * setups * targets, setups, targets)
    for name, flange_T_scanner in truth.flange_T_scanner.items():
        np.testing.assert_allclose(found.flange_T_scanner[name], flange_T_scanner, atol=1e-6)
    for name, position_mm in found.position_mm.items():
        np.testing.assert_allclose(position_mm, truth.position_mm[name], atol=1e-6)
    assert len(found.undetermined_shifts) == 0
    assert not found.undetermined_rotation


@pytest.mark.parametrize("seed", range(10))
def test_points_in_a_plane_place_the_scanner_too(seed: int) -> None:
    """There the nine numbers of a rotation are not told by a linear equation; along the axis one shift stays open."""
    found, flange, points, _ = _seen(np.random.default_rng(seed), 20, 1, 1, flat=True)
    seen = points @ found.flange_T_scanner["A"][:3, :3].T + found.flange_T_scanner["A"][:3, 3]
    base_mm = np.einsum("mij,mj->mi", flange[:, :3, :3], seen) + flange[:, :3, 3]
    np.testing.assert_allclose(base_mm, np.broadcast_to(found.position_mm["jig"], base_mm.shape), atol=1e-6)
    np.testing.assert_allclose(np.abs(found.undetermined_shifts), [[0.0, 0.0, 1.0]], atol=1e-9)
    assert not found.undetermined_rotation


def test_orientations_tell_what_points_at_one_place_do_not() -> None:
    """The scanner circles about the jig and sees it always at the same place: A X = Y B tells how it is mounted."""
    rng = np.random.default_rng(4)
    mounted, jig = random_transform(rng), random_transform(rng)
    flange = np.tile(np.eye(4), (12, 1, 1))
    flange[:, :3, :3] = Rotation.random(12, rng=rng).as_matrix()
    flange[:, :3, 3] = jig[:3, 3] - np.einsum("mij,j->mi", flange[:, :3, :3], [100.0, -50.0, 300.0])
    seen = np.linalg.inv(flange @ mounted) @ jig
    names = np.full(12, "A"), np.full(12, "jig")
    alone = solve_hand_eye(flange, seen[:, :3, 3], *names)
    assert alone.undetermined_rotation
    found = solve_hand_eye(flange, seen[:, :3, 3], *names, seen[:, :3, :3])
    assert not found.undetermined_rotation
    np.testing.assert_allclose(found.flange_T_scanner["A"], mounted, atol=1e-6)
    np.testing.assert_allclose(found.position_mm["jig"], jig[:3, 3], atol=1e-6)
