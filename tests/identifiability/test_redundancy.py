"""Park's groups and zero columns for both arms, the coefficients the paper prints, and the ranks."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import FitError
from calib.identifiability.redundancy import Redundancy, analyse, pearson_matrix
from calib.identifiability.structural import structural_rank
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot
from tests.support.arms import REFERENCE, jang_arm, park_arm

GROUPS = {  # Park section 3, with TCP for the paper's EE
    "rb5": {"a6 aTCP", "d2 d3 d4", "d6 dTCP", "theta1 beta1", "theta4 beta4", "theta5 beta5"},
    "panda": {"a7 aTCP", "d7 dTCP", "theta1 beta1", "theta2 beta2", "theta5 beta5"},
}
ZEROS = {
    "rb5": "alpha6 alphaTCP theta6 thetaTCP beta6 betaTCP",
    "panda": "alpha7 alphaTCP theta7 thetaTCP beta7 betaTCP",
}
KEPT = {"rb5": 28, "panda": 35}
RANK = {"rb5": 20, "panda": 24}


def analysed(robot: Robot, poses: int = 40, seed: int = 0) -> Redundancy:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (poses, robot.n_joints))
    columns = kinematics.target_jacobian(robot, q).reshape(3 * poses, -1)
    return analyse(columns, robot.parameter_names, robot.parameter_units)


def printed(name: str) -> tuple[list[str], NDArray[np.float64]]:
    with (REFERENCE / f"pearson_{name}.csv").open() as stream:
        header, *rows = list(csv.reader(stream))
    names = [label.replace("EE", "TCP") for label in header[1:]]
    return names, np.array([[float(v) for v in row[1:]] for row in rows])


@pytest.mark.parametrize("arm", ["rb5", "panda"])
@pytest.mark.parametrize("seed", range(3))
def test_parks_groups_zero_columns_and_counts(arm: str, seed: int) -> None:
    found = analysed(park_arm(arm), seed=seed)
    assert {" ".join(group) for group in found.groups} == GROUPS[arm]
    assert set(found.no_influence) == set(ZEROS[arm].split())
    assert len(found.kept) == KEPT[arm]
    assert found.rank == RANK[arm]
    assert len(found.independent) == found.rank


@pytest.mark.parametrize("arm", ["rb5", "panda"])
@pytest.mark.parametrize("kind", ["prismatic", "angular"])
def test_the_papers_matrix_where_it_does_not_hang_on_the_poses(arm: str, kind: str) -> None:
    """Entries that the paper prints as +-1, and its NaN, are ours too; only its own sign slips differ."""
    names, theirs = printed(f"{arm}_{kind}")
    ours = analysed(park_arm(arm), poses=400).to_frame().loc[list(names), list(names)].to_numpy()
    np.testing.assert_array_equal(np.isnan(ours), np.isnan(theirs))
    slips = np.argwhere(~np.isclose(theirs, theirs.T, atol=2e-3, equal_nan=True))
    exact = np.isclose(np.abs(theirs), 1.0)
    for i, j in slips:
        exact[i, j] = False
    np.testing.assert_allclose(ours[exact], theirs[exact], atol=1e-9)
    never_one = ~exact & ~np.isnan(theirs) & (np.abs(theirs) < 0.9)
    assert np.all(np.abs(ours[never_one]) < 1.0 - 1e-6)


def test_the_slips_of_the_printed_table_are_the_three_known_ones() -> None:
    names, table = printed("rb5_angular")
    slips = np.argwhere(np.triu(~np.isclose(table, table.T, atol=2e-3, equal_nan=True)))
    assert {f"{names[i]}-{names[j]}" for i, j in slips} == {"theta4-beta5", "beta1-beta4", "beta2-beta4"}


def test_pairs_across_units_and_dependences_of_three_are_named() -> None:
    rb5, panda = analysed(park_arm("rb5")), analysed(park_arm("panda"))
    assert {" ".join(group) for group in rb5.mixed_groups} == {"a5 theta5 beta5", "alpha5 d5"}
    assert {" ".join(group) for group in panda.mixed_groups} == {"a6 beta6", "alpha6 d6"}
    assert {" ".join(sorted(c)) for c in panda.combinations} == {
        "beta3 d4 theta3", "beta4 d5 theta4", "a6 d7 theta6",
    }  # fmt: skip


def test_a_named_combination_is_invisible() -> None:
    robot = park_arm("panda")
    rng = np.random.default_rng(9)
    q = rng.uniform(-np.pi, np.pi, (50, 7))
    jacobian = kinematics.target_jacobian(robot, q)
    for relation in analysed(robot).combinations:
        x = np.array([relation.get(name, 0.0) for name in robot.parameter_names])
        moved = jacobian @ x
        largest = max(np.abs(jacobian[..., i] * x[i]).max() for i in np.flatnonzero(x))
        assert np.abs(moved).max() < 1e-6 * largest


def test_every_parameter_is_either_independent_or_dropped_for_a_reason() -> None:
    for arm in ("rb5", "panda"):
        found = analysed(park_arm(arm))
        assert set(found.independent) | set(found.dropped) == set(found.parameters)
        assert not set(found.independent) & set(found.dropped)
        assert all(found.dropped.values())
    assert found.dropped["beta1"] == "acts like theta1"
    assert found.dropped["d4"] == "acts like theta3, beta3 together"


def test_combinations_come_in_lowest_form() -> None:
    relations = {frozenset(c): c for c in analysed(park_arm("panda")).combinations}
    # 82.5 mm between the axes of joints 3 and 4 (Park, Table 2): turning by x and lifting by 82.5 x cancel.
    assert relations[frozenset(("theta3", "beta3", "d4"))] == pytest.approx({"theta3": 1, "beta3": -1, "d4": 82.5})
    assert relations[frozenset(("a6", "theta6", "d7"))] == pytest.approx({"a6": 107, "theta6": -1, "d7": -88})


def test_what_is_kept_carries_all_the_information() -> None:
    for arm in ("rb5", "panda"):
        robot = park_arm(arm)
        found = analysed(robot)
        rng = np.random.default_rng(2)
        q = rng.uniform(-np.pi, np.pi, (40, robot.n_joints))
        columns = kinematics.target_jacobian(robot, q).reshape(120, -1)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1.0)
        for names in (found.kept, found.independent):
            chosen = columns[:, [robot.parameter_names.index(name) for name in names]]
            assert np.linalg.matrix_rank(chosen, tol=1e-9) == found.rank


@pytest.mark.parametrize(("robot", "rank"), [(park_arm("rb5"), 18), (park_arm("panda"), 22), (jang_arm(), 19)])
def test_what_distances_can_tell(robot: Robot, rank: int) -> None:
    assert structural_rank(robot) == rank


def test_pearson_is_symmetric_bounded_and_blind_to_scale() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(50, 6))
    r = pearson_matrix(columns)
    np.testing.assert_allclose(r, r.T)
    np.testing.assert_allclose(r, np.corrcoef(columns.T), atol=1e-12)
    scale = np.array([1, -1, 1e-6, 1e6, -3, 2.0])
    np.testing.assert_allclose(pearson_matrix(columns * scale), r * np.sign(np.outer(scale, scale)), atol=1e-9)


def test_words_name_the_sum_with_its_sign() -> None:
    words = analysed(park_arm("rb5")).summary()
    assert "θ4 and β4 are indistinguishable: only θ4 − β4 can be known; keep θ4." in words
    assert "only d2 + d3 + d4 can be known; keep d2" in words
    assert re.search(r"can be known \(rank\) +20\n", words)


def test_bad_input_is_one_clear_error() -> None:
    with pytest.raises(FitError, match="two rows"):
        analyse(np.zeros((1, 2)), ("a1", "d1"), ("mm", "mm"))
    with pytest.raises(FitError, match="not finite"):
        analyse(np.full((4, 2), np.nan), ("a1", "d1"), ("mm", "mm"))


def test_a_jacobian_of_zeros_knows_nothing() -> None:
    found = analyse(np.zeros((4, 2)), ("a1", "theta1"), ("mm", "rad"))
    assert found.rank == 0
    assert found.no_influence == ("a1", "theta1")
    assert found.groups == ()
