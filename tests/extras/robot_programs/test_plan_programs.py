"""Measuring programs of a plan, run by small controllers of the test's own, one for each language."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array
from calib.dataset.dataset import Box
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.extras.robot_programs.measuring_options import MeasuringOptions, Signal
from calib.extras.robot_programs.measuring_program import check_program
from calib.extras.robot_programs.program_targets import load_program
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import FromRobot
from calib.planning.ways import passed
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.measurable import collides
from inspector.export.plan_files import planned_file
from inspector.extras.robot_programs.planned_program import planned_program

SIGNALS = {".script": ("3", "4"), ".src": ("17", "18"), ".mod": ("doMeasure", "diDone")}


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Poses on both sides of a wall, so that straight ways lead through it; approached from given sides."""
    wall = Box("wall", (300.0, -5.0, 100.0), (900.0, 5.0, 1200.0))
    scanner = np.array([[0.0, 0.0, -1.0, 1250.0], [1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 492.0], [0.0, 0.0, 0.0, 1.0]])
    cell = replace(workcell_of_robot(builtin_robot("rb5"), base_T_scanner=scanner), boxes=(wall,))
    made = plan_poses(FromRobot(cell), 16, candidates=100)
    side = np.where(np.arange(made.poses.q.size).reshape(made.poses.q.shape) % 2, 1.0, -1.0)
    return replace(made, poses=replace(made.poses, approach=side, payload_kg=np.repeat([0.0, 2.0], 8)))


@dataclass(frozen=True)
class Controller:
    """How a controller of a language reads a program: its points, and what each line does, by the first pattern."""

    point: str  # name, joint values
    in_rad: bool
    does: dict[str, str]  # events by the patterns of lines; a group is what is told of them


CONTROLLERS = {
    ".script": Controller(
        r"^\s*(\w+) = \[([-\d., ]*)\]",
        True,
        {
            r"movej\((\w+), a=[\d.]+, v=[\d.]+\)": "move",
            r"sleep\((.*)\)": "wait",
            r"set_standard_digital_out\((\d+), True\)": "on",
            r"while not get_standard_digital_in\((\d+)\):": "until",
            r".*get_actual_joint_positions.*": "record",
            r"popup.*": "ask",
            r"while not socket_send_line.*": "send",
            r".*socket_read_line.*": "reply",
        },
    ),
    ".src": Controller(
        r"^DECL AXIS (\w+)=\{(.*?)\}",
        False,
        {
            r"PTP (\w+)": "move",
            r"WAIT SEC (.*)": "wait",
            r"PULSE \(\$OUT\[(\d+)\],TRUE,.*\)": "on",
            r"WAIT FOR \$IN\[(\d+)\]": "until",
            r"RECORDED\[(\d+)\]=\$AXIS_ACT": "record",
            r"HALT": "ask",
        },
    ),
    ".mod": Controller(
        r"CONST jointtarget (\w+):=\[\[([^\]]*)\]",
        False,
        {
            r"MoveAbsJ (\w+)\\NoEOffs,slow,fine,\w+;": "move",
            r"WaitTime(?:\\InPos,| )(.*);": "wait",
            r"PulseDO\\PLength:=.*,(\w+);": "on",
            r"WaitDI (\w+),1;": "until",
            r".*CJointT\(\).*": "record",
            r"Stop;": "ask",
            r"SocketSend.*": "send",
            r"SocketReceive.*": "reply",
        },
    ),
}
Seen = list[tuple[str, object]]


def run(files: dict[Path, str]) -> Seen:
    """Events in the order in which a controller comes to them: moves with their joints in degrees, waits in s."""
    text = "\n".join(files.values())
    controller = CONTROLLERS[next(iter(files)).suffix]
    points = {
        name: np.array([float(re.sub(r"^A\d ", "", word.strip())) for word in values.split(",")])
        for name, values in re.findall(controller.point, text, re.MULTILINE)
    }
    here = re.search(r"(?:def|PROC) measure_here\(.*?\):?\n(.*?)\n  (?:end|ENDPROC)\n", text, re.DOTALL)
    body = text if here is None else text.replace(here[0], "")
    seen: Seen = []
    for line in body.splitlines():
        inner = here[1].splitlines() if here is not None and re.match(r" +measure_here", line) else [line]
        for each in inner:
            each = re.sub(r"\s*#.*", "", each).strip()
            for pattern, event in controller.does.items():
                if match := re.fullmatch(pattern, each):
                    told = match[1] if match.groups() else None
                    if event == "move":
                        told = np.degrees(points[told]) if controller.in_rad else points[told]
                    seen.append((event, float(told) if event == "wait" else told))
                    break
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


@pytest.mark.parametrize("suffix", CONTROLLERS)
def test_a_program_goes_the_planned_way_and_measures_at_each_pose(plan: Plan, suffix: str) -> None:
    out, done = SIGNALS[suffix]
    options = MeasuringOptions(settle_s=1.5, trigger=Signal("output", out), measured=Signal("input", done))
    seen = run(planned_program(Path(f"measure{suffix}"), plan, options))
    way_deg, poses_at = expected_way(plan)
    np.testing.assert_allclose(moves(seen), way_deg, atol=1e-7)
    stops = [k for k, (event, _) in enumerate(seen) if event == "move"]
    for number, move in enumerate(poses_at):
        last = stops[move + 1] if move + 1 < len(stops) else len(seen)
        events = [each for each in seen[stops[move] + 1 : last] if each[0] in ("wait", "on", "until", "record")]
        (settle, record, on, *pulse, until) = events
        assert (settle, on, until) == (("wait", 1.5), ("on", out), ("until", done))
        assert pulse in ([], [("wait", 0.2)])  # of KRL and RAPID it is part of the instruction
        assert record == ("record", str(number + 1) if suffix == ".src" else None)
    before, between = (k for k, (event, _) in enumerate(seen) if event == "ask")  # where the payload changes
    assert before < stops[0]
    assert stops[poses_at[7]] < between < stops[poses_at[7] + 1]


