"""Conditions of planned poses: both sides of approach, payloads, temperatures, as an effect's needs state."""

from __future__ import annotations

import numpy as np

from calib.effects.catalogue import descriptions
from calib.effects.effect import Description
from calib.workcell.pose_conditions import come_from, conditions_for


def test_each_effect_of_the_catalogue_gets_what_it_needs_and_no_more() -> None:
    wanted = {described.name: conditions_for([described]) for described in descriptions()}
    assert [name for name, w in wanted.items() if w.both_sides] == ["backlash"]
    assert [name for name, w in wanted.items() if w.temperatures_c] == ["thermal_growth"]
    assert {name for name, w in wanted.items() if w.payloads_kg} == {"joint_compliance", "nonlinear_stiffness"}
    assert wanted["joint_compliance"].helpful == ("payload_kg",)


def test_what_one_effect_needs_is_no_mere_help_for_another() -> None:
    needing = Description("mine", needed_conditions=("payload_kg",))
    compliance = next(described for described in descriptions() if described.name == "joint_compliance")
    wanted = conditions_for([compliance, needing], payload_kg=3.0)
    assert (wanted.helpful, wanted.payloads_kg) == ((), (0.0, 3.0))


def test_the_text_of_needs_names_the_conditions() -> None:
    """The sentence that a reader sees and the conditions that a plan varies name the same columns."""
    for described in descriptions():
        for condition in (*described.needed_conditions, *described.helpful_conditions):
            assert condition in described.needs


def test_the_place_to_come_from_is_on_the_right_side_and_within_the_range() -> None:
    q, approach = np.array([[0.0, 100.0], [np.pi, 0.0]]), np.array([[1.0, -1.0], [-1.0, 1.0]])
    low, high = np.array([-np.pi, 0.0]), np.array([np.pi, 500.0])
    before = come_from(q, approach, np.array([True, False]), low, high)
    assert np.allclose(before[0], [-np.radians(3.0), 110.0])
    assert np.allclose(before[1], [np.pi, 0.0])
