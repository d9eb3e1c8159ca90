"""Targets found in programs written for these tests, and what of a program is left alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.extras.robot_programs.program_targets import Program, load_program
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform, pose_values
from calib.extras.robot_programs.program_text.targets import NamedFrame
from tests.extras.robot_programs.controllers import LANGUAGES, makers, transform

URSCRIPT = """def prog():
  # q0 = [0, 0, 0, 0, 0, 0]
  textmsg("p[1,2,3,4,5,6]")
  set_tcp(p[0, 0, 0.1, 0, 0, 0])
  q1 = [ 0.1,-1.5E0 ,\t1.25, 0,0.5 , 1]  # a comment, [1,2,3,4,5,6]
  global p1=p[ .1,-.5,+0.3,0,3.14,0]
  wrench = [0, 0, 10, 0, 0, 0]
  movej(q1, a=1.4, v=1.05)
  movel(p1, 1.2)
  movel(pose_trans(p1, p[0, 0, -0.1, 0, 0, 0]))
  movej([d2r(10), 0, 0, 0, 0, 0])
  movec(p[.1,-.5,.3,0,3.14,0], p[.1,-.4,.3,0,3.14,0], 1.0)
  q2 = get_inverse_kin(p[.2,-.5,.3,0,3.14,0], qnear=[0,0,0,0,0,0])
  force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], wrench, 2, [0.1,0.1,0.1,0.1,0.1,0.1])
  speedj([0.2,0.3,0.1,0.05,0,0], 0.5, 0.5)
  movej([1e400, 0, 0, 0, 0, 0])
  x = q1[0]
