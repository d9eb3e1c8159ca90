"""Postures of a program's poses: by status and turn, by a configuration, and kept along the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import calib
from calib.extras.robot_programs.program_correction import ProgramCorrection, corrected_program
from calib.extras.robot_programs.program_targets import load_program
from tests.extras.robot_programs.controllers import Arm, inverse, listed, makers, transform

KUKA = Arm.of(  # lies stretched forward at zero, as a KR 10 with an offset of 20 mm behind axis 3
    [[0, 0, 450], [150, 0, 225], [610, 0, 0], [660, 0, 20], [0, 0, 0], [0, 0, 0], [80, 0, 0]],
    [[0, 0, 0]] * 7,
    [[0, 0, -1], [0, 1, 0], [0, 1, 0], [-1, 0, 0], [0, 1, 0], [-1, 0, 0]],
)
ABB = Arm.of(  # stands with the lower arm upright and the upper arm forward at zero
    [[0, 0, 445], [150, 0, 0], [0, 0, 700], [795, 0, 115], [0, 0, 0], [0, 0, 0], [85, 0, 0]],
    [[0, 0, 0]] * 7,
    [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]],
)
HEAD = "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n"


def is_behind(arm: Arm, q: np.ndarray) -> bool:
    """Whether the wrist is behind axis 1, by its place in the frame that turns with it."""
    turned = Rotation.from_rotvec(arm.axes[0] * q[0]).inv()
    return bool(turned.apply((arm.stands(q) @ np.linalg.inv(arm.places[-1]))[:3, 3])[0] < 0.0)


def drawn(arm: Arm, count: int) -> np.ndarray:
    """Joints all over, none of which stands near a singular posture."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.8, 2.8, (60 * count, 6))
    wrist = np.abs(np.sin(q[:, 4])) > 0.3
    reach = np.array([abs((arm.stands(one) @ np.linalg.inv(arm.places[-1]))[:2, 3] @ [1, 0]) > 150.0 for one in q])
    return q[wrist & reach & (np.abs(np.sin(q[:, 2])) > 0.3) & (np.abs(np.cos(q[:, 2])) > 0.3)][:count]


def corrected(arm: Arm, name: str, text: str, folder: Path, true: Arm | None = None) -> ProgramCorrection:
    path = folder / name
    path.write_text(text)
    robots = [calib.load_robot(one.urdf(folder / f"{k}.urdf")) for k, one in enumerate((arm, true or arm))]
    return corrected_program(load_program(path), *robots)


def krl(arm: Arm, q: np.ndarray, motion: str, hint: str = "") -> str:
    return f"{motion} {{{listed('KRL', makers('KRL', arm.stands(q)))}{hint}}}\n"


def axes(q: np.ndarray) -> str:
    return f"PTP {{{','.join(f'A{k + 1} {v:.9f}' for k, v in enumerate(np.degrees(q)))}}}\n"


def test_status_and_turn_tell_the_posture(tmp_path: Path) -> None:
    q = drawn(KUKA, 24)
    stretched = np.arctan2(20.0, 660.0)  # of joint 3
    status = [is_behind(KUKA, one) + 2 * bool(np.sin(one[2] - stretched) > 0.0) + 4 * (one[4] < 0.0) for one in q]
    turns = [sum(int(v < 0.0) << k for k, v in enumerate(one)) for one in q]
    told = [krl(KUKA, one, "PTP", f",S {s},T {t}") for one, s, t in zip(q, status, turns, strict=True)]
    result = corrected(KUKA, "a.src", HEAD + "".join(told) + "END\n", tmp_path)
    assert result.reached, [move.reason for move in result.targets]
    np.testing.assert_allclose(result.correction.q_nominal, q, atol=1e-6)
    without = [krl(KUKA, one, "PTP") for one in q]
    open_ = corrected(KUKA, "b.src", HEAD + "PTP home\n".join(["", *without]) + "END\n", tmp_path)
    assert {move.reached for move in open_.targets} == {False}
    assert "posture is not told" in open_.targets[0].reason


def test_quadrants_and_cfx_tell_the_posture(tmp_path: Path) -> None:
    q = drawn(ABB, 24)
    from_forward = q[:, 2] - np.arctan2(115.0, 795.0)  # angle of the way from joint 3 to the wrist
    cfx = [
        4 * is_behind(ABB, one) + 2 * (np.cos(angle) < 0.0) + (one[4] < 0.0)
        for one, angle in zip(q, from_forward, strict=True)
    ]
    found = []
    for flipped in (0, 7):
        lines = ["MODULE M", "PROC main()"]
        for one, x in zip(q, cfx, strict=True):
            cf = ",".join(str(int(np.floor(np.degrees(one[k]) / 90.0))) for k in (0, 3, 5))
            pose = listed("RAPID", makers("RAPID", ABB.stands(one)))
            lines.append(f"MoveJ [{pose},[{cf},{int(x) ^ flipped}],[9E9,9E9,9E9,9E9,9E9,9E9]],v50,fine,tool0;")
        result = corrected(ABB, "a.mod", "\n".join([*lines, "ENDPROC", "ENDMODULE"]), tmp_path)
        assert result.reached, [move.reason for move in result.targets]
        found.append(result.correction.q_nominal)
    np.testing.assert_allclose(found[0], q, atol=1e-6)
    assert np.abs(found[1] - q).max() > 0.1  # two postures share the quadrants


