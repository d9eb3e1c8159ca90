"""Measuring programs of a plan, run by small controllers of the test's own, one for each language."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
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
WRITTEN_DEG = {".script": 1e-7, ".src": 1e-7, ".mod": 1e-7}  # last place of what is written, in degrees


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Poses on both sides of a wall, so that straight ways lead through it; approached from given sides."""
    wall = Box("wall", (300.0, -5.0, 100.0), (900.0, 5.0, 1200.0))
    scanner = np.array([[0.0, 0.0, -1.0, 1250.0], [1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 492.0], [0.0, 0.0, 0.0, 1.0]])
    cell = replace(workcell_of_robot(builtin_robot("rb5"), base_T_scanner=scanner), boxes=(wall,))
    made = plan_poses(FromRobot(cell), 16, candidates=100)
    side = np.where(np.arange(made.poses.q.size).reshape(made.poses.q.shape) % 2, 1.0, -1.0)
    return replace(made, poses=replace(made.poses, approach=side, payload_kg=np.repeat([0.0, 2.0], 8)))


@dataclass
class Seen:
    """What a controller did: moves in degrees, and the events at each stop, in order."""

    moves: list[Array] = field(default_factory=list)
    events: list[tuple[str, object]] = field(default_factory=list)

    def move(self, q_deg: Array) -> None:
        self.moves.append(q_deg)
        self.events.append(("move", len(self.moves) - 1))


def run_urscript(text: str) -> Seen:
    """Run a measuring program as a UR controller would: its own lines, and those of the function that it calls."""
    seen, points = Seen(), {}
    lines = [re.sub(r"\s*#.*", "", line) for line in text.splitlines()]
    start = next(k for k, line in enumerate(lines) if "def measure_here" in line)
    stop = lines.index("  end", start)
    here, rest = lines[start + 1 : stop], [*lines[:start], *lines[stop + 1 :]]

    def one(line: str) -> None:
        line = line.strip()
        if match := re.fullmatch(r"(\w+) = \[(.*)\]", line):
            points[match[1]] = np.degrees([float(v) for v in match[2].split(",")])
        elif match := re.fullmatch(r"movej\((\w+), a=[\d.]+, v=([\d.]+)\)", line):
            seen.move(points[match[1]])
            seen.events.append(("speed_deg_s", round(float(np.degrees(float(match[2]))), 3)))
        elif match := re.fullmatch(r"measure_here\(\"(.*)\"\)", line):
            seen.events.append(("pose", match[1]))
            for inner in here:
                one(inner)
        elif match := re.fullmatch(r"sleep\((.*)\)", line):
            seen.events.append(("wait", float(match[1])))
        elif match := re.fullmatch(r"set_standard_digital_out\((\d+), True\)", line):
            seen.events.append(("on", match[1]))
        elif match := re.fullmatch(r"while not get_standard_digital_in\((\d+)\):", line):
            seen.events.append(("until", match[1]))
        elif "get_actual_joint_positions" in line:
            seen.events.append(("record", None))
        elif line.startswith("popup"):
            seen.events.append(("ask", line))
        elif line.startswith("while not socket_send_line"):
            seen.events.append(("send", None))
        elif "socket_read_line" in line:
            seen.events.append(("reply", None))

    for line in rest:
        one(line)
    return seen


def run_krl(text: str, data: str) -> Seen:
    """Run a measuring program as a KUKA controller would: motions by the names of its data list."""
    points = {
        match[1]: np.array([float(word.split()[1]) for word in match[2].split(",")])
        for match in re.finditer(r"^DECL AXIS (\w+)=\{(.*?)\}", data, re.MULTILINE)
    }
    seen = Seen()
    for line in text.splitlines():
        if match := re.fullmatch(r"PTP (\w+)", line):
            seen.move(points[match[1]])
        elif match := re.fullmatch(r"WAIT SEC (.*)", line):
            seen.events.append(("wait", float(match[1])))
        elif match := re.fullmatch(r"PULSE \(\$OUT\[(\d+)\],TRUE,(.*)\)", line):
            seen.events += [("on", match[1]), ("wait", float(match[2]))]
        elif match := re.fullmatch(r"WAIT FOR \$IN\[(\d+)\]", line):
            seen.events.append(("until", match[1]))
        elif match := re.fullmatch(r"RECORDED\[(\d+)\]=\$AXIS_ACT", line):
            seen.events.append(("record", int(match[1])))
        elif line == "HALT":
            seen.events.append(("ask", None))
    return seen


