"""Several targets on the tool and one on a link before the last, from a user's tables to the diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset.files.robot_toml import builtin_robot, robot_to_toml
from calib.kinematics.robot import Robot
from tests.support.commands import answered, printed, refused

pytestmark = pytest.mark.slow

TARGETS = """
[[targets]]
name = "ball"
xyz_mm = [60.0, 0.0, 100.0]

[[targets]]
name = "elbow"
xyz_mm = [-100.0, 50.0, 20.0]
joint = 3
"""


def rot(axis: str, angle: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return out


def frames(robot: Robot, table: np.ndarray, q: np.ndarray) -> list[np.ndarray]:
    """base_T_frame 1..n and of the tool, by the paper's product."""
    out, at = [], np.eye(4)
    for (a, alpha, d, theta, beta), value in zip(table, [*q, 0.0], strict=True):
        shift = np.eye(4)
        shift[:3, 3] = [a, 0.0, d]
        at = at @ rot("z", theta + value) @ shift @ rot("x", alpha) @ rot("y", beta)
        out.append(at)
    return out


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("targets")
    rng, robot = np.random.default_rng(5), builtin_robot("rb5")
    (folder / "robot.toml").write_text(robot_to_toml(robot) + TARGETS)
    table = robot.table + rng.normal(0, 1, robot.table.shape) * [0.4, 0.002, 0.4, 0.002, 0.002]
    joints, points = ["pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"], ["pose,target,x_mm,y_mm,z_mm"]
    for k, q in enumerate(rng.uniform(-1.5, 1.5, (32, 6))):
        at = frames(robot, table, q)
        joints.append(",".join([f"p{k}", *(repr(float(v)) for v in np.degrees(q))]))
        places = {
            "jig": at[6][:3, 3],
            "ball": (at[5] @ [60.2, 0.1, 99.8, 1.0])[:3],
            "elbow": (at[2] @ [-100.1, 50.2, 20.0, 1.0])[:3],
        }
        for name, place in places.items():
            turned = Rotation.from_euler("z", 0.7).apply(place)
            seen = turned + np.array([900.0, -300.0, 200.0]) + rng.normal(0, 0.03, 3)
            points.append(",".join([f"p{k}", name, *(repr(float(v)) for v in seen)]))
    (folder / "joints.csv").write_text("\n".join(joints) + "\n")
    (folder / "points.csv").write_text("\n".join(points) + "\n")
    tables = ["--joints", str(folder / "joints.csv"), "--points", str(folder / "points.csv")]
    printed("import", folder / "cell", "--robot", folder / "robot.toml", *tables)
    return folder


def test_targets_by_name_are_calibrated_and_what_the_tool_row_tells_is_said(cell: Path) -> None:
    found = answered("calibrate", cell / "cell")
    assert found["test"]["rmse_mm"] < 0.08  # noise of 0.03 mm a coordinate
    places = {p["name"]: p["value"] for p in found["parameters"] if p["name"].startswith("elbow.")}
    assert places["elbow.x"] == pytest.approx(-100.1, abs=0.1)
    assert places["elbow.y"] == pytest.approx(50.2, abs=0.1)
    assert {"alphaTCP", "betaTCP"} <= set(found["tool"]["unseen"])
    assert "sums only: aTCP" in printed("calibrate", cell / "cell")


def test_nothing_is_missing_where_only_links_are_off(cell: Path) -> None:
    assert answered("diagnose", cell / "cell")["verdict"] == "adequate"


def test_names_that_a_robot_lacks_become_its_targets(cell: Path, tmp_path: Path) -> None:
    tables = ["--joints", str(cell / "joints.csv"), "--points", str(cell / "points.csv")]
    said = printed("import", tmp_path / "new", "--robot", "rb5", *tables)
    assert "places of targets by the nominal arm, from which the fit moves them: ball at" in said
    assert "ball" in (tmp_path / "new" / "robot.toml").read_text()
    both = [f"{line},{','.join('0' * 6)}" for line in (cell / "points.csv").read_text().splitlines()[1:]]
    head = "pose,target,x_mm,y_mm,z_mm,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
    (tmp_path / "both.csv").write_text("\n".join([head, *both]))
    robot = ["--robot", str(cell / "robot.toml")]
    assert "the joints are the same in all" in refused(
        "import", tmp_path / "cell", *robot, "--joints", tmp_path / "both.csv"
    )
