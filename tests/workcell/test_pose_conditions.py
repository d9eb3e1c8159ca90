"""Conditions of planned poses: both sides of approach, payloads, temperatures, as an effect's needs state."""

from __future__ import annotations

import numpy as np

from calib.effects.catalogue import CATALOGUE
from calib.workcell.pose_conditions import come_from, conditions_for

NEEDS = {kind.__name__: kind.needs for kind in CATALOGUE}


def test_each_effect_of_the_catalogue_gets_what_it_needs_and_no_more() -> None:
    wanted = {name: conditions_for([needs]) for name, needs in NEEDS.items()}
    assert [name for name, w in wanted.items() if w.both_sides] == ["Backlash"]
    assert [name for name, w in wanted.items() if w.temperatures_c] == ["ThermalGrowth"]
    with_payload = {name for name, w in wanted.items() if w.payloads_kg}
    assert with_payload == {name for name, needs in NEEDS.items() if "payload_kg" in needs}
    assert wanted["JointCompliance"].helpful == ("payload_kg",)
    assert conditions_for(["payload_kg in poses.csv"], payload_kg=3.0).helpful == ()


def test_the_place_to_come_from_is_on_the_right_side_and_within_the_range() -> None:
    q, approach = np.array([[0.0, 100.0], [np.pi, 0.0]]), np.array([[1.0, -1.0], [-1.0, 1.0]])
    low, high = np.array([-np.pi, 0.0]), np.array([np.pi, 500.0])
    before = come_from(q, approach, np.array([True, False]), low, high)
    assert np.allclose(before[0], [-np.radians(3.0), 110.0])
    assert np.allclose(before[1], [np.pi, 0.0])
