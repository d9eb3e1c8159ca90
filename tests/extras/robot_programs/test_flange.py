"""Programs of a URDF's arm whose flange is a fixed link behind the last joint, judged by kinematics of their own."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import calib
from calib.extras.robot_programs.program_correction import ProgramCorrection, corrected_program
from calib.extras.robot_programs.program_targets import load_program
from calib.frames import apply
from calib.kinematics.flange import flange_frames
from calib.kinematics.robot import FixedFrame, Robot
from calib.kinematics.tool_point import with_own_tool_point
from calib.models.fitted_model import FittedModel
from inspector.cli.parser import main
from tests.extras.robot_programs.controllers import LANGUAGES, NUMBER, inverse, listed, makers, of_maker, transform

ORIGINS = (  # of a UR10e, mm and rad; its 116.55 mm from the last joint to the flange are the fixed joint's
    ((0.0, 0.0, 180.7), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (np.pi / 2, 0.0, 0.0)),
    ((-612.7, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ((-571.55, 0.0, 174.15), (0.0, 0.0, 0.0)),
    ((0.0, -119.85, 0.0), (np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 116.55), (0.0, 0.0, np.pi / 2)),
)
TOOL = transform(
    Rotation.from_euler("xyz", [0.2, -0.1, 0.7]), [30.0, -20.0, 100.0]
)  # on the flange; the measured point
Q = np.array(
    [[0.3, -1.2, 1.6, -1.9, -1.4, 0.5], [-0.8, -1.7, 2.0, -1.2, -1.1, 1.8], [1.4, -0.9, 1.2, -1.6, -2.0, -0.7]]
)


def stands(places: np.ndarray, q: np.ndarray) -> np.ndarray:
    """base_T_flange of an arm with these joint origins (7, 4, 4)."""
    at = np.eye(4)
    for place, angle in zip(places, [*q, 0.0], strict=True):
        at = at @ place @ transform(Rotation.from_rotvec([0.0, 0.0, angle]), [0.0, 0.0, 0.0])
    return at


def urdf(path: Path, places: np.ndarray) -> Path:
    """The arm as a URDF, its flange called tool0."""
    links = [f"<link name='l{k}'/>" for k in range(7)] + ["<link name='tool0'/>"]
    joints = []
    for k, place in enumerate(places):
        xyz, rpy = place[:3, 3] / 1000.0, Rotation.from_matrix(place[:3, :3]).as_euler("xyz")
        origin = f"<origin xyz='{' '.join(map(repr, xyz.tolist()))}' rpy='{' '.join(map(repr, rpy.tolist()))}'/>"
        kind, child = ("fixed", "tool0") if k == 6 else ("continuous", f"l{k + 1}")
        axis = "" if k == 6 else "<axis xyz='0 0 1'/>"
        joints.append(
            f"<joint name='j{k}' type='{kind}'><parent link='l{k}'/><child link='{child}'/>{origin}{axis}</joint>"
        )
    path.write_text(f"<robot name='ur'>{''.join(links)}{''.join(joints)}</robot>")
    return path


@dataclass(frozen=True)
class Arm:
    """What the controller computes with, the arm as it is, and what measured points tell of it."""

    places: np.ndarray  # (7, 4, 4) nominal
    true: np.ndarray
    nominal: Robot
    model: FittedModel


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """An arm with errors of its links, imported and calibrated by 60 points of its tool with 0.01 mm of noise."""
    folder = tmp_path_factory.mktemp("ur")
    rng = np.random.default_rng(2)
    places = np.array([transform(Rotation.from_euler("xyz", rpy), xyz) for xyz, rpy in ORIGINS])
    wrong = [transform(Rotation.from_rotvec(rng.normal(0, 8e-4, 3)), rng.normal(0, 0.3, 3)) for _ in range(6)]
    true = places @ np.array([*wrong, np.eye(4)])
    q = rng.uniform(-1.0, 1.0, (60, 6)) + Q.mean(axis=0)
    points = np.array([(stands(true, each) @ TOOL)[:3, 3] for each in q]) + rng.normal(0.0, 0.01, (60, 3))
    names = [f"p{k}" for k in range(60)]
    for file, header, table in (("joints", "pose," + ",".join(f"q{k}_deg" for k in range(1, 7)), np.degrees(q)),
                                ("points", "pose,x_mm,y_mm,z_mm", points)):  # fmt: skip
        lines = [",".join([name, *map(repr, row.tolist())]) for name, row in zip(names, table, strict=True)]
        (folder / f"{file}.csv").write_text("\n".join([header, *lines, ""]))
    given = ["--robot", str(urdf(folder / "ur.urdf", places)), "--tool=30,-20,100", "--sigma", "0.01"]
    tables = [f"--{name}={folder / name}.csv" for name in ("joints", "points")]
    assert main(["import", str(folder / "cell"), *given, *tables]) == 0
    calibration = calib.calibrate(folder / "cell")
    return Arm(places, true, calibration.dataset.robot, calibration.fitted_model)


def program(language: str, arm: Arm) -> str:
    """Joint targets Q, then poses of the tool at the same places; the tool is set as on the controller's flange."""
    tool = listed(language, makers(language, TOOL))
    poses = [listed(language, makers(language, stands(arm.places, q) @ TOOL)) for q in Q]
    degrees = np.degrees(Q)
    if language == "URScript":
        lines = [f"set_tcp({tool})"]
        for q, pose in zip(Q, poses, strict=True):
            lines += [f"movej([{','.join(f'{v:.9f}' for v in q)}])", f"movel({pose})"]
        return "\n".join(lines)
    if language == "KRL":
        lines = ["DEF prog()", f"$TOOL={{{tool}}}", "$BASE=$NULLFRAME"]
        for q, pose in zip(degrees, poses, strict=True):
            lines += [f"PTP {{{','.join(f'A{k + 1} {v:.7f}' for k, v in enumerate(q))}}}", f"LIN {{{pose}}}"]
        return "\n".join([*lines, "END"])
    axes = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    lines = ["MODULE M", f"PERS tooldata grip:=[TRUE,[{tool}],[1,[0,0,1],[1,0,0,0],0,0,0]];", "PROC main()"]
    for q, pose in zip(degrees, poses, strict=True):
        quadrants = ",".join(str(int(np.floor(q[axis] / 90.0))) for axis in (0, 3, 5))
        lines += [f"MoveAbsJ [[{','.join(f'{v:.7f}' for v in q)}],{axes}],v50,fine,grip;"]
        lines += [f"MoveL [{pose},[{quadrants},0],{axes}],v50,fine,grip;"]
    return "\n".join([*lines, "ENDPROC", "ENDMODULE"])


