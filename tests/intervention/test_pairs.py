"""Paired poses: which poses were measured at one place, and what changed between them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array
from calib.dataset.dataset import Dataset, Points, Poses
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset.further_columns import FurtherColumns
from calib.intervention.pairs import Change, find_pairs
from tests.support.changed import with_poses

SHARED = Path(__file__).parents[3] / "shared" / "data"


def dataset(q_deg: Array, **conditions: object) -> Dataset:
    count = len(q_deg)
    poses = Poses(
        ids=tuple(f"p{i}" for i in range(count)),
        role=np.array(["reference", *["train"] * (count - 1)], dtype="<U9"),
        q=np.radians(q_deg),
        setup=np.full(count, ""),
        scan_names=tuple(f"{i}.ply" for i in range(count)),
    )
    points = Points(np.arange(count), np.zeros((count, 3)), np.full(count, "jig"))
    return Dataset("pairs", builtin_robot("rb5"), replace(poses, **conditions), points)


def places(count: int, *, visits: int) -> Array:
    rng = np.random.default_rng(0)
    return np.tile(rng.uniform(-90.0, 90.0, (count, 6)), (visits, 1))


def test_a_load_hung_on_at_some_places_makes_pairs_of_these_and_singles_of_the_others() -> None:
    q = np.concatenate([places(5, visits=1), places(5, visits=1)[:3] + 0.04])
    (found,) = find_pairs(dataset(q, payload_kg=np.array([0.0] * 5 + [2.5] * 3)))
    assert found.conditions == ("payload_kg",)
    assert [(pair.first, pair.second) for pair in found.pairs] == [(0, 5), (1, 6), (2, 7)]
    assert found.pairs[0].changes == (Change("payload_kg", 0.0, 2.5),)
    assert found.levels == (0.0, 2.5)


def test_joints_that_differ_by_more_are_no_pair() -> None:
    q = places(4, visits=2)
    q[4:, 2] += 0.06
    assert find_pairs(dataset(q, payload_kg=np.repeat([0.0, 2.0], 4))) == ()


def test_several_loads_at_one_place_are_a_chain_in_the_order_of_the_loads() -> None:
    loads = np.repeat([2.5, 0.0, 1.25], 4)
    (found,) = find_pairs(dataset(places(4, visits=3), payload_kg=loads))
    assert len(found.pairs) == 8
    assert [loads[[pair.first, pair.second]].tolist() for pair in found.pairs[:2]] == [[0.0, 1.25], [1.25, 2.5]]


def test_each_condition_is_held_against_its_own_pairs() -> None:
    """Load and side of approach changed one at a time: two kinds of pairs, and the change of each says which joint."""
    side = np.ones((12, 6))
    side[8:, 3] = -1.0
    made = dataset(places(4, visits=3), payload_kg=np.repeat([0.0, 2.0, 0.0], 4), approach=side)
    by_condition = {found.conditions: found for found in find_pairs(made)}
    assert set(by_condition) == {("payload_kg",), ("approach",)}
    assert {pair.changes for pair in by_condition["approach",].pairs} == {(Change("approach4", -1.0, 1.0),)}
    assert len(by_condition["payload_kg",].pairs) == 4


def test_conditions_that_never_differ_alone_are_named_together() -> None:
    warm = np.repeat([20.0, 26.0], 4) + np.linspace(0.0, 0.5, 8)
    made = dataset(places(4, visits=2), payload_kg=np.repeat([0.0, 2.0], 4), temperature_c=warm)
    (found,) = find_pairs(made)
    assert found.conditions == ("payload_kg", "temperature_c")
    slightly = with_poses(made, temperature_c=20.0 + 0.1 * np.arange(8))
    assert find_pairs(slightly)[0].conditions == ("payload_kg",), "no temperature that changes a length"


@pytest.mark.parametrize(
    ("conditions", "name"),
    [
        ({"setup": np.repeat(["a", "b"], 4)}, "setup"),
        ({"time_s": np.arange(8.0)}, "time_s"),
        ({}, "time_s"),
        ({"extra": FurtherColumns({"speed": np.repeat([10.0, 100.0], 4)})}, "speed"),
        ({"extra": FurtherColumns({"temperature_elbow_c": np.repeat([20.0, 30.0], 4)})}, "temperature_elbow_c"),
    ],
)
def test_further_conditions(conditions: dict[str, object], name: str) -> None:
    (found,) = find_pairs(dataset(places(4, visits=2), **conditions))
    assert found.conditions == (name,)
    assert len(found.pairs) == 4


def test_a_target_that_was_exchanged() -> None:
    made = dataset(places(4, visits=2))
    exchanged = replace(made.points, target=np.repeat(["jig", "ball"], 4))
    (found,) = find_pairs(replace(made, points=exchanged))
    assert found.conditions == ("target",)


def test_a_place_with_a_test_pose_is_held_out() -> None:
    made = dataset(places(4, visits=2), payload_kg=np.repeat([0.0, 2.0], 4))
    role = made.poses.role.copy()
    role[7] = "test"
    (found,) = find_pairs(with_poses(made, role=role))
    assert found.poses[found.is_held_out].tolist() == [3, 7]


@pytest.mark.skipif(not SHARED.is_dir(), reason="real recordings are not here")
def test_real_recordings_without_a_changed_condition_have_repeats_alone() -> None:
    for folder in sorted(path for path in SHARED.iterdir() if path.is_dir()):
        kinds = {found.conditions for found in find_pairs(load_dataset(folder))}
        assert kinds <= {("time_s",), ("setup",)}, folder.name
