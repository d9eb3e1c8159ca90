"""Measuring programs of a plan, run by a small controller of the test's own."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array
from calib.dataset.dataset import Box
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.extras.robot_programs.measuring_program import measuring_program, program_files, require_joints
from calib.extras.robot_programs.program_targets import load_program
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import FromRobot
from calib.planning.ways import passed
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.measurable import collides


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Poses on both sides of a wall, so that straight ways lead through it; approached from given sides."""
    wall = Box("wall", (300.0, -5.0, 100.0), (900.0, 5.0, 1200.0))
    scanner = np.array([[0.0, 0.0, -1.0, 1250.0], [1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 492.0], [0.0, 0.0, 0.0, 1.0]])
    cell = replace(workcell_of_robot(builtin_robot("rb5"), base_T_scanner=scanner), boxes=(wall,))
    made = plan_poses(FromRobot(cell), 16, candidates=100)
    side = np.where(np.arange(made.poses.q.size).reshape(made.poses.q.shape) % 2, 1.0, -1.0)
    return replace(made, poses=replace(made.poses, approach=side, payload_kg=np.repeat([0.0, 2.0], 8)))


POINTS = {  # how a language writes joint values, and how a line does something else; a group is what is told of it
    ".script": r"movej\(\[(.*?)\], a=[\d.]+, v=speed\)",
    ".src": r"PTP \{(.*?)\}",
    ".mod": r"MoveAbsJ \[\[(.*?)\],\[9E9,9E9,9E9,9E9,9E9,9E9\]\]\\NoEOffs,slow,fine,tool0;?",
}
DOES = {
    r"sleep\((.*)\)|WAIT SEC (.*)|WaitTime(?:\\InPos,| )(.*?);?": "wait",
    r".*get_actual_joint_positions.*|RECORDED\[NUMBER\]=\$AXIS_ACT|.*CJointT\(\).*": "record",
    r"popup.*|HALT|Stop;": "ask",
}
Seen = list[tuple[str, object]]


def run(files: dict[Path, str]) -> Seen:
    """Events in the order in which a controller comes to them: moves with their joints in degrees, waits in s."""
    text, suffix = next(iter(files.values())), next(iter(files)).suffix
    here = re.search(r"(?im)^( *)(?:def|PROC) measure_here\(.*\n((?:.*\n)*?)^\1(?:end|ENDPROC)\s*$", text)
    assert here is not None
    seen: Seen = []
    for line in text.replace(here[0], "").splitlines():
        inner = here[2].splitlines() if re.match(r"(?i) *measure_here", line) else [line]
        for each in (re.sub(r"\s*[#;!] .*", "", one).strip() for one in inner):
            if match := re.fullmatch(POINTS[suffix], each):
                q = np.array([float(re.sub(r"^A\d ", "", word.strip())) for word in match[1].split(",")])
                seen.append(("move", np.degrees(q) if suffix == ".script" else q))
            for pattern, event in DOES.items():
                if match := re.fullmatch(pattern, each):
                    told = next(filter(None, match.groups()), "") if match.groups() else ""
                    seen.append((event, float(told) if event == "wait" else None))
    return seen


def moves(seen: Seen) -> Array:
    return np.array([told for event, told in seen if event == "move"])


def expected_way(plan: Plan) -> tuple[Array, list[int]]:
    """Joints in degrees, in the order of the motion, and which of them are the planned poses."""
    rows, at = [], []
    for q, way in zip(plan.poses.q, plan.ways, strict=True):
        rows += [*passed(way), q]
        at.append(len(rows) - 1)
    return np.degrees(rows), at


@pytest.mark.parametrize("suffix", POINTS)
def test_a_program_goes_the_planned_way_and_measures_at_each_pose(plan: Plan, suffix: str) -> None:
    seen = run(measuring_program(Path(f"measure{suffix}"), plan))
    way_deg, poses_at = expected_way(plan)
    np.testing.assert_allclose(moves(seen), way_deg, atol=1e-6)
    stops = [k for k, (event, _) in enumerate(seen) if event == "move"]
    for move in poses_at:
        last = stops[move + 1] if move + 1 < len(stops) else len(seen)
        events = [each for each in seen[stops[move] + 1 : last] if each[0] != "ask"]
        assert events == [("wait", 1.0), ("record", None), ("wait", 3.0)]
    before, between = (k for k, (event, _) in enumerate(seen) if event == "ask")  # where the payload changes
    assert before < stops[0]
    assert stops[poses_at[7]] < between < stops[poses_at[7] + 1]


def test_a_pose_that_is_approached_from_a_side_is_come_to_from_there(plan: Plan) -> None:
    at, (_, poses_at) = (
        np.radians(moves(run(measuring_program(Path("m.src"), plan)))),
        expected_way(plan),
    )
    arrives = np.sign(at[poses_at] - at[np.array(poses_at) - 1])
    assert plan.poses.approach is not None
    inside = (np.abs(plan.poses.q) < np.radians(150.0)).all(axis=1)
    np.testing.assert_array_equal(arrives[inside], plan.poses.approach[inside])


def test_each_piece_of_the_way_is_free_as_a_fine_walk_along_it_finds(plan: Plan) -> None:
    assert plan.blocked
    assert any(len(way.vias) for way in plan.ways)
    seen = run(measuring_program(Path("measure.src"), plan))
    cell = plan.start.cell
    for one, other in pairwise(np.radians(moves(seen))):
        walk = one + np.linspace(0.0, 1.0, 120)[:, None] * (other - one)
        assert np.mean(collides(cell, walk)) < 0.03  # what lies between the places that were checked


@pytest.mark.parametrize("suffix", POINTS)
def test_the_project_reads_its_own_programs_again(plan: Plan, suffix: str, tmp_path: Path) -> None:
    for path, text in measuring_program(tmp_path / f"measure{suffix}", plan).items():
        assert text.isascii()
        path.write_text(text)
    program = load_program(tmp_path / f"measure{suffix}")
    assert {target.kind for target in program.targets} == {"joints"}
    values = np.array([target.values for target in program.targets])
    np.testing.assert_allclose(np.degrees(values) if suffix == ".script" else values, expected_way(plan)[0], atol=1e-6)


def test_a_pose_without_a_free_way_makes_no_program(plan: Plan) -> None:
    shut = (
        Box("left", (-900.0, 5.0, 0.0), (900.0, 900.0, 1500.0)),
        Box("right", (-900.0, -900.0, 0.0), (900.0, -5.0, 1500.0)),
    )
    cell = replace(plan.start.cell, boxes=shut)
    walled = replace(plan, start=replace(plan.start, cell=cell))
    with pytest.raises(CalibError, match=r"m\.script: no way .* was found"):
        measuring_program(Path("m.script"), walled)


@pytest.mark.parametrize(
    ("name", "found"),
    [("m.txt", "for another controller write the poses as .csv"), ("my program.mod", "letters, digits and _")],
)
def test_what_is_no_program_is_refused(name: str, found: str) -> None:
    with pytest.raises(CalibError, match=re.escape(found)):
        program_files(Path(name))


@pytest.mark.parametrize(("turn", "reason"), [([True] * 7, "has 7"), ([False] * 3 + [True] * 3, "3 and 3 sliding")])
def test_other_arms_are_refused(turn: list[bool], reason: str) -> None:
    with pytest.raises(CalibError, match=reason):
        require_joints(Path("m.mod"), "RAPID", turn)
