"""Corrected programs of an arm from a URDF, judged by kinematics, a controller and conventions of the test's own."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.errors import CalibError
from calib.extras.robot_programs.program_correction import (
    ProgramCorrection,
    corrected_program,
    require_no_conditions,
)
from calib.extras.robot_programs.program_targets import load_program
from calib.frames import apply
from calib.kinematics.flange import flange_frames
from calib.kinematics.robot import FixedFrame, Robot
from calib.kinematics.tool_point import with_own_tool_point
from calib.models.fitted_model import FittedModel
from inspector.cli.parser import main
from tests.extras.robot_programs.controllers import (
    LANGUAGES,
    NUMBER,
    Arm,
    inverse,
    listed,
    makers,
    of_maker,
    program_of,
    read_back,
    transform,
)

UR = Arm.of(  # a UR10e, whose 116.55 mm from the last joint to the flange are the fixed joint's
    [[0, 0, 180.7], [0, 0, 0], [-612.7, 0, 0], [-571.55, 0, 174.15], [0, -119.85, 0], [0, 0, 0], [0, 0, 116.55]],
    [[0, 0, 0], [np.pi / 2, 0, 0], [0, 0, 0], [0, 0, 0], [np.pi / 2, 0, 0], [-np.pi / 2, 0, 0], [0, 0, np.pi / 2]],
    [[0, 0, 1]] * 6,
)
TOOL = transform(Rotation.from_euler("xyz", [0.2, -0.1, 0.7]), [30.0, -20.0, 100.0])  # ends at the measured point
WORK = transform(Rotation.from_euler("xyz", [0.05, 0.02, 0.4]), [300.0, -150.0, 40.0])
Q = np.array(
    [[0.3, -1.2, 1.6, -1.9, -1.4, 0.5], [-0.8, -1.7, 2.0, -1.2, -1.1, 1.8], [1.4, -0.9, 1.2, -1.6, -2.0, -0.7]]
)


@dataclass(frozen=True)
class Cell:
    """What the controller computes with, the arm as it is, and what measured points tell of it."""

    folder: Path
    true: Arm
    true_robot: Robot
    nominal: Robot
    model: FittedModel


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    """An arm with errors of its links, imported and calibrated by 60 points of its tool with 0.01 mm of noise."""
    folder = tmp_path_factory.mktemp("ur")
    rng = np.random.default_rng(2)
    true = UR.with_errors(rng)
    q = rng.uniform(-1.0, 1.0, (60, 6)) + Q.mean(axis=0)
    points = np.array([(true.stands(each) @ TOOL)[:3, 3] for each in q]) + rng.normal(0.0, 0.01, (60, 3))
    names = [f"p{k}" for k in range(60)]
    for file, header, table in (("joints", "pose," + ",".join(f"q{k}_deg" for k in range(1, 7)), np.degrees(q)),
                                ("points", "pose,x_mm,y_mm,z_mm", points)):  # fmt: skip
        lines = [",".join([name, *map(repr, row.tolist())]) for name, row in zip(names, table, strict=True)]
        (folder / f"{file}.csv").write_text("\n".join([header, *lines, ""]))
    given = ["--robot", str(UR.urdf(folder / "ur.urdf")), "--tool=30,-20,100", "--sigma", "0.01"]
    tables = [f"--{name}={folder / name}.csv" for name in ("joints", "points")]
    assert main(["import", str(folder / "cell"), *given, *tables]) == 0
    calibration = calib.calibrate(folder / "cell")
    true_robot = calib.load_robot(true.urdf(folder / "true.urdf"))
    return Cell(folder / "cell", true, true_robot, calibration.dataset.robot, calibration.fitted_model)


def written(language: str) -> str:
    return program_of(language, UR.stands, Q, TOOL, WORK)


def run(cell: Cell, language: str, text: str, folder: Path, **given: object) -> ProgramCorrection:
    """A program corrected for the true arm."""
    path = folder / f"prog{LANGUAGES[language]}"
    path.write_bytes(text.encode("ascii"))
    return corrected_program(load_program(path), cell.nominal, cell.true_robot, **given)  # type: ignore[arg-type]


def sent(language: str, content: bytes) -> np.ndarray:
    """Joints (6, 6), rad, to which the controller goes by a corrected program: at its joint targets, then its poses."""
    joints, poses = read_back(language, content.decode("ascii"))
    work = np.eye(4) if language == "URScript" else WORK
    goals = [work @ of_maker(language, pose) @ np.linalg.inv(TOOL) for pose in poses]
    return np.array([*joints, *(inverse(UR.stands, goal, q) for goal, q in zip(goals, Q, strict=True))])


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_true_arm_goes_where_the_nominal_one_was_told_to(language: str, cell: Cell, tmp_path: Path) -> None:
    result = run(cell, language, written(language), tmp_path)
    assert result.reached
    assert result.correction.kind == "pose"
    moves = [*result.targets[::2], *result.targets[1::2]]
    for q, wanted, move in zip(sent(language, result.content), [*Q, *Q], moves, strict=True):
        told, stands = UR.stands(wanted) @ TOOL, cell.true.stands(q) @ TOOL
        assert np.linalg.norm(stands[:3, 3] - told[:3, 3]) < 2e-5
        assert np.abs(stands[:3, :3] - told[:3, :3]).max() < 1e-7
        assert np.linalg.norm((cell.true.stands(wanted) @ TOOL)[:3, 3] - told[:3, 3]) > 0.3
        if move.target.kind == "pose":
            assert move.moved_mm == pytest.approx(np.linalg.norm((UR.stands(q) @ TOOL)[:3, 3] - told[:3, 3]), abs=1e-4)


@pytest.mark.parametrize("kind", ["pose", "position"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_corrected_program_brings_the_tool_where_it_was_to_go(
    language: str, kind: str, cell: Cell, tmp_path: Path
) -> None:
    path = tmp_path / f"prog{LANGUAGES[language]}"
    path.write_text(written(language))
    result = corrected_program(load_program(path), cell.nominal, cell.model, kind=kind)
    assert result.reached, [move.reason for move in result.targets]
    promised = 3.0 * np.sqrt(3.0) * np.max(result.correction.sigma_mm)
    wanted, before, after = (
        np.array([(of.stands(q) @ TOOL)[:3, 3] for q in joints])
        for of, joints in ((UR, [*Q, *Q]), (cell.true, [*Q, *Q]), (cell.true, sent(language, result.content)))
    )
    (scanner_T_base,) = cell.model.scanner_T_base.values()  # the points' frame is that of the true base
    wanted = apply(scanner_T_base, wanted)
    assert np.linalg.norm(before - wanted, axis=1).min() > 5.0 * promised
    assert np.linalg.norm(after - wanted, axis=1).max() < promised


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_it_is_the_same_where_the_last_row_of_the_table_leads_to_the_flange(
    kind: str, cell: Cell, tmp_path: Path
) -> None:
    true = with_own_tool_point(cell.true_robot, apply(cell.true_robot.flange.transform, TOOL[:3, 3]))
    table = cell.nominal.table
    assert table[-2, 0] == 0.0
    table[-2:] = [table[-2] + table[-1], np.zeros(5)]
    in_row = with_own_tool_point(replace(cell.nominal.with_table(table), flange=FixedFrame()), TOOL[:3, 3])
    path = tmp_path / "prog.src"
    path.write_text(written("KRL"))
    one, other = (
        sent("KRL", corrected_program(load_program(path), robot, true, kind=kind).content)
        for robot in (cell.nominal, in_row)
    )
    np.testing.assert_allclose(one, other, atol=2e-8)
    for q, wanted in zip(one, [*Q, *Q], strict=True):
        at = (cell.true.stands(q) @ TOOL)[:3, 3]
        assert np.linalg.norm(at - (UR.stands(wanted) @ TOOL)[:3, 3]) < 1e-3


def test_the_flange_is_the_link_tool0_and_is_kept(cell: Cell, tmp_path: Path) -> None:
    calib.save_robot(cell.nominal, tmp_path / "robot.toml")
    path = tmp_path / "prog.mod"
    path.write_text(written("RAPID"))
    without = replace(cell.nominal, flange=FixedFrame())
    assert "if it is tool0" in corrected_program(load_program(path), without, cell.model).notes[-1]
    tip = "<link name='probe'/><joint name='p' type='fixed'><parent link='tool0'/><child link='probe'/>"
    longer = UR.urdf(tmp_path / "longer.urdf")
    longer.write_text(longer.read_text().replace("</robot>", f"{tip}<origin xyz='0 0 0.2'/></joint></robot>"))
    for path in (tmp_path / "robot.toml", longer):
        found = flange_frames(calib.load_robot(path), Q)
        np.testing.assert_allclose(found, [UR.stands(q) for q in Q], atol=1e-9)


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_unreachable_target_is_left_and_told(language: str, cell: Cell, tmp_path: Path) -> None:
    text = written(language)
    _, poses = read_back(language, text)
    far = f"{poses[1][0] + (9.0 if language == 'URScript' else 9000.0):.9f}"
    text = text.replace(f"{poses[1][0]:.9f}", far)
    result = run(cell, language, text, tmp_path)
    assert [move.reached for move in result.targets] == [True, True, True, False, True, True]
    assert all(bool(move.reason) is not move.reached for move in result.targets)
    old, new = text.splitlines(), result.content.decode("ascii").splitlines()
    for move in result.targets:
        line = move.target.line - 1
        assert (old[line] == new[line]) is not move.reached


def test_a_frame_that_is_not_defined_has_to_be_given(cell: Cell, tmp_path: Path) -> None:
    text = written("RAPID")
    without = "\n".join(line for line in text.splitlines() if "tooldata" not in line)
    with pytest.raises(CalibError, match=r"p0 needs grip, which this file does not define; give it as --tool-frame"):
        run(cell, "RAPID", without, tmp_path)
    given = run(cell, "RAPID", without, tmp_path, tool=TOOL)
    defined = run(cell, "RAPID", text, tmp_path)
    np.testing.assert_allclose(sent("RAPID", given.content), sent("RAPID", defined.content), atol=1e-8)
    with pytest.raises(CalibError, match="leave it out"):
        run(cell, "RAPID", text, tmp_path, tool=TOOL)


def test_several_frames_that_are_not_defined_take_the_file_that_has_them(cell: Cell, tmp_path: Path) -> None:
    text = written("KRL")
    base = listed("KRL", makers("KRL", WORK))
    open_ = text.replace(f"$BASE={{{base}}}", "$BASE=BASE_DATA[2]")
    open_ = open_.replace("END", "$BASE=BASE_DATA[3]\r\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\r\nEND")
    with pytest.raises(CalibError, match=r"needs BASE_DATA\[2\], .* of BASE_DATA\[2\], BASE_DATA\[3\] name the file"):
        run(cell, "KRL", open_, tmp_path, work=WORK)
    config = tmp_path / "$config.dat"
    config.write_text(f"BASE_DATA[2]={{{base}}}\nBASE_DATA[3]={{X 0,Y 0,Z 0,A 0,B 0,C 0}}\n")
    (tmp_path / "prog.src").write_text(open_, newline="")
    found = corrected_program(load_program(tmp_path / "prog.src", [config]), cell.nominal, cell.true_robot)
    wanted = run(cell, "KRL", text, tmp_path)
    assert found.content.splitlines()[3:-3] == wanted.content.splitlines()[3:-1]


def test_qnear_and_frames_of_urscript_count(cell: Cell, tmp_path: Path) -> None:
    turned = Q * [1, 1, 1, 1, -1, 1] + [0.0, 0.0, 0.0, np.pi, 0.0, np.pi]  # another posture of the wrist
    frame, tool = (listed("URScript", makers("URScript", each)) for each in (WORK, TOOL))
    lines = [f"set_tcp({tool})", f"frame = {frame}", f"movej([{', '.join(f'd2r({v:.7f})' for v in np.degrees(Q[0]))}])"]
    for k, q in enumerate(turned):
        pose = listed("URScript", makers("URScript", np.linalg.inv(WORK) @ UR.stands(q) @ TOOL))
        near = f"q{k} = [{', '.join(f'{v:.3f}' for v in q)}]"
        lines += [near, f"p{k} = pose_trans(frame, {pose})", f"movej(get_inverse_kin(p{k}, qnear=q{k}), a=1.2)"]
    result = run(cell, "URScript", "\n".join(lines), tmp_path)
    assert result.reached
    np.testing.assert_allclose(result.correction.q_nominal, [Q[0], *turned], atol=1e-7)
    text = result.content.decode()
    degrees = [float(v) for v in re.findall(rf"d2r\(({NUMBER})\)", text)]
    sent_q = [np.radians(degrees)]
    for q, found in zip(turned, re.findall(r"frame, p\[([^\]]*)", text), strict=True):
        values = np.array([float(v) for v in re.findall(NUMBER, found)])
        sent_q.append(inverse(UR.stands, WORK @ of_maker("URScript", values) @ np.linalg.inv(TOOL), q))
    for q, wanted in zip(sent_q, [Q[0], *turned], strict=True):
        np.testing.assert_allclose((cell.true.stands(q) @ TOOL)[:3, 3], (UR.stands(wanted) @ TOOL)[:3, 3], atol=2e-4)


@pytest.fixture(scope="module")
def model(cell: Cell) -> Path:
    path = cell.folder.parent / "model.json"
    assert main(["calibrate", str(cell.folder), "--model-out", str(path), "--force"]) == 0
    return path


def test_the_command_writes_the_program_and_tells_of_each_target(
    model: Path, cell: Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "prog.mod", tmp_path / "out" / "prog.mod"
    longer = TOOL @ transform(Rotation.identity(), [0.0, 0.0, 5.0])
    source.write_text(program_of("RAPID", UR.stands, Q, longer, WORK))
    given = ["correct", str(cell.folder), "--model", str(model), "--program", str(source), "--out", str(out)]
    capsys.readouterr()
    assert main([*given, "--what", "pose", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["program"]
    assert found["language"] == "RAPID"
    assert [t["name"] for t in found["targets"]] == ["j0", "p0", "j1", "p1", "j2", "p2"]
    assert all(t["reached"] and t["moved_mm"] > 0.0 and t["uncorrected_mm"] > 0.0 for t in found["targets"])
    assert [each["what"] for each in found["left"]] == ["grip", "table"]
    assert out.read_text() != source.read_text()
    assert main([*given, "--what", "position"]) == 1  # the positions of the measured tool alone
    told = capsys.readouterr().out
    assert "3 of 6 targets corrected" in told
    assert "tool's point" in told


def test_the_command_refuses_in_one_line(
    model: Path, cell: Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "prog.src", tmp_path / "out.src"
    source.write_text(written("KRL"))
    program = ["--program", str(source)]
    for extra, words in (
        ([*program, "--out", str(source)], "is what this command reads"),
        ([*program, "--out", str(tmp_path / "out.mod")], "suffix"),
        ([*program, "--out", str(out), "--tool-frame=0,0,1"], "6 numbers"),
        ([*program, "--out", str(out), "--tool-frame=0,0,1,0,0,0"], "leave it out"),
        (["--program", str(tmp_path / "none.src"), "--out", str(out)], "no such file"),
        (["--joints", "poses.csv", "--out", "a.csv", "--work-frame=0,0,0,0,0,0"], "goes with --program"),
    ):
        capsys.readouterr()
        assert main(["correct", str(cell.folder), "--model", str(model), *extra]) == 2
        captured = capsys.readouterr()
        assert words in captured.err
    assert not out.exists()
    with pytest.raises(CalibError, match="payload_kg through its effects"):
        require_no_conditions(load_program(source), ["payload_kg"], ["joint_compliance"])
