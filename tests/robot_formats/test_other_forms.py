"""Kinematics YAML and tables of a robot, each compared with independent code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.kinematics.robot import FixedFrame, Robot
from calib.robot_formats.calibrated_file import calibrated_yaml
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from tests.support.chains import joint, link, urdf_of
from tests.support.robot_texts import FRANKA, UR_YAML
from tests.support.standard_dh import joints_at_random, rot, standard, tips, trans

UR10 = np.array([  # theta, a, d, alpha, rad and mm: universal-robots.com
    (0.0, 0.0, 127.3, np.pi / 2), (0.0, -612.0, 0.0, 0.0), (0.0, -572.3, 0.0, 0.0),
    (0.0, 0.0, 163.941, np.pi / 2), (0.0, 0.0, 115.7, -np.pi / 2), (0.0, 0.0, 92.2, 0.0),
])  # fmt: skip


# ---- kinematics YAML ------------------------------------------------------------------------------------------------


def test_a_kinematics_file_is_read_about_fixed_axes_and_the_exporters_error_is_told(tmp_path: Path) -> None:
    path = tmp_path / "ur10.yaml"
    path.write_text(UR_YAML)
    found = read_robot(path)
    blocks = {k: v for k, v in pytest.importorskip("yaml").safe_load(UR_YAML)["kinematics"].items() if k != "hash"}
    q = joints_at_random(50, 6)
    for values, mine in zip(q, tips(found.robot, q), strict=True):
        theirs = np.eye(4)
        for block, value in zip(blocks.values(), values, strict=True):
            x, y, z, *rpy = (float(block[key]) for key in ("x", "y", "z", "roll", "pitch", "yaw"))
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
            theirs = theirs @ trans(1e3 * x, 1e3 * y, 1e3 * z) @ turn @ rot("z", value)
        assert mine == pytest.approx(theirs, abs=1e-9)
    assert "writes turns about moving axes there" in found.summary


def test_only_numbers_change_in_a_kinematics_file_and_the_hash_stays(tmp_path: Path) -> None:
    path = tmp_path / "ur10.yaml"
    path.write_text(UR_YAML)
    nominal = read_robot(path).robot
    assert calibrated_yaml(path, nominal, nominal).content == UR_YAML.encode()
    table = nominal.table
    table[2] += [0.1, 0.001, 0.0, 0.002, 0.001]
    out = calibrated_yaml(path, nominal.with_table(table), nominal)
    assert out.changed == ("forearm", "wrist_1")
    assert b"calib_12788084448423163542" in out.content
    assert b"# nearly parallel" in out.content
    (tmp_path / "again.yaml").write_bytes(out.content)
    q = joints_at_random(20, 6)
    again = read_robot(tmp_path / "again.yaml").robot
    assert np.abs(tips(again, q) - tips(nominal.with_table(table), q)).max() < 1e-9


def test_a_kinematics_file_may_start_from_another_link_than_robot_toml(tmp_path: Path) -> None:
    path = tmp_path / "ur10.yaml"
    path.write_text(UR_YAML)
    here = read_robot(path).robot
    turned = Robot(here.name, here.joints, here.tool, base=FixedFrame((5.0, 6.0, 7.0), (0.0, 0.0, np.pi)))
    assert calibrated_yaml(path, turned, turned).changed == ()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("    yaw: 0\n", "", "line 2: shoulder has no yaw"),
        ("z: 0.1273", "z: 0.12.73", r"line 5: z of shoulder is '0\.12\.73'"),
        ("z: 0.1273", "z: &a 0.1273", "line 5: found '&a 0.1273'"),
        ("z: 0.1273", "z: .inf", "line 5: z of shoulder"),
        ("z: 0.1273", "x: 0.1273", "line 5: 'x' stands there twice"),
        ("    x: 0\n", "    - 0\n", "shoulder has no x"),
        ("  shoulder:", "\tshoulder:", "line 2: the line is indented by tabs"),
        ("yaw: 0.0003}", "yaw: 0.0003", "line 16: found .* on one line"),
        (UR_YAML, "a: 1\n", "found no block"),
        (UR_YAML, "\n".join(" " * k + "a:" for k in range(50)), "too many levels"),
    ],
)
def test_a_damaged_kinematics_file_is_told_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "ur10.yaml"
    path.write_text(UR_YAML.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said):
        read_robot(path)


# ---- tables ---------------------------------------------------------------------------------------------------------


def modified(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Tip transform (4, 4) of a modified Denavit-Hartenberg table with rows a, d, alpha, theta."""
    out = np.eye(4)
    for (a, d, alpha, theta), value in zip(rows, q, strict=True):
        out = out @ rot("x", alpha) @ trans(a, 0, 0) @ rot("z", theta + value) @ trans(0, 0, d)
    return out


