"""Rows of tables and names in sentences select what they are of; all else in HTML is escaped."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from calib import calibrate
from calib.effects.catalogue import effects_for
from calib.present.fit.calibration import parameter_tables
from calib.present.names import joints_by_parameter
from calib.rendering.blocks import pose, spans
from calib.rendering.html import panel
from inspector.markup.parts import elements
from tests.support.hidden_dataset import arm


def asked(html: str) -> list[tuple[str, str]]:
    """What the links in a text ask for."""
    return re.findall(r'data-ask="(\w+)" data-value="([^"]*)"', html)


def test_the_joint_of_each_parameter() -> None:
    dataset = arm(5)
    joints = joints_by_parameter(dataset.robot)
    assert joints["theta2"] == 2
    assert "thetaTCP" not in joints
    assert set(joints.values()) == set(range(1, dataset.robot.n_joints + 1))
    for family in effects_for(dataset):
        of_members = joints_by_parameter(dataset.robot, family.members)
        for member in family.members:
            if getattr(member, "joint", None) is not None:
                assert member.joint + 1 in of_members.values()  # type: ignore[attr-defined]


def test_a_row_of_the_table_of_parameters_picks_its_joint() -> None:
    html = panel(parameter_tables(calibrate(arm(5))))
    rows = re.findall(r"<tr([^>]*)>\s*<td[^>]*>(?:<a[^>]*>)?([^<]*)<", html)
    by_name = {name: asked(attributes) for attributes, name in rows}
    assert by_name["θ2"] == [("joint", "2")]
    assert by_name["aTCP"] == []


@pytest.mark.parametrize("shown", [elements.note, elements.alert, elements.heading])
def test_only_references_and_own_markup_are_left_as_they_are(shown: Callable[..., str]) -> None:
    html = shown(spans("<i>", pose("<p1>"), elements.tab_link("Learn/Plan", "<b>")))
    assert re.findall("<[ib]", html) == []
    assert 'data-value="&lt;p1&gt;"' in html
    assert 'data-tab="Learn/Plan"' in html
