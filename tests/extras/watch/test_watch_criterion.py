"""Check poses: what they show, against sizes that MuJoCo's own points give, and against poses at random."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate
from calib.array_types import IndexArray
from calib.extras.watch.plugin import CHECK_POSES
from calib.extras.watch.watch import watch
from calib.extras.watch.watch_criterion import CheckedChange, CheckOutcome, ForWatch, check_poses, usual_changes
from calib.fitting.observations import conditions_at
from calib.kinematics.joint_range import random_poses
from calib.planning.plan import plan_poses
from calib.planning.start import FromFit
from calib.planning.unknowns import unknowns_of_fit
from tests.support.checked_cell import Cell

Planned = tuple[Cell, np.ndarray, tuple[CheckedChange, ...], IndexArray]


@pytest.fixture(scope="module")
def planned() -> Planned:
    rng = np.random.default_rng(2)
    cell = Cell.drawn(rng)
    base = calibrate(cell.measured(rng, 64, "base"))
    q = random_poses(cell.nominal, 150, rng=rng)
    poses, unknowns = conditions_at(base.dataset.poses, q), unknowns_of_fit(base)
    changes = usual_changes(unknowns, poses, unknowns.rows(poses))
    return cell, q, changes, check_poses(changes, CHECK_POSES)


def test_planned_poses_show_each_change_at_smaller_sizes_than_random_ones(planned: Planned) -> None:
    _, q, changes, chosen = planned
    rng = np.random.default_rng(0)
    for change in changes:
        some = [change.size(rng.choice(len(q), CHECK_POSES, replace=False)) for _ in range(20)]
        assert change.size(chosen) < np.median(some)
    gains = [
        np.median([k.size(rng.choice(len(q), 8, replace=False)) for _ in range(20)]) / k.size(chosen) for k in changes
    ]
    assert np.mean(gains) > 1.15


def test_the_sizes_that_a_plan_promises_are_found(planned: Planned) -> None:
    cell, q, _, chosen = planned
    rng = np.random.default_rng(5)
    base = calibrate(cell.measured(rng, 64, "base"))
    offered = conditions_at(base.dataset.poses, q[chosen])
    of_plan = plan_poses(FromFit(base), 8, criterion=ForWatch(), candidates=offered)
    outcome = of_plan.outcome
    assert isinstance(outcome, CheckOutcome)
    sizes = {change.joint: change.size for change in outcome.changes}
    assert sizes[1] is None  # a turn of the scanner is the same
    assert sizes[6] is None or sizes[6] > np.radians(5.0)  # the target is on the last axis
    for joint in (2, 3, 5):
        size = sizes[joint]
        assert size is not None
        slipped = cell.with_changes({f"theta{joint}": size})
        seen = [watch(base, slipped.measured(rng, q=of_plan.poses.q)).verdict for _ in range(6)]
        assert seen.count("unchanged") <= 1, joint
        smaller = cell.with_changes({f"theta{joint}": 0.3 * size})
        seen = [watch(base, smaller.measured(rng, q=of_plan.poses.q)).verdict for _ in range(3)]
        assert seen.count("unchanged") >= 1, joint