def test_a_modified_table_as_franka_publishes_it(tmp_path: Path) -> None:
    path = tmp_path / "franka.csv"
    path.write_text(FRANKA)
    robot = read_robot(path, ReadOptions(convention="modified")).robot
    cells = np.array([line.split(",")[1:5] for line in FRANKA.splitlines()[1:]], dtype=float)
    rows = cells * [1e3, 1e3, np.pi / 180, np.pi / 180]
    q = joints_at_random(100, 7)
    theirs = np.array([modified(rows, [*values, 0.0]) for values in q])
    assert np.abs(tips(robot, q) - theirs)[:, :3, 3].max() < 1e-9
    assert [j.name for j in robot.joints] == [f"J{k}" for k in range(1, 8)]
    assert (robot.joints[0].min, robot.joints[2].min) == (-2.9, None)


def test_a_table_in_the_wrong_convention_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "franka.csv"
    path.write_text(FRANKA)
    with pytest.raises(RobotFileError, match="joints 1 and 2 turn about one axis, and as modified none do"):
        read_robot(path, ReadOptions(convention="standard"))
    with pytest.raises(RobotFileError, match=r"give --convention .* by its axes it looks modified"):
        read_robot(path)
    rows = UR10
    lines = ["theta_rad,a_mm,d_mm,alpha_rad", *(",".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join(lines))
    q = joints_at_random(20, 6)
    robot = read_robot(path, ReadOptions(convention="standard")).robot
    assert np.abs(tips(robot, q) - [standard(rows, values) for values in q]).max() < 1e-9


UR5E = """Kinematics,theta [rad],a [m],d [m],alpha [rad]
Joint 1,0,0,0.1625,π/2
Joint 2,0,-0.425,0,0
Joint 3,0,-0.3922,0,0
Joint 4,0,0,0.1333,pi / 2
Joint 5,0,0,0.0997,−π/2
Joint 6,4π/2,0,0.0996,0.0*pi
"""


def test_angles_as_a_maker_prints_them_in_parts_of_pi(tmp_path: Path) -> None:
    path = tmp_path / "ur5e.csv"
    path.write_text(UR5E, encoding="utf-8")
    half = np.pi / 2
    lengths = [(0, 162.5), (-425, 0), (-392.2, 0), (0, 133.3), (0, 99.7), (0, 99.6)]
    rows = np.array([(0.0, a, d, alpha) for (a, d), alpha in zip(lengths, [half, 0, 0, half, -half, 0], strict=True)])
    q = joints_at_random(20, 6)
    robot = read_robot(path, ReadOptions(convention="standard")).robot
    assert np.abs(tips(robot, q) - [standard(rows, values) for values in q]).max() < 1e-9


@pytest.mark.parametrize("cell", ["π/0", "π/2/2", "2π2", "pie", ".π", "1e3π", "π²"])
def test_what_is_no_part_of_pi_is_no_number(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "ur5e.csv"
    path.write_text(UR5E.replace("pi / 2", cell), encoding="utf-8")
    with pytest.raises(Exception, match="line 5, column alpha"):
        read_robot(path, ReadOptions(convention="standard"))


def test_parts_of_pi_are_no_degrees(tmp_path: Path) -> None:
    path = tmp_path / "ur5e.csv"
    path.write_text(UR5E.replace("[rad]", "[deg]"), encoding="utf-8")
    with pytest.raises(Exception, match="a number is needed"):
        read_robot(path, ReadOptions(convention="standard"))


@pytest.mark.parametrize("by_points", [True, False])
def test_screw_axes_at_home(tmp_path: Path, by_points: bool) -> None:
    rng = np.random.default_rng(1)
    w = rng.normal(size=(5, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    p = rng.uniform(-0.5, 0.5, (5, 3))
    v = -np.cross(w, p)
    w[3], v[3] = 0.0, [0.0, 0.6, 0.8]
    home = trans(0.1, 0.2, 0.9) @ rot("xyz", [0.1, 0.2, 0.3])
    if by_points:
        w[3], p[3] = [0.0, 0.6, 0.8], 0.0
        lines = ["name,type,wx,wy,wz,px_m,py_m,pz_m,roll_rad,pitch_rad,yaw_rad"]
        lines += [
            f"J{k},{'prismatic' if k == 3 else 'revolute'}," + ",".join(map(repr, map(float, [*w[k], *p[k]]))) + ",,,"
            for k in range(5)
        ]
        lines.append("home,fixed,0,0,0,0.1,0.2,0.9,0.1,0.2,0.3")
        w[3] = 0.0
    else:
        home = np.eye(4)
        lines = ["type,wx,wy,wz,vx,vy,vz"]
        lines += [
            f"{'prismatic' if k == 3 else 'revolute'}," + ",".join(map(repr, map(float, [*w[k], *v[k]])))
            for k in range(5)
        ]
    path = tmp_path / "poe.csv"
    path.write_text("\n".join(lines))
    robot = read_robot(path).robot
    q = rng.uniform(-2, 2, (20, 5)) * [1, 1, 1, 0.3, 1]
    for values, mine in zip(q, tips(robot, q * [1, 1, 1, 1e3, 1]), strict=True):
        theirs = np.eye(4)
        for k, value in enumerate(values):
            twist = np.zeros((4, 4))
            twist[:3, :3] = [[0, -w[k][2], w[k][1]], [w[k][2], 0, -w[k][0]], [-w[k][1], w[k][0], 0]]
            twist[:3, 3] = v[k]
            theirs = theirs @ expm(twist * value)
        theirs = theirs @ home
        theirs[:3, 3] *= 1e3
        if not by_points:  # without a home pose the tip is the last joint's own frame, where it has no place to tell
            continue
        assert mine == pytest.approx(theirs, abs=1e-8)


def test_joint_origins_as_a_table(tmp_path: Path) -> None:
    path = tmp_path / "origins.csv"
    path.write_text(
        "name;x_m;y_m;z_m;roll_deg;pitch_deg;yaw_deg;axis_x;axis_y;axis_z\nA;0;0;0,5;0;0;90;0;0;1\nB;0,1;0;0;0;0;0;0;-2;0\ntool;0;0;0,3;0;0;0;0;0;1\n"
    )
    arm = tmp_path / "arm.urdf"
    arm.write_text(
        urdf_of(
            link("a") + link("b") + link("c") + link("d"),
            joint("A", "a", "b", "0 0 0.5", "0 0 1.5707963267948966")
            + joint("B", "b", "c", "0.1 0 0", axis="0 -1 0")
            + joint("t", "c", "d", "0 0 0.3", type="fixed"),
        )
    )
    q = joints_at_random(20, 2)
    assert np.abs(tips(read_robot(path).robot, q) - tips(read_robot(arm).robot, q)).max() < 1e-9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "line 1: found a, b; expected theta, d, a, alpha"),
        (FRANKA.replace("a_m", "a"), "column 'a' tells no unit"),
        (FRANKA.replace("0.316", "0.3x"), "line 4, column d_m: found '0.3x'"),
        (FRANKA.replace("0.316", "1e300"), "line 4: column d_m: 1e.303 is beyond"),
        ("", "the file is empty"),
        ("name,wx,wy,wz,px_m,py_m,pz_m\nJ1,0,0,0,1,1,1\n", "line 2: the axis has no direction"),
    ],
)
def test_a_damaged_table_is_told_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(Exception, match=said):
        read_robot(path, ReadOptions(convention="modified" if "theta" in text else None))


@pytest.mark.parametrize(
    ("name", "content"), [("a.csv", b"a,b\n1,2\n3,\xff\n"), ("a.yaml", b"a:\n  b: 1\n  c: \xff\n")]
)
def test_a_byte_that_is_no_text_is_told_with_its_line(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CalibError, match=r"line 3: .* save it as UTF-8"):
        read_robot(tmp_path / name)


@pytest.mark.parametrize(("name", "says"), [("arm.sdf", "give the arm's URDF"), ("arm.srdf", "as --base and --tip")])
def test_forms_that_are_not_read_say_what_to_give(name: str, says: str) -> None:
    with pytest.raises(CalibError, match=says):
        read_robot(Path(name))
