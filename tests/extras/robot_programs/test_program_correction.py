"""Corrected programs, judged by an arm, a controller and makers' conventions of the test's own (numpy and SciPy)."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.extras.robot_programs.program_correction import ProgramCorrection, corrected_program
from calib.extras.robot_programs.program_targets import load_program
from calib.kinematics.robot import Robot
from inspector.cli.parser import main
from tests.extras.robot_programs.controllers import (
    LANGUAGES,
    NUMBER,
    inverse,
    listed,
    makers,
    of_maker,
    program_of,
    read_back,
    transform,
)
from tests.support.hidden_dataset import write_hidden

Q = np.radians(
    [
        [10.0, -20.0, 95.0, 15.0, -60.0, 30.0],
        [-35.0, 25.0, 70.0, -40.0, 75.0, -110.0],
        [60.0, 10.0, 80.0, 100.0, 50.0, 20.0],
    ]
)


def link(a: float, alpha: float, d: float, theta: float, beta: float) -> np.ndarray:
    turn = transform(Rotation.from_euler("z", theta), [0, 0, 0])
    return turn @ transform(Rotation.from_euler("x", alpha) * Rotation.from_euler("y", beta), [a, 0, d])


def flange(table: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Where an arm's flange stands, by elementary transforms."""
    out = np.eye(4)
    for (a, alpha, d, theta, beta), angle in zip(table[:-1], q, strict=True):
        out = out @ link(a, alpha, d, theta + angle, beta)
    return out


@dataclass(frozen=True)
class Cell:
    """An arm with known errors, its nominal table, and the frames of its programs."""

    nominal: Robot
    true: Robot
    tool: np.ndarray
    work: np.ndarray


@pytest.fixture(scope="module")
def cell() -> Cell:
    rng = np.random.default_rng(4)
    nominal = builtin_robot("rb5")
    table = nominal.table.copy()
    table[:-1] += rng.normal(0.0, 1.0, table[:-1].shape) * [0.4, 0.001, 0.4, 0.001, 0.001]
    tool = transform(Rotation.from_euler("xyz", [0.2, -0.1, 0.7]), [20.0, -15.0, 160.0])
    work = transform(Rotation.from_euler("xyz", [0.05, 0.02, 0.4]), [300.0, -150.0, 40.0])
    return Cell(nominal, nominal.with_table(table), tool, work)


def written(language: str, cell: Cell) -> str:
    return program_of(language, partial(flange, cell.nominal.table), Q, cell.tool, cell.work)