def test_a_pose_that_is_approached_from_a_side_is_come_to_from_there(plan: Plan) -> None:
    at, (_, poses_at) = (
        np.radians(moves(run(planned_program(Path("m.src"), plan, MeasuringOptions())))),
        expected_way(plan),
    )
    arrives = np.sign(at[poses_at] - at[np.array(poses_at) - 1])
    assert plan.poses.approach is not None
    inside = (np.abs(plan.poses.q) < np.radians(150.0)).all(axis=1)
    np.testing.assert_array_equal(arrives[inside], plan.poses.approach[inside])


def test_each_piece_of_the_way_is_free_as_a_fine_walk_along_it_finds(plan: Plan) -> None:
    assert plan.blocked
    assert any(len(way.vias) for way in plan.ways)
    seen = run(planned_program(Path("measure.src"), plan, MeasuringOptions()))
    cell = plan.start.cell
    for one, other in pairwise(np.radians(moves(seen))):
        walk = one + np.linspace(0.0, 1.0, 120)[:, None] * (other - one)
        assert np.mean(collides(cell, walk)) < 0.03  # what lies between the places that were checked


@pytest.mark.parametrize("suffix", CONTROLLERS)
def test_the_project_reads_its_own_programs_again(plan: Plan, suffix: str, tmp_path: Path) -> None:
    files = planned_program(tmp_path / f"measure{suffix}", plan, MeasuringOptions())
    for path, text in files.items():
        path.write_text(text)
    program = load_program(list(files)[-1])  # of KRL the data list
    way_deg, _ = expected_way(plan)
    assert {target.kind for target in program.targets} == {"joints"}
    values = np.array([target.values for target in program.targets])
    np.testing.assert_allclose(np.degrees(values) if suffix == ".script" else values, way_deg, atol=1e-6)


def test_a_socket_is_told_of_each_pose_and_answers(plan: Plan) -> None:
    options = MeasuringOptions(trigger=Signal("socket", host="10.0.0.5", port=5000), measured=Signal("reply"))
    for suffix in (".script", ".mod"):
        events = run(planned_program(Path(f"measure{suffix}"), plan, options))
        told = [event for event, _ in events if event in ("record", "send", "reply")]
        assert told == ["record", "send", "reply"] * len(plan.poses)
    with pytest.raises(CalibError, match="KRL itself has no sockets"):
        check_program(Path("measure.src"), options)


def test_a_program_moves_at_the_speed_that_is_asked_for(plan: Plan) -> None:
    text = planned_program(Path("measure.script"), plan, MeasuringOptions(speed=20.0))[Path("measure.script")]
    speeds = re.findall(r"movej\(\w+, a=[\d.]+, v=([\d.]+)", text)
    np.testing.assert_allclose(np.degrees(np.array(speeds, dtype=float)), 20.0, atol=1e-3)


def test_point_lists_lead_around_too(plan: Plan) -> None:
    rows = re.findall(r"^\w+ = \[([^\]]*)\]", planned_file(Path("poses.script"), plan), re.MULTILINE)
    written = [[float(v) for v in row.split(",")] for row in rows]
    np.testing.assert_allclose(np.degrees(written), expected_way(plan)[0], atol=1e-7)
    with pytest.raises(CalibError, match=re.escape("poses.txt: a plan is")):
        planned_file(Path("poses.txt"), plan)


def test_a_pose_without_a_free_way_makes_no_program(plan: Plan) -> None:
    shut = (
        Box("left", (-900.0, 5.0, 0.0), (900.0, 900.0, 1500.0)),
        Box("right", (-900.0, -900.0, 0.0), (900.0, -5.0, 1500.0)),
    )
    cell = replace(plan.start.cell, boxes=shut)
    walled = replace(plan, start=replace(plan.start, cell=cell))
    with pytest.raises(CalibError, match=r"m\.script: no way .* was found"):
        planned_program(Path("m.script"), walled, MeasuringOptions())


@pytest.mark.parametrize(
    ("name", "options", "found"),
    [
        ("m.txt", MeasuringOptions(), "for another controller write the poses as .csv"),
        ("my program.mod", MeasuringOptions(), "my_program.mod will do"),
        ("m.script", MeasuringOptions(trigger=Signal("output", "9")), "have numbers, 0 to 7"),
        ("m.mod", MeasuringOptions(trigger=Signal("output", "1")), "have names"),
        ("m.script", MeasuringOptions(measured=Signal("reply")), "--trigger socket"),
        ("m.src", MeasuringOptions(speed=250.0), "100 at most"),
        ("m.script", MeasuringOptions(tool_name="tool1"), "leave out --tool-name"),
        ("m.script", MeasuringOptions(trigger=Signal("socket", host='x"y', port=1)), "no host's name"),
    ],
)
def test_what_a_language_cannot_do_is_refused(name: str, options: MeasuringOptions, found: str) -> None:
    with pytest.raises(CalibError, match=re.escape(found)):
        check_program(Path(name), options)
