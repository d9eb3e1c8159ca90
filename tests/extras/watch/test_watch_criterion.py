"""Check poses: what they show, against sizes that MuJoCo's own points give, and against poses at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.array_types import IndexArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.extras.watch.change_tests import DETECTABLE_Z
from calib.extras.watch.plugin import CHECK_POSES
from calib.extras.watch.promised_sizes import promised_sizes
from calib.extras.watch.watch import ChangeReport, watch
from calib.extras.watch.watch_criterion import CheckedChange, check_poses, usual_changes
from calib.fitting.observations import conditions_at
from calib.kinematics.joint_range import random_poses
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


@pytest.mark.thorough
def test_the_sizes_that_are_promised_are_found_and_named_as_often_as_promised(planned: Planned) -> None:
    cell, q, changes, chosen = planned
    rng = np.random.default_rng(5)
    base = calibrate(cell.measured(rng, 64, "base"))
    promised = {
        p.model.key: p for p in promised_sizes(base, predicted(base, q[chosen]), [c.model.key for c in changes])
    }
    slip = promised["joint_zero", 3, "theta3"]
    assert slip.found is not None
    assert slip.named is not None
    assert slip.alone is not None
    assert slip.found < slip.named < slip.alone
    assert slip.rival == ("joint_zero", 2, "theta2")  # its parallel neighbour

    def checked(size_rad: float) -> list[ChangeReport]:
        slipped = cell.with_changes({"theta3": size_rad})
        return [watch(base, slipped.measured(rng, q=q[chosen])) for _ in range(20)]

    assert sum(seen.verdict != "unchanged" for seen in checked(slip.found)) >= 17
    of_each = [seen.changes for seen in checked(slip.named)]
    assert sum([(c.what, c.joint) for c in named] == [("joint_zero", 3)] for named in of_each) >= 17
    alone = [seen.changes for seen in checked(slip.alone)]
    assert sum([(c.what, c.joint, c.as_well) for c in named] == [("joint_zero", 3, ())] for named in alone) >= 17
    sigma = np.std([named[0].size for named in of_each if named and named[0].joint == 3])
    assert sigma < 1.6 * slip.found / DETECTABLE_Z


def test_what_looks_the_same_at_any_size_is_promised_no_name(planned: Planned) -> None:
    cell, q, changes, chosen = planned
    base = calibrate(cell.measured(np.random.default_rng(5), 64, "base"))
    promised = {
        p.model.key: p for p in promised_sizes(base, predicted(base, q[chosen]), [c.model.key for c in changes])
    }
    turned, bent = promised["joint_zero", 1, "theta1"], promised["joint_zero", 5, "theta5"]
    assert turned.found is not None  # where the scanner stands where it stood
    assert turned.named is None
    assert bent.named is not None
    assert bent.alone is None
    assert bent.rival == ("length", 5, "a5")  # the target is on the last axis, so that it moves by the same


def predicted(base: Calibration, q: np.ndarray) -> Dataset:
    """Check poses with points where the fit predicts them."""
    poses, unknowns = conditions_at(base.dataset.poses, q), unknowns_of_fit(base)
    return replace(base.dataset, poses=poses, points=unknowns.points(poses))