def sent(language: str, arm: Arm, result: ProgramCorrection) -> np.ndarray:
    """Joints (6, 6), rad, to which the controller goes by a corrected program: at its joint targets, then its poses."""
    lines = [line for line in result.content.decode().splitlines() if re.match(r"PTP|LIN|Move|movej|movel", line)]
    values = [np.array([float(v) for v in re.findall(rf"(?<![A-Za-z\d]){NUMBER}", line)]) for line in lines]
    joints = [each[:6] if language == "URScript" else np.radians(each[:6]) for each in values[::2]]
    poses = [of_maker(language, each[: 7 if language == "RAPID" else 6]) @ np.linalg.inv(TOOL) for each in values[1::2]]
    told = [inverse(partial(stands, arm.places), pose, q) for pose, q in zip(poses, Q, strict=True)]
    return np.array([*joints, *told])


@pytest.mark.parametrize("kind", ["pose", "position"])
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_corrected_program_brings_the_tool_where_it_was_to_go(
    language: str, kind: str, arm: Arm, tmp_path: Path
) -> None:
    path = tmp_path / f"prog{LANGUAGES[language]}"
    path.write_text(program(language, arm))
    result = corrected_program(load_program(path), arm.nominal, arm.model, Q, kind=kind)
    assert result.reached, [move.reason for move in result.targets]
    promised = 3.0 * np.sqrt(3.0) * np.max(result.correction.sigma_mm)
    wanted, before, after = (
        np.array([(stands(places, q) @ TOOL)[:3, 3] for q in joints])
        for places, joints in ((arm.places, [*Q, *Q]), (arm.true, [*Q, *Q]), (arm.true, sent(language, arm, result)))
    )
    (scanner_T_base,) = arm.model.scanner_T_base.values()  # the points' frame is that of the true base
    wanted = apply(scanner_T_base, wanted)
    assert np.linalg.norm(before - wanted, axis=1).min() > 5.0 * promised
    assert np.linalg.norm(after - wanted, axis=1).max() < promised


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_it_is_the_same_where_the_last_row_of_the_table_leads_to_the_flange(
    kind: str, arm: Arm, tmp_path: Path
) -> None:
    true = calib.load_robot(urdf(tmp_path / "true.urdf", arm.true))
    true = with_own_tool_point(true, apply(true.flange.transform, TOOL[:3, 3]))
    table = arm.nominal.table
    assert table[-2, 0] == 0.0
    table[-2:] = [table[-2] + table[-1], np.zeros(5)]
    in_row = with_own_tool_point(replace(arm.nominal.with_table(table), flange=FixedFrame()), TOOL[:3, 3])
    path = tmp_path / "prog.src"
    path.write_text(program("KRL", arm))
    one, other = (
        sent("KRL", arm, corrected_program(load_program(path), robot, true, Q, kind=kind))
        for robot in (arm.nominal, in_row)
    )
    np.testing.assert_allclose(one, other, atol=2e-8)
    for q, wanted in zip(one, [*Q, *Q], strict=True):
        at = (stands(arm.true, q) @ TOOL)[:3, 3]
        assert np.linalg.norm(at - (stands(arm.places, wanted) @ TOOL)[:3, 3]) < 1e-3


def test_the_flange_is_the_link_tool0_and_is_kept(arm: Arm, tmp_path: Path) -> None:
    calib.save_robot(arm.nominal, tmp_path / "robot.toml")
    tip = "<link name='probe'/><joint name='p' type='fixed'><parent link='tool0'/><child link='probe'/>"
    longer = urdf(tmp_path / "longer.urdf", arm.places)
    longer.write_text(longer.read_text().replace("</robot>", f"{tip}<origin xyz='0 0 0.2'/></joint></robot>"))
    for path in (tmp_path / "robot.toml", longer):
        found = flange_frames(calib.load_robot(path), Q)
        np.testing.assert_allclose(found, [stands(arm.places, q) for q in Q], atol=1e-9)