def run_rapid(text: str) -> Seen:
    """Run a measuring program as an ABB controller would: its first procedure, and the one that it calls."""
    points = {
        match[1]: np.array([float(word) for word in match[2].split(",")])
        for match in re.finditer(r"CONST jointtarget (\w+):=\[\[([^\]]*)\]", text)
    }
    procedures = re.findall(r"PROC (\w+)\((.*?)\)\n(.*?)ENDPROC", text, re.DOTALL)
    assert [name for name, _, _ in procedures] == ["run_measure", "measure_here"]
    here = procedures[1][2].splitlines()
    seen = Seen()

    def one(line: str) -> None:
        line = line.strip()
        if match := re.fullmatch(r"MoveAbsJ (\w+)\\NoEOffs,slow,fine,(\w+);", line):
            seen.move(points[match[1]])
        elif match := re.fullmatch(r"measure_here \"(.*)\";", line):
            seen.events.append(("pose", match[1]))
            for inner in here:
                one(inner)
        elif match := re.fullmatch(r"WaitTime(\\InPos,| )(.*);", line):
            seen.events.append(("wait", float(match[2])))
        elif match := re.fullmatch(r"PulseDO\\PLength:=(.*),(\w+);", line):
            seen.events += [("on", match[2]), ("wait", float(match[1]))]
        elif match := re.fullmatch(r"WaitDI (\w+),1;", line):
            seen.events.append(("until", match[1]))
        elif "CJointT()" in line:
            seen.events.append(("record", None))
        elif line == "Stop;":
            seen.events.append(("ask", None))
        elif line.startswith("SocketSend"):
            seen.events.append(("send", None))
        elif line.startswith("SocketReceive"):
            seen.events.append(("reply", None))

    for line in procedures[0][2].splitlines():
        one(line)
    return seen


def run(files: dict[Path, str]) -> Seen:
    texts = list(files.values())
    suffix = next(iter(files)).suffix
    if suffix == ".src":
        return run_krl(*texts)
    return run_urscript(texts[0]) if suffix == ".script" else run_rapid(texts[0])


def expected_way(plan: Plan) -> tuple[Array, list[int]]:
    """Joints in degrees, in the order of the motion, and which of them are the planned poses."""
    rows, at = [], []
    for q, way in zip(plan.poses.q, plan.ways, strict=True):
        rows += [*passed(way), q]
        at.append(len(rows) - 1)
    return np.degrees(rows), at


@pytest.mark.parametrize("suffix", [".script", ".src", ".mod"])
def test_a_program_goes_the_planned_way_and_measures_at_each_pose(plan: Plan, suffix: str) -> None:
    out, done = SIGNALS[suffix]
    options = MeasuringOptions(settle_s=1.5, trigger=Signal("output", out), measured=Signal("input", done))
    seen = run(planned_program(Path(f"measure{suffix}"), plan, options))
    way_deg, poses_at = expected_way(plan)
    np.testing.assert_allclose(np.array(seen.moves), way_deg, atol=WRITTEN_DEG[suffix])
    stops = [k for k, (kind, _) in enumerate(seen.events) if kind == "move"]
    for number, move in enumerate(poses_at):
        last = stops[move + 1] if move + 1 < len(stops) else len(seen.events)
        events = [
            event for event in seen.events[stops[move] + 1 : last] if event[0] in ("wait", "on", "until", "record")
        ]
        kinds = [kind for kind, _ in events]
        assert kinds == ["wait", "record", "on", "wait", "until"]
        assert events[0][1] == 1.5
        assert events[2][1] == out
        assert events[4][1] == done
        if suffix == ".src":
            assert events[1][1] == number + 1
    asked = [k for k, (kind, _) in enumerate(seen.events) if kind == "ask"]
    moved = [k for k, (kind, _) in enumerate(seen.events) if kind == "move"]
    assert len(asked) == 2  # before the first move, and where the payload changes
    assert asked[0] < moved[0]
    assert moved[poses_at[7]] < asked[1] < moved[poses_at[7] + 1]


def test_each_piece_of_the_way_is_free_as_a_fine_walk_along_it_finds(plan: Plan) -> None:
    assert plan.blocked
    assert any(len(way.vias) for way in plan.ways)
    seen = run(planned_program(Path("measure.src"), plan, MeasuringOptions()))
    cell = plan.start.cell
    for one, other in pairwise(np.radians(seen.moves)):
        walk = one + np.linspace(0.0, 1.0, 120)[:, None] * (other - one)
        assert np.mean(collides(cell, walk)) < 0.03  # what lies between the places that were checked


@pytest.mark.parametrize("suffix", [".script", ".src", ".mod"])
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
        events = run(planned_program(Path(f"measure{suffix}"), plan, options)).events
        told = [kind for kind, _ in events if kind in ("pose", "record", "send", "reply")]
        assert told == ["pose", "record", "send", "reply"] * len(plan.poses)
    with pytest.raises(CalibError, match="KRL itself has no sockets"):
        check_program(Path("measure.src"), options)


def test_speed_and_settings_stand_at_the_head(plan: Plan) -> None:
    options = MeasuringOptions(speed=20.0, stand_s=7.0)
    text = planned_program(Path("measure.script"), plan, options)[Path("measure.script")]
    assert {value for kind, value in run_urscript(text).events if kind == "speed_deg_s"} == {20.0}
    head = text[: text.index("def measure()")]
    assert "Speed 20 deg/s of the leading joint" in head
    assert "trigger: none; then at rest for 7 s" in head


def test_point_lists_lead_around_too(plan: Plan) -> None:
    text = planned_file(Path("poses.script"), plan)
    rows = re.findall(r"^\w+ = \[([^\]]*)\]", text, re.MULTILINE)
    written = np.degrees([[float(v) for v in row.split(",")] for row in rows])
    np.testing.assert_allclose(written, expected_way(plan)[0], atol=1e-7)


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
