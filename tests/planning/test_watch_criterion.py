"""Check poses: what they show, against sizes that MuJoCo's own points give, and against poses at random."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from calib.array_types import IndexArray
from calib.calibration.calibrate import calibrate
from calib.fitting.observations import conditions_at
from calib.kinematics.joint_range import random_poses
from calib.monitoring.change_tests import DETECTABLE_Z
from calib.monitoring.watch import watch
from calib.planning.unknowns import unknowns_of_fit
from calib.planning.watch_criterion import CHECK_POSES, CheckedChange, check_poses, usual_changes
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


def test_the_usual_changes_and_which_of_them_a_moved_scanner_looks_like(planned: Planned) -> None:
    changes = planned[2]
    asked = {(k.model.what, k.model.joint): k.scanner_free for k in changes}
    assert asked == {
        ("joint_zero", 1): False,  # a turn of the scanner about the first axis is the same
        **{("joint_zero", j): True for j in (2, 3, 4, 5)},
        ("tool", None): True,
    }  # the RB5's target is on its last axis


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


@pytest.mark.slow
def test_the_size_that_is_told_is_found_as_often_as_promised(planned: Planned) -> None:
    cell, q, changes, chosen = planned
    rng = np.random.default_rng(5)
    base = calibrate(cell.measured(rng, 64, "base"))
    slip = next(k for k in changes if k.model.joint == 3)
    slipped = cell.with_changes({"theta3": slip.size(chosen)})
    seen = [watch(base, slipped.measured(rng, q=q[chosen])) for _ in range(30)]
    told = Counter((c.what, c.joint) for w in seen for c in w.changes)
    named = [[(c.what, c.joint) for c in w.changes] == [("joint_zero", 3)] for w in seen]
    assert sum(bool(w.changes) for w in seen) >= 26
    assert told.most_common(1)[0][0] == ("joint_zero", 3)  # its parallel neighbours are told for it at times
    assert sum(named) >= 15
    sigma = np.std([w.changes[0].size for w, ok in zip(seen, named, strict=True) if ok])
    assert sigma < 1.4 * slip.size(chosen) / DETECTABLE_Z
