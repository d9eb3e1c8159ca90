"""Families with hundreds of members: all at once gives what one by one gives, and noise has no evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, screen
from calib.effects.catalogue import effects_for
from calib.effects.effect import Family
from calib.screening.evidence import FamilyColumns, evaluate_family, evidence_of
from calib.screening.member_columns import member_columns, visible_columns
from calib.screening.projected_residual import ProjectedResidual, project_residual
from calib.screening.sparse_evidence import RARITY, SparseColumns, evaluate_sparse
from tests.support.changed import with_xyz
from tests.support.fit_cases import rich_dataset

DATASET = rich_dataset()
SPARSE = [family for family in effects_for(DATASET) if family.sparse]


@pytest.fixture(scope="module")
def left() -> ProjectedResidual:
    return project_residual(calibrate(DATASET))


@pytest.mark.parametrize("family", SPARSE, ids=lambda family: family.name)
def test_columns_of_shapes_are_the_members_columns(family: Family, left: ProjectedResidual) -> None:
    shown = visible_columns(left, family)
    assert len(shown.groups) == len(family.members)
    for k in np.linspace(0, len(family.members) - 1, 7).astype(int):
        member = family.members[k]
        raw = member_columns(left, member) * [p.scale for p in member.parameters]
        visible = left.visible(raw)
        kept = np.linalg.norm(visible, axis=0) > 0.02 * np.linalg.norm(raw, axis=0)
        np.testing.assert_allclose(shown.groups[k], visible * kept, atol=1e-7 * np.abs(raw).max())


@pytest.mark.parametrize("width", [1, 2, 6])
def test_a_single_member_has_the_evidence_of_its_columns(width: int) -> None:
    rng = np.random.default_rng(width)
    columns = rng.normal(size=(120, width))
    residual = rng.normal(size=120) + columns @ np.full(width, 0.8)
    found = evaluate_sparse(SparseColumns(residual, columns[:, None], 110))
    assert found.log_evidence == pytest.approx(evidence_of(residual, columns, 110) - RARITY)
    slow = evaluate_family(FamilyColumns(residual, (columns,), 110))
    assert found.p_value == pytest.approx(slow.p_value, rel=1e-6)
    np.testing.assert_allclose(found.scales, slow.scales)
    np.testing.assert_allclose(found.coefficients[0], slow.coefficients[0], rtol=1e-9)
    np.testing.assert_allclose(found.explained, slow.explained, rtol=1e-9)


def test_two_of_many_members_are_chosen_as_one_by_one() -> None:
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(200, 60, 2))
    residual = rng.normal(size=200) + columns[:, 7] @ [1.0, -0.5] + columns[:, 31] @ [0.4, 0.6]
    found = evaluate_sparse(SparseColumns(residual, columns, 190))
    slow = evaluate_family(FamilyColumns(residual, tuple(np.moveaxis(columns, 1, 0)), 190))
    assert np.flatnonzero(found.scales).tolist() == np.flatnonzero(slow.scales).tolist() == [7, 31]
    np.testing.assert_allclose(found.scales, slow.scales)
    for fast, one_by_one in zip(found.coefficients, slow.coefficients, strict=True):
        np.testing.assert_allclose(fast, one_by_one, atol=1e-9)
    # Both pay for the choice: here the mean over all members for the first, there log 60 for each.
    assert found.log_evidence == pytest.approx(slow.log_evidence - 2.0 * RARITY, abs=0.1)


def test_shapes_that_make_up_one_cause_are_chosen_among_their_own() -> None:
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(200, 60, 1))
    residual = rng.normal(size=200) + columns[:, 7, 0] + columns[:, 8, 0]
    alone = SparseColumns(residual, columns, 190, shapes=rng.normal(size=(60, 50)), of_same=np.arange(60) // 3)
    apart, together = evaluate_sparse(alone), evaluate_sparse(replace(alone, superposed=True))
    assert np.flatnonzero(together.scales).tolist() == [7, 8]
    assert together.log_evidence == pytest.approx(apart.log_evidence + RARITY + np.log(60 / 3))


def test_noise_has_no_evidence_and_its_p_is_uniform_or_larger() -> None:
    rng = np.random.default_rng(5)
    steps = (np.arange(60)[:, None] >= np.arange(4, 57)).astype(float)
    found = [evaluate_sparse(SparseColumns(rng.normal(size=60), steps[:, :, None], 60)) for _ in range(300)]
    p = np.array([one.p_value for one in found])
    assert np.mean(p < 0.05) < 0.08
    assert np.mean(p < 0.01) < 0.03
    assert np.mean([one.log_evidence > 3.0 for one in found]) < 0.01


def steps_of_three_joints(poses: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (R, G, 1) of steps of three joints at each pose, their shapes (G, N), and the joint of each."""
    rng = np.random.default_rng(11)
    firsts = np.arange(4, poses - 3)
    steps = (np.arange(poses)[:, None] >= firsts).astype(float)
    displacements = rng.normal(size=(3 * poses, 3))
    columns = np.concatenate([displacements[:, [j]] * np.repeat(steps, 3, axis=0) for j in range(3)], axis=1)
    return columns[:, :, None], np.tile(steps.T, (3, 1)), np.repeat(np.arange(3), len(firsts))