def straight(arm: Arm, q: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Joints at the end of a straight way from joints, by steps of the test's own."""
    start = arm.stands(q)
    turns = Slerp([0.0, 1.0], Rotation.from_matrix([start[:3, :3], goal[:3, :3]]))
    for share in np.linspace(0.0, 1.0, 41)[1:]:
        q = inverse(arm.stands, transform(turns(share), (1.0 - share) * start[:3, 3] + share * goal[:3, 3]), q)
    return q


@pytest.mark.parametrize("language", ["KRL", "URScript"])
def test_a_linear_motion_keeps_the_posture_of_its_start(language: str, tmp_path: Path) -> None:
    start = np.array([0.4, -1.4, 1.3, 2.6, 0.5, -0.7])
    changes = [0.2, 0.1, -0.1, -0.9, 0.3, 0.4], [-0.3, 0.2, 0.1, 0.6, -0.2, 1.0]
    goals = [KUKA.stands(start + np.array(change)) for change in changes]
    q = [start, straight(KUKA, start, goals[0])]
    q.append(straight(KUKA, q[1], goals[1]))
    one, two = (listed(language, makers(language, goal)) for goal in goals)
    name, text = "a.src", f"{HEAD}LIN {{{two}}}\n{axes(start)}LIN {{{one}}}\nLIN {{{two}}}\nEND\n"
    if language == "URScript":
        joints = ",".join(f"{v:.12f}" for v in start)
        text = f"set_tcp(p[0,0,0,0,0,0])\nmovel({two})\nmovej([{joints}])\nmovel({one})\nmovel({two})\n"
        name = "a.script"
    true = KUKA.with_errors(np.random.default_rng(1))
    result = corrected(KUKA, name, text, tmp_path, true)
    assert [move.reached for move in result.targets] == [False, True, True, True]
    assert "its posture is not told" in result.targets[0].reason
    np.testing.assert_allclose(result.correction.q_nominal, q, atol=1e-6)


def test_elements_of_arrays_keep_postures_where_their_index_is_told(tmp_path: Path) -> None:
    start = np.array([0.4, -1.4, 1.3, 2.6, 0.5, -0.7])
    pose = listed("KRL", makers("KRL", KUKA.stands(start + 0.1)))
    held = f"{HEAD}DECL POS P[2]\nP[1]={{{pose}}}\nP[2]={{{pose}}}\n{axes(start)}"
    told = corrected(KUKA, "a.src", f"{held}LIN P[1]\nLIN P[2]\nEND\n", tmp_path)
    assert told.reached
    assert [move.posture for move in told.targets] == ["PTP", "P[1]", ""]
    open_ = corrected(KUKA, "a.src", f"{held}FOR i=1 TO 2\nLIN P[i]\nENDFOR\nEND\n", tmp_path)
    assert not open_.reached


@pytest.mark.parametrize(
    ("name", "moves"), [("a.src", "PTP_REL {A5 10}"), ("a.src", "PTP home"), ("a.script", "speedj(v)")]
)
def test_behind_a_motion_to_nowhere_known_no_posture_is_told(name: str, moves: str, tmp_path: Path) -> None:
    start = np.array([0.4, -1.4, 1.3, 2.6, 0.5, -0.7])
    language = "KRL" if name == "a.src" else "URScript"
    pose = listed(language, makers(language, KUKA.stands(start)))
    text = f"{HEAD}{axes(start)}{moves}\nLIN {{{pose}}}\nEND\n"
    if language == "URScript":
        text = f"set_tcp(p[0,0,0,0,0,0])\nmovej({start.tolist()})\n{moves}\nmovel({pose})\n"
    assert [move.reached for move in corrected(KUKA, name, text, tmp_path).targets] == [True, False]


def test_a_way_through_a_singular_posture_tells_none(tmp_path: Path) -> None:
    start = np.array([0.4, -1.4, 1.3, 0.0, 0.3, -0.7])
    flipped = KUKA.stands(start * [1, 1, 1, 1, -1, 1])  # the wrist has to pass the middle, or to turn over
    text = f"{HEAD}{axes(start)}LIN {{{listed('KRL', makers('KRL', flipped))}}}\nEND\n"
    (_, left) = corrected(KUKA, "a.src", text, tmp_path).targets
    assert "passes a singular posture" in left.reason
