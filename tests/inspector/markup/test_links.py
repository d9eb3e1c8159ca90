"""Poses and joints that sentences name become links, and nothing else does."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace
from typing import cast, get_args

import numpy as np
import pytest

from calib.calibration.calibrate import calibrate
from calib.diagnosis.advice import Advice
from calib.diagnosis.moves import AddCurves, LeaveOutPoses, Move
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words import conclusions, sentences
from calib.effects.catalogue import effects_for
from calib.present.names import joints_by_parameter
from calib.present.references import Names, references_to
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.smooth_motions import JointFault
from inspector.markup.learn.said import Sentence, advice_said, known_links, reasons_said, residual_said
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


def test_names_that_a_sentence_holds_are_linked_whatever_they_look_like() -> None:
    html = linked("Without 1 and a b nothing is left, but 12 is", NAMES, references_to(["1", "a b"]))
    assert asked(html) == [("pose", "1"), ("pose", "a b")]
    assert asked(linked("order against q4 and x", NAMES, references_to((), ["q4", "x"]))) == [("joint", "4")]


def test_a_pose_that_is_called_like_a_parameter_is_linked_only_as_a_pose() -> None:
    dataset = arm(5)
    ids = ("d3", "q2", "p1", "7", *dataset.poses.ids[4:])
    names = Names.of(replace(dataset, poses=replace(dataset.poses, ids=ids)))
    assert asked(linked("d3 against q2 at p1 and 7; pose d3", names)) == [("pose", "p1"), ("pose", "d3")]


FAULT = JointFault("smooth", 3, 20.0, 1e-3, "rad", 0.4)
CURVES = SimpleNamespace(joints=(2, 3), inputs=("q2", "torque3"), log_evidence=9.0)
NOTHING = conclusions.ResidualSummary(None, (), False, ())


def left_out(pose: str) -> LeaveOutPoses:
    return LeaveOutPoses(cast(Diagnosis, SimpleNamespace(missing=())), (pose,))


WITH_POSES: list[tuple[Sentence, list[tuple[str, str]]]] = [
    (sentences.PosesStandOut(("1", "p3")), [("pose", "1"), ("pose", "p3")]),
    (sentences.FaultSuspected(FAULT), [("joint", "4")]),
    (left_out("1"), [("pose", "1")]),
    (conclusions.ResidualSummary(None, (), False, ("1", "2")), [("pose", "1"), ("pose", "2")]),
    (conclusions.ResidualSummary(FAULT, (), False, ()), [("joint", "4")]),
    (
        AddCurves(cast(Diagnosis, None), cast(LearnedCurves, CURVES)),
        [("joint", "2"), ("joint", "3"), ("joint", "2"), ("joint", "3")],
    ),
]


@pytest.mark.parametrize(("sentence", "links"), WITH_POSES)
def test_sentences_link_the_poses_and_joints_that_they_are_about(
    sentence: Sentence, links: list[tuple[str, str]]
) -> None:
    of_reason = isinstance(sentence, get_args(sentences.Reason))
    if of_reason:
        html = reasons_said([sentence], NAMES)  # type: ignore[list-item]
    elif isinstance(sentence, conclusions.ResidualSummary):
        html = residual_said(sentence, NAMES)
    else:
        html = advice_said(Advice(sentence, NOTHING), NAMES)  # type: ignore[arg-type]
    assert asked(html) == links


def test_every_kind_of_sentence_with_poses_links_them() -> None:
    """A new kind whose field `poses` or `outlier_poses` holds ids has to be told to `known_links`."""
    for kind in (*get_args(sentences.Reason), conclusions.ResidualSummary, *get_args(Move)):
        held = [f for f in fields(kind) if is_dataclass(kind) and f.type == "tuple[str, ...]" and "poses" in f.name]
        if held:
            values = {f.name: ("p9",) if f in held else _any_value(f.name) for f in fields(kind)}
            assert "p9" in known_links(kind(**values)), kind


def _any_value(name: str) -> object:
    return None if name == "fault" else ()


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
