"""Poses and joints that sentences name become links, and nothing else does."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.effects.catalogue import effects_for
from calib.present.names import joints_by_parameter
from calib.present.references import Names
from inspector.markup.model.fit import parameters_html
from inspector.markup.parts import elements
from inspector.markup.parts.links import linked
from tests.support.hidden_dataset import arm

NAMES = Names(frozenset({"p37", "p3", "1", "2", "12", "noise", "<b>"}), 6, frozenset({"p37", "p3"}))


def asked(html: str) -> list[tuple[str, str]]:
    """What the links in a text ask for."""
    return re.findall(r'data-ask="(\w+)" data-value="([^"]*)"', html)


def words(html: str) -> str:
    return re.sub(r"<[^>]*>", "", html)


@pytest.mark.parametrize(
    ("sentence", "links"),
    [
        ("pose p37: no corner (p3)", ["pose p37", "pose p3"]),
        ("Without p3 and p37, noise is left.", ["pose p3", "pose p37"]),
        ("poses 1, 2 and 12 of 12", ["pose 1", "pose 2", "pose 12"]),
        ("pose noise: noise", ["pose noise"]),
        ("12 of 64 scans", []),
        ("p37.ply, xp3 and p3-4", []),
        ("joints 1, 2 and 6 over q2", ["joint 1", "joint 2", "joint 6"]),
        ("joint 4, 12 mdeg", ["joint 4"]),
        ("joint 4, 0.2 mm", ["joint 4"]),
        ("joint 7 of 3 joints", []),
        ("gear (joint 2).", ["joint 2"]),
    ],
)
def test_what_is_linked(sentence: str, links: list[str]) -> None:
    html = linked(sentence, NAMES)
    assert [" ".join(link) for link in asked(html)] == links
    assert words(html) == sentence


def test_what_stands_in_the_text_is_escaped() -> None:
    html = linked('pose <b> is "bad" & <i>', NAMES)
    assert words(html) == "pose &lt;b&gt; is &quot;bad&quot; &amp; &lt;i&gt;"
    assert asked(html) == [("pose", "&lt;b&gt;")]


def test_a_pose_that_is_called_like_a_parameter_is_linked_only_as_a_pose() -> None:
    dataset = arm(5)
    ids = ("d3", "q2", "p1", "7", *dataset.poses.ids[4:])
    names = Names.of(replace(dataset, poses=replace(dataset.poses, ids=ids)))
    assert asked(linked("d3 against q2 at p1 and 7; pose d3", names)) == [("pose", "p1"), ("pose", "d3")]


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
    html = parameters_html(calibrate(arm(5)))
    rows = re.findall(r"<tr([^>]*)>\s*<td[^>]*>(?:<a[^>]*>)?([^<]*)<", html)
    by_name = {name: asked(attributes) for attributes, name in rows}
    assert by_name["θ2"] == [("joint", "2")]
    assert by_name["aTCP"] == []


def test_only_markup_is_left_as_it_is() -> None:
    assert "&lt;i&gt;" in elements.note("<i>")
    assert "<a " in elements.note(elements.pose_link("p1"))
    assert np.all(["<i>" not in shown("<i>") for shown in (elements.note, elements.alert)])
