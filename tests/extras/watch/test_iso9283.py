"""RP, AP, dAP and dRP on a table that was worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from calib.extras.watch.iso9283 import Visits, pose_figures, repeatability_mm

# Four visits on the x axis at -3, -1, 1, 3 mm of the barycentre: l = 3, 1, 1, 3, mean 2, S = sqrt(4/3).
FOUR = np.array([[-3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
RP = 2.0 + 3.0 * 2.0 / np.sqrt(3.0)


def visits(session: str, off_mm: np.ndarray, q: list[float] | None = None, pose: str = "p1") -> Visits:
    count = len(off_mm)
    return Visits(session, [pose] * count, np.tile(q or [0.1, 0.2], (count, 1)), ["jig"] * count, off_mm)


def test_repeatability_by_hand_and_wherever_the_barycentre_is() -> None:
    assert repeatability_mm(FOUR) == pytest.approx(RP)
    assert repeatability_mm(FOUR[:, [1, 2, 0]] + [5.0, -7.0, 1.0]) == pytest.approx(RP)
    # A 3-4-5 pair: both visits 2.5 mm from the middle, no spread.
    assert repeatability_mm(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])) == pytest.approx(2.5)


def test_accuracy_and_its_drift_over_sessions() -> None:
    march = visits("march", FOUR + np.array([0.0, 3.0, 4.0]))  # AP 5
    june = visits("june", 2.0 * FOUR + np.array([0.0, 0.0, 6.0]), pose="c7")  # AP 6, twice the spread
    october = visits("october", np.array([[0.0, -3.0, -4.0]]))  # AP 5 on the other side, one visit
    (pose,) = pose_figures([march, june, october])
    assert [s.visits for s in pose.sessions] == [4, 4, 1]
    assert [s.ap_mm for s in pose.sessions] == pytest.approx([5.0, 6.0, 5.0])
    assert pose.sessions[2].rp_mm is None
    assert (pose.pose, pose.sessions[1].pose) == ("p1", "c7")
    assert pose.dap_mm == pytest.approx(1.0)
    assert pose.drp_mm == pytest.approx(RP)
    assert pose.moved_mm == pytest.approx(10.0)  # which AP alone does not see


def test_only_poses_that_were_visited_again() -> None:
    one = visits("march", FOUR[:1])
    elsewhere = visits("june", FOUR[:2], q=[0.1, 0.3])
    (pose,) = pose_figures([one, elsewhere])
    assert pose.sessions[0].session == "june"
    assert pose.dap_mm is None
    assert pose.moved_mm is None
    assert pose_figures([one, visits("june", FOUR[:1], q=[0.1, 0.3])]) == ()