def test_a_step_that_comes_back_is_found_as_two() -> None:
    columns, shapes, of_same = steps_of_three_joints()
    count = columns.shape[1] // 3
    there, back = count + 26, count + 33  # of the second joint, seven poses apart in the middle of the session
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(size=len(columns))
        residual = noise + 4.0 * (columns[:, there, 0] - columns[:, back, 0])
        family = SparseColumns(residual, columns, 180, most=3, shapes=shapes, of_same=of_same)
        found = evaluate_sparse(family)
        chosen = np.flatnonzero(found.scales)
        assert np.abs(chosen - [there, back]).max() <= 1
        assert found.p_value < 1e-4
        assert found.coefficients[chosen[0]][0] == pytest.approx(4.0, abs=1.2)
        assert found.coefficients[chosen[1]][0] == pytest.approx(-4.0, abs=1.2)


def test_noise_is_no_step_that_comes_back() -> None:
    columns, shapes, of_same = steps_of_three_joints()
    rng = np.random.default_rng(6)
    families = (SparseColumns(rng.normal(size=180), columns, 180, shapes=shapes, of_same=of_same) for _ in range(200))
    found = [evaluate_sparse(family) for family in families]
    assert np.mean([one.p_value < 0.05 for one in found]) < 0.08
    assert np.mean([one.log_evidence > 3.0 for one in found]) < 0.02


def test_steps_that_stand_together_have_poses_between_them() -> None:
    """A step and one back at the next pose are an error of that pose."""
    firsts = np.arange(4, 57)
    steps = (np.arange(60)[:, None] >= firsts).astype(float)
    shapes, of_same = np.concatenate([steps.T, steps.T]), np.repeat([0, 1], len(firsts))
    columns = np.concatenate([steps, 2.0 * steps], axis=1)[:, :, None]
    family = SparseColumns(np.zeros(60), columns, 60, shapes=shapes, of_same=of_same)
    apart = np.abs(firsts - firsts[20]) >= 4
    np.testing.assert_array_equal(family.distinct(20), np.append(apart, np.ones(len(firsts), dtype=bool)))


@pytest.mark.slow
def test_what_predicts_no_pose_that_is_left_out_has_no_evidence() -> None:
    """One pose is wrong by far: whatever of one place or pose reaches it explains it and predicts nothing."""
    xyz = DATASET.points.xyz_mm.copy()
    xyz[17] += [3.0, -3.0, 2.0]
    spoilt = with_xyz(DATASET, xyz)
    screening = screen(calibrate(spoilt), effects_for(spoilt))
    sparse = [c for c in screening.candidates if c.family.sparse]
    assert any(c.explained_share > 0.3 for c in sparse)
    assert all(c.log_evidence == 0.0 for c in sparse if c.cv_rmse_mm >= screening.cv_rmse_mm)
    assert max(c.log_evidence for c in sparse) < 3.0
