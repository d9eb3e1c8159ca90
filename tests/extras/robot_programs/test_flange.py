"""Programs of a URDF's arm whose flange is a fixed link behind the last joint, judged by kinematics of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.extras.robot_programs.program_correction import corrected_program
from calib.extras.robot_programs.program_targets import load_program
from calib.frames import apply
from calib.kinematics.flange import flange_frames
from calib.kinematics.robot import FixedFrame, Robot
from calib.kinematics.tool_point import with_own_tool_point
from calib.models.fitted_model import FittedModel
from inspector.cli.parser import main
from tests.extras.robot_programs.controllers import LANGUAGES, Arm, inverse, of_maker, program_of, read_back, transform

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

    true: Arm
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
    return Cell(true, calibration.dataset.robot, calibration.fitted_model)


def sent(language: str, text: str) -> np.ndarray:
    """Joints (6, 6), rad, to which the controller goes by a corrected program: at its joint targets, then its poses."""
    joints, poses = read_back(language, text)
    work = np.eye(4) if language == "URScript" else WORK
    goals = [work @ of_maker(language, pose) @ np.linalg.inv(TOOL) for pose in poses]
    return np.array([*joints, *(inverse(UR.stands, goal, q) for goal, q in zip(goals, Q, strict=True))])


@pytest.mark.parametrize("kind", ["pose", "position"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_corrected_program_brings_the_tool_where_it_was_to_go(
    language: str, kind: str, cell: Cell, tmp_path: Path
) -> None:
    path = tmp_path / f"prog{LANGUAGES[language]}"
    path.write_text(program_of(language, UR.stands, Q, TOOL, WORK))
    result = corrected_program(load_program(path), cell.nominal, cell.model, kind=kind)
    assert result.reached, [move.reason for move in result.targets]
    promised = 3.0 * np.sqrt(3.0) * np.max(result.correction.sigma_mm)
    wanted, before, after = (
        np.array([(of.stands(q) @ TOOL)[:3, 3] for q in joints])
        for of, joints in ((UR, [*Q, *Q]), (cell.true, [*Q, *Q]), (cell.true, sent(language, result.content.decode())))
    )
    (scanner_T_base,) = cell.model.scanner_T_base.values()  # the points' frame is that of the true base
    wanted = apply(scanner_T_base, wanted)
    assert np.linalg.norm(before - wanted, axis=1).min() > 5.0 * promised
    assert np.linalg.norm(after - wanted, axis=1).max() < promised


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_it_is_the_same_where_the_last_row_of_the_table_leads_to_the_flange(
    kind: str, cell: Cell, tmp_path: Path
) -> None:
    true = calib.load_robot(cell.true.urdf(tmp_path / "true.urdf"))
    true = with_own_tool_point(true, apply(true.flange.transform, TOOL[:3, 3]))
    table = cell.nominal.table
    assert table[-2, 0] == 0.0
    table[-2:] = [table[-2] + table[-1], np.zeros(5)]
    in_row = with_own_tool_point(replace(cell.nominal.with_table(table), flange=FixedFrame()), TOOL[:3, 3])
    path = tmp_path / "prog.src"
    path.write_text(program_of("KRL", UR.stands, Q, TOOL, WORK))
    one, other = (
        sent("KRL", corrected_program(load_program(path), robot, true, kind=kind).content.decode())
        for robot in (cell.nominal, in_row)
    )
    np.testing.assert_allclose(one, other, atol=2e-8)
    for q, wanted in zip(one, [*Q, *Q], strict=True):
        at = (cell.true.stands(q) @ TOOL)[:3, 3]
        assert np.linalg.norm(at - (UR.stands(wanted) @ TOOL)[:3, 3]) < 1e-3


def test_the_flange_is_the_link_tool0_and_is_kept(cell: Cell, tmp_path: Path) -> None:
    calib.save_robot(cell.nominal, tmp_path / "robot.toml")
    path = tmp_path / "prog.mod"
    path.write_text(program_of("RAPID", UR.stands, Q, TOOL, WORK))
    without = replace(cell.nominal, flange=FixedFrame())
    assert "if it is tool0" in corrected_program(load_program(path), without, cell.model).notes[-1]
    tip = "<link name='probe'/><joint name='p' type='fixed'><parent link='tool0'/><child link='probe'/>"
    longer = UR.urdf(tmp_path / "longer.urdf")
    longer.write_text(longer.read_text().replace("</robot>", f"{tip}<origin xyz='0 0 0.2'/></joint></robot>"))
    for path in (tmp_path / "robot.toml", longer):
        found = flange_frames(calib.load_robot(path), Q)
        np.testing.assert_allclose(found, [UR.stands(q) for q in Q], atol=1e-9)