def run(language: str, cell: Cell, text: str, folder: Path, **given: object) -> ProgramCorrection:
    path = folder / f"prog{LANGUAGES[language]}"
    path.write_bytes(text.encode("ascii"))
    return corrected_program(load_program(path), cell.nominal, cell.true, **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_true_arm_goes_where_the_nominal_one_was_told_to(language: str, cell: Cell, tmp_path: Path) -> None:
    text = written(language, cell)
    result = run(language, cell, text, tmp_path)
    assert result.reached
    assert result.correction.kind == "pose"
    joints, poses = read_back(language, result.content.decode("ascii"))
    _, told = read_back(language, text)
    work = np.eye(4) if language == "URScript" else cell.work
    for k, q in enumerate(Q):
        wanted = work @ of_maker(language, told[k])
        commanded = inverse(
            partial(flange, cell.nominal.table), work @ of_maker(language, poses[k]) @ np.linalg.inv(cell.tool), q
        )
        for sent in (joints[k], commanded):
            stands = flange(cell.true.table, sent) @ cell.tool
            assert np.linalg.norm(stands[:3, 3] - wanted[:3, 3]) < 2e-5
            assert np.abs(stands[:3, :3] - wanted[:3, :3]).max() < 1e-7
        uncorrected = flange(cell.true.table, q) @ cell.tool
        assert np.linalg.norm(uncorrected[:3, 3] - wanted[:3, 3]) > 0.3
        moved = np.linalg.norm((work @ of_maker(language, poses[k]))[:3, 3] - wanted[:3, 3])
        assert result.targets[2 * k + 1].moved_mm == pytest.approx(moved, abs=1e-4)


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_unreachable_target_is_left_and_told(language: str, cell: Cell, tmp_path: Path) -> None:
    text = written(language, cell)
    _, poses = read_back(language, text)
    far = f"{poses[1][0] + (9.0 if language == 'URScript' else 9000.0):.9f}"
    text = text.replace(f"{poses[1][0]:.9f}", far)
    limit = f"{np.radians(400.0):.9f}" if language == "URScript" else "400.0000000"
    joint = f"{Q[0][0]:.9f}" if language == "URScript" else f"{np.degrees(Q[0][0]):.7f}"
    text = text.replace(joint, limit, 1)
    result = run(language, cell, text, tmp_path)
    assert [move.reached for move in result.targets][1:] == [language == "RAPID", True, False, True, True]
    assert all(bool(move.reason) is not move.reached for move in result.targets)
    old, new = text.splitlines(), result.content.decode("ascii").splitlines()
    for move in result.targets:
        line = move.target.line - 1
        assert (old[line] == new[line]) is not move.reached


def test_a_frame_that_is_not_defined_has_to_be_given(cell: Cell, tmp_path: Path) -> None:
    text = written("RAPID", cell)
    without = "\n".join(line for line in text.splitlines() if "tooldata" not in line)
    with pytest.raises(CalibError, match=r"p0 needs grip, which this file does not define; give it as --tool-frame"):
        run("RAPID", cell, without, tmp_path)
    given = run("RAPID", cell, without, tmp_path, tool=cell.tool)
    defined = run("RAPID", cell, text, tmp_path)
    for one, other in zip(*(read_back("RAPID", r.content.decode()) for r in (given, defined)), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)
    with pytest.raises(CalibError, match="leave it out"):
        run("RAPID", cell, text, tmp_path, tool=cell.tool)


def test_several_frames_are_given_by_their_names(cell: Cell, tmp_path: Path) -> None:
    text = written("KRL", cell)
    tool, base = (listed("KRL", makers("KRL", frame)) for frame in (cell.tool, cell.work))
    open_ = text.replace(f"$TOOL={{{tool}}}", "$TOOL=TOOL_DATA[4]").replace(f"$BASE={{{base}}}", "$BASE=BASE_DATA[2]")
    open_ = open_.replace("END", "$BASE=BASE_DATA[3]\r\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\r\nEND")
    works = {"base_data[2]": cell.work}
    with pytest.raises(CalibError, match=r"needs BASE_DATA\[3\]"):
        run("KRL", cell, open_, tmp_path, tool=cell.tool, work=works)
    with pytest.raises(CalibError, match=r"leaves 2 open: BASE_DATA\[2\], BASE_DATA\[3\]"):
        run("KRL", cell, open_, tmp_path, tool=cell.tool, work=cell.work)
    given = run("KRL", cell, open_, tmp_path, tool=cell.tool, work=works | {"": np.eye(4)})
    wanted = read_back("KRL", run("KRL", cell, text, tmp_path).content.decode())
    found = read_back("KRL", given.content.decode())
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-12)
    np.testing.assert_allclose(found[1][:-1] if len(found[1]) > len(wanted[1]) else found[1], wanted[1], atol=1e-8)