end
"""
KRL = """&ACCESS RVP\r
DEF main()\r
DECL E6POS P3\r
; PTP {A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\r
$TOOL={X 0,Y 0,Z 100,A 0,B 0,C 0}\r
$BASE = {x 500,y 0,Z 0,a 90,B 0,C 0}\r
ptp {A1 0, A2 -90,A3 90.5,A4 1.5e1,A5 - 5,a6 0, E1 17.5} C_PTP\r
LIN {X 1,Y 2,Z 3,A 10,B 20,C 30,S 'B110',T 'B000011'} C_DIS\r
LIN {X 100}\r
LIN_REL {X 1,Y 2,Z 3,A 10,B 20,C 30}\r
P3={E6POS: X 1,Y 2,Z 3,A 10,B 20,C 30,S 2,T 35,E1 0}\r
LIN P3:{X 1,Y 2,Z 3,A 10,B 20,C 30}\r
$BASE=BASE_DATA[3]\r
CIRC {X 7,Y 2,Z 3,A 10,B 20,C 30},{X 1,Y 2,Z 3,A 10,B 20,C turn}\r
LOAD_DATA[1]={M 10,CM {X 0,Y 0,Z 0,A 0,B 0,C 0}}\r
END\r
"""
KRL_DATA = """DEFDAT a
DECL E6POS XP1={X 1,Y 2,Z 3,A 10,B 20,C 30,S 2,T 35,E1 0,E2 0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " {X 1"}
DECL FRAME F1={X 1,Y 2,Z 3,A 10,B 20,C 30}
TOOL_DATA[1]={X 0,Y 10,Z 100,A 0,B 0,C 0}
ENDDAT
"""
RAPID = """MODULE M
  CONST jointtarget j1:=[[0,1,2,3,30,5],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p10 := [[600,0,800.5],[0.70711,0,.70711,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]; ! [[1,2,3],[1]]
  LOCAL CONST robtarget pts{2}:=[[[600,1,800.5],[1,0,0,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],
     [[600,2,800.5],[1,0,0,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  PERS tooldata tool1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wobj1:=[FALSE,TRUE,"",[[500,0,0],[1,0,0,0]],[[0,10,0],[1,0,0,0]]];
  PERS pose shift:=[[1,2,3],[1,0,0,0]];
  PROC main()
    TPWrite "[[1,2,3,4,5,6],[1,2,3,4,5,6]]";
    MoveAbsJ j1, v100, fine, tool0;
    MoveL p10,v100,z10,tool1\\WObj:=wobj1;
    MoveL Offs(p10,0,0,10),v100,z10,tool1\\WObj:=wobj1;
    movej PTS{1},v100,z10,TOOL1;
    MoveL [[600,3,800.5],[1,0,0,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,z10,tool2\\WObj:=wobj1;
  ENDPROC
ENDMODULE
"""


def program(folder: Path, name: str, text: str | bytes) -> Program:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return load_program(path)


def frames(found: Program) -> dict[str, tuple[str, str]]:
    """Tool and work frame of each pose target, by its name and line."""
    return {
        f"{t.name} {t.line}": (t.tool.name, t.work.name)
        for t in found.targets
        if t.tool is not None and t.work is not None
    }


def reasons(found: Program) -> dict[int, str]:
    return {each.line: each.reason for each in found.left}


def told(found: Program) -> dict[str, list[float]]:
    return {f"{t.name} {t.line}": t.values.tolist() for t in found.targets}


def shift(frame: NamedFrame | None) -> list[float] | None:
    """Where a target's frame is; None where the program does not define it."""
    assert frame is not None
    return None if frame.transform is None else frame.transform[:3, 3].tolist()


def test_urscript_targets_are_those_that_the_arm_is_sent_to(tmp_path: Path) -> None:
    found = program(tmp_path, "a.script", URSCRIPT)
    assert told(found) == {
        "q1 5": [0.1, -1.5, 1.25, 0.0, 0.5, 1.0],
        "p1 6": [0.1, -0.5, 0.3, 0.0, 3.14, 0.0],
        "movej 11": [pytest.approx(np.radians(10.0)), 0.0, 0.0, 0.0, 0.0, 0.0],
        "movec 12": [0.1, -0.4, 0.3, 0.0, 3.14, 0.0],
        "get_inverse_kin 13": [0.2, -0.5, 0.3, 0.0, 3.14, 0.0],
    }
    assert [t.kind for t in found.targets] == ["joints", "pose", "joints", "pose", "pose", "pose"]
    assert shift(found.targets[1].tool) == [0.0, 0.0, 100.0]
    assert [each.line for each in found.left] == [4, 7, 10, 13, 14, 14, 14, 15, 16]


def test_krl_targets_have_the_frames_that_are_set_before_them(tmp_path: Path) -> None:
    found = program(tmp_path, "a.src", KRL)
    assert told(found) == {
        "PTP 7": [0.0, -90.0, 90.5, 15.0, -5.0, 0.0],
        "LIN 8": [1.0, 2.0, 3.0, 10.0, 20.0, 30.0],
        "P3 11": [1.0, 2.0, 3.0, 10.0, 20.0, 30.0],
        "CIRC 14": [7.0, 2.0, 3.0, 10.0, 20.0, 30.0],
    }
    lin, circ = found.targets[1], found.targets[3]
    assert shift(lin.work) == [500.0, 0.0, 0.0]
    assert [low < 0.0 for low, _ in lin.configuration.ranges_deg] == [True, True, False, False, False, False]
    assert frames(found)["CIRC 14"][1] == "BASE_DATA[3]"
    assert shift(circ.work) is None
    assert [each.line for each in found.left] == [5, 6, 9, 10, 12, 14, 15]
    assert "external axes move (line 7)" in found.notes[-1]


def test_krl_points_of_inline_forms_have_the_frames_of_their_fdat(tmp_path: Path) -> None:
    (target,) = program(tmp_path, "a.dat", KRL_DATA).targets
    assert shift(target.tool) == [0.0, 10.0, 100.0]
    assert target.work == NamedFrame("$NULLFRAME", np.eye(4))
    assert not program(tmp_path, "b.dat", KRL_DATA.replace("XP1", "XQ1")).notes


def test_rapid_targets_have_the_frames_of_their_moves(tmp_path: Path) -> None:
    found = program(tmp_path, "a.mod", RAPID)
    assert list(told(found)) == ["j1 2", "p10 3", "pts{1} 4", "MoveL 15"]
    p10 = found.targets[1]
    assert shift(p10.work) == [500.0, 10.0, 0.0]
    assert p10.configuration.ranges_deg[0] == (0.0, 90.0)
    assert p10.configuration.ranges_deg[3] == (-90.0, 0.0)
    assert frames(found)["pts{1} 4"] == ("tool1", "wobj0")
    assert frames(found)["MoveL 15"] == ("tool2", "wobj1")
    assert shift(found.targets[3].tool) is None
    assert [each.line for each in found.left] == [5, 6, 7]
    assert not found.notes


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("MoveAbsJ j1, v100, fine, tool0;", "MoveL p10,v100,z10,tool0;", 3, "several tools, tool0 and tool1"),
        (
            "  PERS pose",
            "  CONST robtarget up:=[[1,2,3],straight,[0,0,0,0],ext];\n  PERS pose",
            8,
            "not all plain numbers",
        ),
        ("  PROC main()", "  PROC main()\n    p10.trans.z := 5;", 3, "line 10 sets p10.trans.z anew"),
        ("[[0,1,2,", "[[0,1,2+x,", 2, "2+x is an expression"),
    ],
)
def test_what_of_a_module_is_left_has_its_reason(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    assert said in reasons(program(tmp_path, "a.mod", RAPID.replace(old, new, 1)))[line]


def test_tools_that_a_module_changes_are_not_known_and_external_axes_are_told(tmp_path: Path) -> None:
    text = RAPID.replace("  PROC main()", "  PROC main()\n    tool1.tframe.trans.z := 5;")
    found = program(tmp_path, "a.mod", text.replace("[0,-1,0,1],[9E9", "[0,-1,0,1],[1200.5", 1))
    assert shift(found.targets[1].tool) is None
    assert "external axes move (line 3)" in found.notes[-1]


def test_a_move_behind_a_condition_may_not_have_been_made(tmp_path: Path) -> None:
    end = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    text = f"""MODULE M
CONST jointtarget home:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
CONST robtarget p:=[[600,0,100],[0,0,1,0],{end};
CONST robtarget q:=[[600,0,200],[0,0,1,0],{end};
PROC main()
  MoveAbsJ home,v100,fine,tool0;
  IF di1=1 MoveL p,v100,z10,tool0;
  MoveL q,v100,z10,tool0;
ENDPROC
ENDMODULE
"""
    home, p, q = program(tmp_path, "a.mod", text).targets
    assert [each.after for each in q.arrivals] == [frozenset([home.place, p.place])]


@pytest.mark.parametrize(
    ("name", "text"), [("a.script", URSCRIPT), ("a.src", KRL), ("a.dat", KRL_DATA), ("a.mod", RAPID)]
)
def test_nothing_but_the_numbers_of_targets_is_touched(tmp_path: Path, name: str, text: str) -> None:
    content = ("\xef\xbb\xbf" if name == "a.script" else "").encode("latin-1") + text.encode("latin-1") + b"\xfc\xff"
    if name != "a.src":
        content += b"\r\n"
    found = program(tmp_path, name, content)
    assert found.with_values({}) == content
    assert found.with_values({k: t.values for k, t in enumerate(found.targets)}) == content
    changed = found.with_values({k: np.full(len(t.numbers), 0.25) for k, t in enumerate(found.targets)})
    (tmp_path / name).write_bytes(changed)
    again = load_program(tmp_path / name)
    assert all(np.allclose(t.values, 0.25, atol=1e-8) for t in again.targets)
    old = [(n.start, n.end) for t in found.targets for n in t.numbers]
    new = [(n.start, n.end) for t in again.targets for n in t.numbers]
    assert _outside(content, old) == _outside(changed, new)
    assert again.left == found.left


def _outside(content: bytes, spans: list[tuple[int, int]]) -> list[bytes]:
    edges = [0, *(edge for span in sorted(spans) for edge in span), len(content)]
    return [content[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.script", "", "no target"),
        ("a.script", "q = [1, 2, 3\n", "line 1: the bracket [ is never closed"),
        ("a.script", "movej(\n", "never closed"),
        ("a.script", "a)\n", "closes no bracket"),
        ("a.src", "LIN {X 1,Y 2]\n", "line 1 opened {"),
        ("a.src", "LIN {X 100}\n", "the first in line 1"),
        ("a.mod", b"\x00\x01\xff", "byte 0 is zero"),
        ("a.mod", bytes(range(1, 256)) * 20, "no target"),
        ("a.script", "movej([1e400,0,0,0,0,0])\n", "beyond any"),
        ("a.txt", "", "suffix"),
    ],
)
def test_what_is_no_program_is_told_in_one_error(tmp_path: Path, name: str, text: str | bytes, words: str) -> None:
    with pytest.raises(CalibError, match=r"a\.\w+: ") as error:
        program(tmp_path, name, text)
    assert words in str(error.value)


def test_a_huge_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.script"
    with path.open("wb") as file:
        file.truncate(10_000_001)
    with pytest.raises(CalibError, match="has 10 MB"):
        load_program(path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([".script", ".src", ".mod"]),
    st.lists(
        st.sampled_from(
            ["[", "]", "{", "}", "(", ")", ",", "p[", "1", "-2.5e3", " X 1", "A1 2", "LIN ", "=", ":=", ";"]
        )
        | st.sampled_from(["MoveL ", "\n", "#", '"', "movej(", "$BASE=", "CONST robtarget a:=", "\\WObj:=w", "!"]),
        max_size=40,
    ),
)
def test_any_text_is_read_or_refused(tmp_path: Path, suffix: str, parts: list[str]) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("".join(parts))
    try:
        found = load_program(path)
    except CalibError:
        return
    assert found.with_values({k: t.values for k, t in enumerate(found.targets)}) == path.read_bytes()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("language", LANGUAGES)
def test_poses_are_those_of_the_makers_conventions(language: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = transform(Rotation.random(rng=rng), rng.uniform(-900, 900, 3))
    values = makers(language, pose)
    np.testing.assert_allclose(pose_transform(language, values), pose, atol=1e-9)
    turn = values[3:]
    same = {
        "URScript": turn * (1.0 - 2.0 * np.pi / np.linalg.norm(turn)),
        "KRL": np.array([180.0, 180.0, -180.0]) + turn[:3] * [1.0, -1.0, 1.0],
        "RAPID": -turn,
    }[language]
    for form in (values, np.r_[values[:3], same]):  # whichever form the program has, it keeps
        np.testing.assert_allclose(pose_values(language, pose, form), form, atol=1e-9)


@pytest.mark.parametrize("b", [90.0, -90.0])
def test_abc_keep_their_branch_where_a_and_c_are_one_turn(b: float) -> None:
    values = np.array([1.0, 2.0, 3.0, 25.0, b, -40.0])
    np.testing.assert_allclose(pose_values("KRL", pose_transform("KRL", values), values), values, atol=1e-6)


def test_urscript_poses_behind_a_frame_are_targets_in_it(tmp_path: Path) -> None:
    found = program(
        tmp_path,
        "a.script",
        """set_tcp(p[0,0,0.1,0,0,0])
frame = p[0.2,-0.3,0,0,0,1.5]
movel(pose_trans(frame, p[0.1,0,0.3,3.1,0,0]), a=1)
table = p[0.4,-0.3,0,0,0,1.5]
if get_digital_in(1):
  table = p[0.5,-0.3,0,0,0,1.5]
end
movel(pose_trans(table, p[0.1,0,0.4,3.1,0,0]), a=1)
pick = pose_trans(frame, p[0.1,0,0.5,3.1,0,0])
movej(pose = pick)
at = p[0.3,0,0.5,3.1,0,0]
movel(at)
movel(pose_trans(at, p[0,0,-0.1,0,0,0]))
movel(pose_trans(get_actual_tcp_pose(), p[0,0,-0.1,0,0,0]))
here = get_actual_tcp_pose()
movel(pose_trans(here, p[0,0,-0.1,0,0,0]))
movel(pose_trans(plane, p[0,0,0.2,0,3.1,0]))
""",
    )
    assert frames(found) == {
        "movel 3": ("the TCP of line 1", "frame"),
        "pick 9": ("the TCP of line 1", "frame"),
        "at 11": ("the TCP of line 1", "base"),
        "movel 17": ("the TCP of line 1", "plane"),
    }
    left = reasons(found)
    assert left[8] == "it stands behind table, which the program computes"
    assert left[13] == "an offset from at, which moves along with it"
    assert 14 in left
    assert "here, which the program computes" in left[16]


def test_urscript_tools_are_those_of_the_calls(tmp_path: Path) -> None:
    text = """def place():
  movel(p[0.3,0,0.3,0,3.1,0])
  set_tcp(p[0,0,0.3,0,0,0])
end
def prog():
  set_tcp(p[0,0,0.1,0,0,0])
  movel(p[0.4,0,0.3,0,3.1,0])
  place()
  movel(p[0.5,0,0.3,0,3.1,0])
  while True:
    movel(p[0.6,0,0.3,0,3.1,0])
    set_tcp(p[0,0,0.2,0,0,0])
    movel(p[0.7,0,0.3,0,3.1,0])
  end
end
"""
    found = program(tmp_path, "a.script", text)
    assert {name: tool for name, (tool, _) in frames(found).items()} == {
        "movel 2": "the TCP of line 6",
        "movel 7": "the TCP of line 6",
        "movel 9": "the TCP of line 3",
        "movel 13": "the TCP of line 12",
    }
    assert "several tools" in reasons(found)[11]


def test_urscript_lists_degrees_and_hints(tmp_path: Path) -> None:
    found = program(
        tmp_path,
        "a.urscript",
        """set_tcp(p[0,0,0.1,0,0,0])
global W_p=p[.1,-.4,.2,0,3.1,0]
global W_q=[-1.6,-1.7,-2.2,-0.8,1.59,-0.03]
movej(get_inverse_kin(W_p, qnear=W_q), a=1.4)
points = [p[.1,-.4,.3,0,3.1,0], p[.1,-.4,.4,0,3.1,0]]
movel(points[i])
movej([d2r(90), d2r( -45.5 ), 0, 0, 1, d2r(a)])
movej([d2r(90), d2r( -45.5 ), 0, 0, 1, 0])
q = [0, -1.5, 1, 0, 1, 0]
q[0] = 1
movej(q)
speeds = [0, 0, 0, 0, 0, 0]
""",
    )
    assert [(t.name, t.line) for t in found.targets] == [("W_p", 2), ("points[0]", 5), ("points[1]", 5), ("movej", 8)]
    assert found.targets[0].near == (-1.6, -1.7, -2.2, -0.8, 1.59, -0.03)
    np.testing.assert_allclose(found.targets[-1].values[:2], np.radians([90.0, -45.5]))
    left = reasons(found)
    assert left[9] == "line 10 sets q[0] anew"
    assert left[12] == "no motion of the program uses it"
    changed = found.with_values({3: np.array([np.pi / 3.0, 0.0, 0.0, 0.0, 1.0, 0.0])})
    assert b"movej([d2r(60.000000), d2r( 0.000000 ), 0, 0, 1, 0])" in changed


def test_urscript_targets_are_what_motions_go_to(tmp_path: Path) -> None:
    found = program(
        tmp_path,
        "a.script",
        """def go(target, acc=1.2):
  movel(target, a=acc)
end
set_tcp(p[0,0,0.1,0,0,0])
p1 = p[0.1,-0.5,0.3,0,3.1,0]
p2 = p[0.2,-0.5,0.3,0,3.1,0]
p3 = p[0.3,-0.5,0.3,0,3.1,0]
W_p = p[0.4,-0.5,0.3,0,3.1,0]
W_q = [0,-1.5,1.5,0,1.5,0]
go(p1)
above = p2
above[2] = above[2] + 0.1
movel(above)
aside = p3
aside[2] = 0.5
movel(aside)
movel(W_p)
textmsg(pose_dist(p1, get_actual_tcp_pose()))
""",
    )
    assert [t.name for t in found.targets] == ["W_p"]
    assert found.targets[-1].near == (0.0, -1.5, 1.5, 0.0, 1.5, 0.0)
    assert {tool for tool, _ in frames(found).values()} == {"the TCP of line 4"}
    assert [reasons(found)[line] for line in (5, 6, 7)] == ["no motion of the program uses it"] * 3


def test_krl_frames_are_followed_and_a_module_is_read_whole(tmp_path: Path) -> None:
    (tmp_path / "A.DAT").write_text(
        "DEFDAT a\nDECL E6POS XP1={X 1,Y 2,Z 3,A 0,B 90,C 0,S 2,T 2}\nDECL E6POS XP2={X 1,Y 2,Z 4,A 0,B 90,C 0}\n"
        'DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}\n'
        'DECL FDAT FP2={TOOL_NO 1,BASE_NO 0,IPO_FRAME #TCP,POINT2[] " "}\nENDDAT\n'
    )
    (tmp_path / "$config.dat").write_text(
        "TOOL_DATA[1]={X 0,Y 0,Z 100,A 0,B 0,C 0}\nBASE_DATA[3]={X 7,Y 0,Z 0,A 0,B 0,C 0}\n"
    )
    text = """DEF a()
DECL FRAME fb, ft
fb={X 500,Y 0,Z 0,A 0,B 0,C 0}
ft={X 1,Y 2,Z 5,A 0,B 90,C 0}
$LOAD.CM={X 0,Y 0,Z 0,A 0,B 0,C 0}
$TOOL=TOOL_DATA[1]
$BASE=fb
LIN ft C_DIS
SLIN {X 1,Y 2,Z 6,A 0,B 90,C 0} WITH $TOOL=TOOL_DATA[2], $BASE=BASE_DATA[3] C_SPL
SWITCH i
CASE 1
$BASE=BASE_DATA[3]
DEFAULT
$BASE=BASE_DATA[3]
ENDSWITCH
LIN {X 1,Y 2,Z 7,A 0,B 90,C 0}
WAIT FOR $IN[1]
sub()
LIN {X 1,Y 2,Z 8,A 0,B 90,C 0}
IF $IN[1] THEN
$BASE=fb
ENDIF
LIN {X 1,Y 2,Z 9,A 0,B 90,C 0}
SPTP XP1 WITH $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO)
SLIN XP2
END
DEF sub()
$BASE=$NULLFRAME
PTP {X 1,Y 2,Z 10,A 0,B 90,C 0,S 2,T 2}
END
"""
    source = tmp_path / "a.src"
    source.write_text(text)
    found = load_program(source, [tmp_path / "$config.dat"])
    assert frames(found) == {
        "ft 4": ("TOOL_DATA[1]", "fb"),
        "SLIN 9": ("TOOL_DATA[2]", "BASE_DATA[3]"),
        "LIN 16": ("TOOL_DATA[1]", "BASE_DATA[3]"),
        "LIN 19": ("TOOL_DATA[1]", "$NULLFRAME"),
        "PTP 29": ("TOOL_DATA[1]", "$NULLFRAME"),
    }
    assert [t.keeps_posture for t in found.targets] == [True] * 4 + [False]
    assert "another variable of the system" in reasons(found)[5]
    assert "several work frames" in reasons(found)[23]
    point = load_program(tmp_path / "A.DAT", [tmp_path / "$config.dat"])
    assert frames(point) == {"XP1 2": ("TOOL_DATA[1]", "$NULLFRAME")}
    assert "fixed tool" in reasons(point)[3]


def test_rapid_moves_are_followed_into_routines(tmp_path: Path) -> None:
    end = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    tools = tmp_path / "tools.sys"
    tools.write_text(
        "MODULE tools\nPERS tooldata grip:=[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        'PERS wobjdata held:=[TRUE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\nENDMODULE\n'
    )
    text = f"""MODULE M
CONST robtarget pick:=[[600,0,100],[0,0,1,0],{end};
CONST robtarget place:=[[600,0,200],[0,0,1,0],{end};
CONST robtarget handed:=[[600,0,300],[0,0,1,0],{end};
VAR robtarget set:=[[600,0,400],[0,0,1,0],{end};
VAR robtarget up:=[[600,0,500],[0,0,1,0],{end};
CONST robtarget Move1:=[[600,0,600],[0,0,1,0],{end};
CONST robtarget atTool:=[[600,0,700],[0,0,1,0],{end};
PROC main()
  MoveJ pick,v100,z10,grip;
  MoveJ Offs(place,0,0,5),v100,z10,grip;
  Fetch handed\\Fast;
  set.trans.z:=100;
  MoveL set,v100,z10,grip;
  up.trans.z:=up.trans.z+10;
  MoveLDO up,v100,z10,grip,do1,1;
  MoveL Move1,v100,z10,grip,\\WObj:=wobj0;
  ConfL\\Off;
  MoveL atTool,v100,z10,grip\\WObj:=held;
ENDPROC
PROC Fetch(robtarget p\\switch Fast)
  MoveJ p,v100,z10,grip;
ENDPROC
ENDMODULE
"""
    path = tmp_path / "a.modx"
    path.write_text(text)
    found = load_program(path, [tools])
    assert frames(found) == {f"{name}": ("grip", "wobj0") for name in ("pick 2", "place 3", "up 6", "Move1 7")}
    assert [t.keeps_posture for t in found.targets] == [False, False, True, True]
    left = reasons(found)
    assert left[4] == "no motion of the program uses it"
    assert left[5] == "line 13 sets set.trans.z anew"
    assert "robhold" in left[8]


def test_a_file_of_another_language_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.src"
    path.write_text(KRL, newline="")
    (tmp_path / "b.mod").write_text(RAPID)
    with pytest.raises(CalibError, match=r"b\.mod: is RAPID, and .*a\.src is KRL"):
        load_program(path, [tmp_path / "b.mod"])
