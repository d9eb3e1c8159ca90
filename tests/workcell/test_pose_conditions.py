"""Conditions of planned poses: both sides, payloads, temperatures, each as an effect's needs have it."""

from __future__ import annotations

import numpy as np

from calib.effects.catalogue import CATALOGUE
from calib.workcell.pose_conditions import come_from, conditions_for, with_conditions

NEEDS = {kind.__name__: kind.needs for kind in CATALOGUE}


def test_each_effect_of_the_catalogue_gets_what_it_needs_and_no_more() -> None:
    wanted = {name: conditions_for([needs]) for name, needs in NEEDS.items()}
    assert [name for name, w in wanted.items() if w.both_sides] == ["Backlash"]
    assert [name for name, w in wanted.items() if w.temperatures_c] == ["ThermalGrowth"]
    with_payload = {name for name, w in wanted.items() if w.payloads_kg}
    assert with_payload == {name for name, needs in NEEDS.items() if "payload_kg" in needs}
    assert wanted["JointCompliance"].helpful == ("payload_kg",)
    assert conditions_for(["payload_kg in poses.csv"], payload_kg=3.0).helpful == ()


def test_every_pose_is_reached_from_either_side_with_either_payload() -> None:
    wanted = conditions_for([NEEDS["Backlash"], NEEDS["JointCompliance"]], payload_kg=2.0)
    assert len(wanted.sentences) == 2
    rows = with_conditions(wanted, 5, 6, rng=np.random.default_rng(0))
    assert rows.approach is not None
    assert rows.payload_kg is not None
    assert rows.temperature_c is None
    assert len(rows.pose) == 20
    for pose in range(5):
        for kg in (0.0, 2.0):
            here = (rows.pose == pose) & (rows.payload_kg == kg)
            assert here.sum() == 2
            assert np.array_equal(rows.approach[here].sum(axis=0), np.zeros(6))
    assert np.count_nonzero(np.diff(rows.payload_kg)) == 1  # it is mounted once
    many = with_conditions(wanted, 8, 6, rng=np.random.default_rng(0))
    assert many.approach is not None
    assert np.linalg.matrix_rank(many.approach) == 6  # joints are told apart


def test_temperature_rises_once_and_nothing_is_asked_without_a_need() -> None:
    rows = with_conditions(conditions_for([NEEDS["ThermalGrowth"]]), 7, 6, rng=np.random.default_rng(0))
    assert rows.temperature_c is not None
    assert np.count_nonzero(np.diff(rows.temperature_c)) == 1
    plain = with_conditions(conditions_for([]), 3, 6, rng=np.random.default_rng(0))
    assert (plain.payload_kg, plain.approach, plain.temperature_c) == (None, None, None)
    assert list(plain.pose) == [0, 1, 2]


def test_the_place_to_come_from_is_on_the_right_side_and_within_the_range() -> None:
    q, approach = np.array([[0.0, 100.0], [np.pi, 0.0]]), np.array([[1.0, -1.0], [-1.0, 1.0]])
    low, high = np.array([-np.pi, 0.0]), np.array([np.pi, 500.0])
    before = come_from(q, approach, np.array([True, False]), low, high)
    assert np.allclose(before[0], [-np.radians(3.0), 110.0])
    assert np.allclose(before[1], [np.pi, 0.0])