def test_qnear_and_frames_of_urscript_count(cell: Cell, tmp_path: Path) -> None:
    turned = Q + np.array([0.0, 0.0, 0.0, np.pi, 0.0, np.pi])
    turned[:, 4] *= -1.0  # the other posture of the wrist at the same places
    frame, tool = (listed("URScript", makers("URScript", each)) for each in (cell.work, cell.tool))
    lines = [f"set_tcp({tool})", f"frame = {frame}", f"movej([{', '.join(f'd2r({v:.7f})' for v in np.degrees(Q[0]))}])"]
    for k, q in enumerate(turned):
        pose = np.linalg.inv(cell.work) @ flange(cell.nominal.table, q) @ cell.tool
        lines += [
            f"q{k} = [{', '.join(f'{v:.3f}' for v in q)}]",
            f"p{k} = pose_trans(frame, {listed('URScript', makers('URScript', pose))})",
            f"movej(get_inverse_kin(p{k}, qnear=q{k}), a=1.2)",
        ]
    result = run("URScript", cell, "\n".join(lines), tmp_path)
    assert result.reached
    np.testing.assert_allclose(result.correction.q_nominal, [Q[0], *turned], atol=1e-7)
    new = [
        np.array([float(v) for v in re.findall(NUMBER, m[1])])
        for m in re.finditer(r"frame, p\[([^\]]*)", result.content.decode())
    ]
    for q, values in zip(turned, new, strict=True):
        at = cell.work @ of_maker("URScript", values) @ np.linalg.inv(cell.tool)
        stands = flange(cell.true.table, inverse(partial(flange, cell.nominal.table), at, q)) @ cell.tool
        wanted = flange(cell.nominal.table, q) @ cell.tool
        assert np.linalg.norm(stands[:3, 3] - wanted[:3, 3]) < 2e-5
    degrees = [float(v) for v in re.findall(rf"d2r\(({NUMBER})\)", result.content.decode())]
    stands = flange(cell.true.table, np.radians(degrees))
    np.testing.assert_allclose(stands, flange(cell.nominal.table, Q[0]), atol=2e-4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("data"), "cell")


@pytest.fixture(scope="module")
def model(folder: Path) -> Path:
    path = folder.parent / "model.json"
    assert main(["calibrate", str(folder), "--model-out", str(path), "--force"]) == 0
    return path


def test_the_command_writes_the_program_and_tells_of_each_target(
    folder: Path, model: Path, cell: Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "prog.mod", tmp_path / "out" / "prog.mod"
    source.write_text(written("RAPID", cell))
    given = ["correct", str(folder), "--model", str(model), "--program", str(source), "--out", str(out)]
    capsys.readouterr()
    assert main([*given, "--what", "pose", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["program"]
    assert found["language"] == "RAPID"
    assert [t["name"] for t in found["targets"]] == ["j0", "p0", "j1", "p1", "j2", "p2"]
    assert all(t["reached"] and t["moved_mm"] > 0.0 and t["uncorrected_mm"] > 0.0 for t in found["targets"])
    assert [each["what"] for each in found["left"]] == ["grip", "table"]
    assert out.read_text() != source.read_text()
    assert main(given) == 1  # by measured points alone the positions of the measured tool are known
    told = capsys.readouterr().out
    assert "3 of 6 targets corrected" in told
    assert "tool's point" in told


def test_the_command_refuses_in_one_line(
    folder: Path, model: Path, cell: Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "prog.src", tmp_path / "out.src"
    source.write_text(written("KRL", cell))
    program = ["--program", str(source)]
    for extra, words in (
        ([*program, "--out", str(source)], "is what this command reads"),
        ([*program, "--out", str(tmp_path / "out.mod")], "suffix"),
        ([*program, "--out", str(out), "--tool-frame=0,0,1"], "6 numbers"),
        ([*program, "--out", str(out), "--tool-frame=0,0,1,0,0,0"], "leave it out"),
        (["--program", str(tmp_path / "none.src"), "--out", str(out)], "no such file"),
        (["--joints", str(folder / "poses.csv"), "--out", "a.csv", "--work-frame=0,0,0,0,0,0"], "goes with --program"),
    ):
        capsys.readouterr()
        assert main(["correct", str(folder), "--model", str(model), *extra]) == 2
        captured = capsys.readouterr()
        assert captured.err.count("\n") == 1
        assert words in captured.err
    assert not out.exists()


def test_conditions_that_a_program_does_not_tell_are_asked_for_as_a_table(
    folder: Path, cell: Cell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "prog.src"
    path.write_text(written("KRL", cell))
    given = ["correct", str(folder), "--program", str(path), "--out", str(tmp_path / "out.src")]
    code = main([*given, "--add", "joint_compliance"])
    assert code == 2
    assert "payload_kg" in capsys.readouterr().err
