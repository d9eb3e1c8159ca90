"""Import plans: meaning and reason of each column, the convention chosen by the points, all faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot, robot_to_toml
from calib.dataset_import.columns import Meaning, meaning_of
from calib.dataset_import.import_dataset import write_plan
from calib.dataset_import.plan import ImportPlan, ImportSources, plan_import
from calib.errors import DatasetError
from calib.kinematics.commanded import commands_in_words
from calib.kinematics.robot import Robot
from calib.robot_formats.conventions import RobotReading, robot_readings
from calib.robot_formats.robot_file import ReadOptions, RobotFile
from calib.robot_formats.robots import robot_content
from calib.simulation.simulate import simulate_dataset
from tests.support.commands import answered
from tests.support.sweeps import sweep

ROBOT = builtin_robot("rb5")
ASKED = (RobotReading("", RobotFile(ROBOT, None)),)
Q = [f"A{k}" for k in range(1, 7)]


@pytest.fixture(scope="module")
def truth() -> Dataset:
    return simulate_dataset(ROBOT, rng=4, poses=40, noise_mm=0.02, effects=["joint_compliance"]).dataset


def points_of(dataset: Dataset) -> np.ndarray:
    return np.asarray(dataset.points.xyz_mm)


def table(path: Path, header: Sequence[str], rows: np.ndarray, decimal: str = ".") -> Path:
    separator = "," if decimal == "." else ";"
    lines = [separator.join(header)]
    lines += [separator.join(f"{v:.9f}".replace(".", decimal) for v in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def planned(path: Path, q: np.ndarray, points: np.ndarray, mapping: dict[str, Meaning] | None = None) -> ImportPlan:
    log = table(path / "log.csv", [*Q, "x", "y", "z"], np.hstack([q, points]))
    return plan_import(ImportSources(ASKED, log, mapping=mapping or {}))


EYE, TURNED = np.eye(6), np.diag([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
FROM_LEVEL, WRIST = np.eye(6), np.eye(6)
FROM_LEVEL[2, 1], WRIST[4, 3] = -1.0, 1.0
READINGS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], dict[str, str]]] = {
    "as it is": (lambda q: q, {}),
    "a sign": (lambda q: q @ TURNED, {"A3": "-q3_rad"}),
    "a zero": (lambda q: q + np.pi / 2 * EYE[1], {"A2": "q2_rad-1.5708"}),
    "a sign and a zero": (
        lambda q: (q + np.pi / 2 * EYE[1]) @ TURNED,
        {"A2": "q2_rad-1.5708", "A3": "-q3_rad"},
    ),
    "alphabetical order, as ROS has it": (
        lambda q: q[:, [2, 1, 0, 3, 4, 5]],
        {"A1": "q3_rad", "A3": "q1_rad"},
    ),
    "a sum of neighbours, as pendants have it": (lambda q: q @ FROM_LEVEL.T, {"A3": "q3_rad-q2"}),
    "a coupled wrist": (lambda q: q @ WRIST.T, {"A5": "q5_rad+q4"}),
    "backwards": (lambda q: q[:, ::-1], {f"A{k}": f"q{7 - k}_rad" for k in range(1, 7)}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", sweep(READINGS, every_run=["as it is", "a coupled wrist", "backwards"]))
def test_signs_zeros_and_order_that_the_points_speak_for_are_taken_and_said(
    truth: Dataset, tmp_path: Path, name: str
) -> None:
    as_written, expected = READINGS[name]
    plan = planned(tmp_path, as_written(truth.poses.q), points_of(truth))
    assert plan.faults == ()
    meanings = {column.name: str(column.meaning) for column in plan.columns}
    wanted = {f"A{k}": f"q{k}_rad" for k in range(1, 7)} | expected
    assert {column: meanings[column] for column in wanted} == wanted
    made = write_plan(plan, tmp_path / "cell")
    assert made.poses.q == pytest.approx(truth.poses.q, abs=1e-7)
    said = [line for line in plan.notes if "the error falls from" in line]
    assert len(said) == bool(expected)
    changed = [column for column in plan.columns if column.name in expected]
    assert all("the error falls from" in column.why for column in changed)


@pytest.mark.slow
def test_what_the_user_told_is_not_overruled_but_doubted(truth: Dataset, tmp_path: Path) -> None:
    q = truth.poses.q @ TURNED
    plan = planned(tmp_path, q, points_of(truth), {"A3": Meaning("q3", "rad")})
    assert plan.faults == ()
    assert len(plan.doubts) == 1
    assert "joint 3 turns the other way than robot.toml says: with A3 negated the error falls from" in plan.doubts[0]
    assert write_plan(plan, tmp_path / "cell").poses.q == pytest.approx(q, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["five poses", "a third of bad rows"])
def test_a_convention_is_found_with_few_poses_and_among_bad_rows(truth: Dataset, tmp_path: Path, case: str) -> None:
    rows = np.arange(5 if case == "five poses" else 40)
    points = points_of(truth).copy()
    if case != "five poses":
        points[::3] += np.random.default_rng(2).normal(0.0, 150.0, (14, 3))
    plan = planned(tmp_path, (truth.poses.q @ FROM_LEVEL.T)[rows], points[rows])
    said = [note for note in plan.notes if "A3 of the table is J3 - J2 of the robot, and is read so" in note]
    assert len(said) == 1
    assert plan.preview is not None
    assert plan.preview.poses.q == pytest.approx(truth.poses.q[rows], abs=1e-7)


@pytest.mark.slow
def test_bad_rows_alone_are_no_convention(truth: Dataset, tmp_path: Path) -> None:
    points = points_of(truth).copy()
    points[::3] += np.random.default_rng(2).normal(0.0, 150.0, (14, 3))
    plan = planned(tmp_path, truth.poses.q, points)
    assert not [line for line in (*plan.notes, *plan.doubts) if "read so" in line or "of the table" in line]


def test_a_told_sum_is_kept_in_robot_toml_and_on_the_way_out(truth: Dataset, tmp_path: Path) -> None:
    q = np.degrees(truth.poses.q @ FROM_LEVEL.T)
    told = {"A2": meaning_of("-q2_deg+90"), "A3": meaning_of("q3_deg-q2")}
    q[:, 1] = 90.0 - q[:, 1]
    plan = planned(tmp_path, q, points_of(truth), {name: meant for name, meant in told.items() if meant is not None})
    made = write_plan(plan, tmp_path / "cell")
    assert made.poses.q == pytest.approx(truth.poses.q, abs=1e-7)
    assert commands_in_words(made.robot) == (
        "J2 of the table is -J2 + 90 deg of the robot",
        "J3 of the table is J3 - J2 of the robot",
    )
    targets = table(tmp_path / "targets.csv", [f"q{k}_deg" for k in range(1, 7)], q[:3])
    document = answered("correct", made.folder, "--joints", targets, "--out", tmp_path / "out.csv")
    assert np.abs(np.degrees([each["q"] for each in document["targets"]]) - q[:3]).max() < 1.0
    urdf = robot_content(made.robot, tmp_path / "arm.urdf")
    assert "J3 of the table is J3 - J2 of the robot" in urdf[1][0]


def test_a_mapping_turns_and_moves_a_joint(truth: Dataset, tmp_path: Path) -> None:
    q = np.degrees(truth.poses.q)
    q[:, 2] = 90.0 - q[:, 2]
    told = meaning_of("-q3_deg+90")
    assert told == Meaning("q3", "deg", -1.0, 90.0)
    plan = planned(tmp_path, q, points_of(truth), {"A3": told})
    assert plan.doubts == ()
    assert write_plan(plan, tmp_path / "cell").poses.q == pytest.approx(truth.poses.q, abs=1e-7)
    assert str(told) == "-q3_deg+90"


@pytest.mark.slow
def test_a_last_joint_that_may_turn_the_other_way_is_doubted(truth: Dataset, tmp_path: Path) -> None:
    """With the tool near the last axis another sign moves points by tenths of a millimetre only, as a wobble does."""
    q = truth.poses.q * [1.0, 1.0, 1.0, 1.0, 1.0, -1.0]
    plan = planned(tmp_path, q, points_of(truth))
    assert plan.faults == ()
    assert len(plan.doubts) == 1
    assert "joint 6 turns the other way than robot.toml says: with A6 negated" in plan.doubts[0]
    assert "inspector diagnose weighs them" in plan.doubts[0]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "said"), [
    (lambda q, p: (q[np.random.default_rng(0).permutation(40)], p), "belong to the joints of other rows"),
    (lambda q, p: (np.roll(q, 1, axis=0), p), "the rows of points and joints are out of step"),
])  # fmt: skip
def test_rows_in_another_order_are_doubted_with_the_mend(
    truth: Dataset, tmp_path: Path, change: Callable[..., tuple[np.ndarray, np.ndarray]], said: str
) -> None:
    plan = planned(tmp_path, *change(truth.poses.q, points_of(truth)))
    assert plan.faults == ()
    assert len(plan.doubts) == 1
    assert said in plan.doubts[0]


@pytest.mark.slow
def test_points_of_another_robot_are_doubted_and_nothing_is_guessed(truth: Dataset, tmp_path: Path) -> None:
    points = points_of(truth) * [1.0, 1.6, 0.7]
    plan = planned(tmp_path, truth.poses.q, points)
    assert plan.faults == ()
    assert len(plan.doubts) == 1
    assert "may be of another robot" in plan.doubts[0]


@pytest.mark.slow
def test_a_poor_nominal_arm_is_left_to_the_fit(truth: Dataset, tmp_path: Path) -> None:
    """A tool off by 150 mm and joint zeros off by 2 deg lead to no doubt on conventions."""
    off = np.radians([2.0, -2.0, 2.0, -2.0, 2.0, -2.0])
    tool = replace(ROBOT.tool, a_mm=ROBOT.tool.a_mm + 150.0)
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([truth.poses.q + off, points_of(truth)]))
    plan = plan_import(ImportSources((RobotReading("", RobotFile(replace(ROBOT, tool=tool), None)),), log))
    assert plan.faults == ()
    assert plan.doubts == ()
    assert not [line for line in plan.notes if "opposite" in line or "counted from" in line]


def test_a_handful_of_poses_settles_nothing(truth: Dataset, tmp_path: Path) -> None:
    plan = planned(tmp_path, (truth.poses.q @ TURNED)[:10], points_of(truth)[:10])
    assert plan.doubts == ()
    assert not [line for line in plan.notes if "opposite" in line]


# ---- the robot's table --------------------------------------------------------------------------------------------


MODIFIED = """\
name,a_mm,alpha_deg,d_mm,theta_deg
J1,40,90,169.2,0
J2,30,-90,0,-90
J3,425,5,0,0
J4,10,90,392,90
J5,0,-90,110.7,0
J6,0,90,96.7,0
tool,20,0,30,0
"""


def measured_with(robot: Robot, q: np.ndarray) -> np.ndarray:
    from calib.kinematics.chain import target_points

    seen = target_points(robot, q) + np.random.default_rng(1).normal(0.0, 0.05, (len(q), 3))
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return np.asarray(seen @ (turn * np.linalg.det(turn)) + [100.0, 2000.0, -300.0])


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_the_points_tell_the_convention_of_a_table(tmp_path: Path, convention: str) -> None:
    (tmp_path / "dh.csv").write_text(MODIFIED)
    true = robot_readings(str(tmp_path / "dh.csv"), ReadOptions(convention=convention))[0].robot.robot
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (40, 6))
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([q, measured_with(true, q)]))
    readings = tuple(robot_readings(str(tmp_path / "dh.csv"), ReadOptions()))
    plan = plan_import(ImportSources(readings, log))
    assert plan.faults == ()
    assert plan.robot.robot == true
    assert any(f"its table is taken for {convention} Denavit-Hartenberg" in line for line in plan.notes)
    few = table(tmp_path / "few.csv", [*Q, "x", "y", "z"], np.hstack([q, measured_with(true, q)])[:4])
    (fault,) = plan_import(ImportSources(readings, few)).faults
    assert "give --convention" in fault


@pytest.mark.slow
def test_axes_that_show_the_convention_are_told(truth: Dataset, tmp_path: Path) -> None:
    (tmp_path / "dh.csv").write_text(MODIFIED.replace("J1,40,90", "J1,0,0"))
    (only,) = robot_readings(str(tmp_path / "dh.csv"), ReadOptions())
    assert only.convention == "modified"
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([truth.poses.q, points_of(truth)]))
    said = plan_import(ImportSources((only,), log)).notes
    assert "dh: its table is modified Denavit-Hartenberg (Craig), by its axes" in said


def test_a_robot_toml_whose_rows_are_of_a_modified_table_is_recognised_and_told(tmp_path: Path) -> None:
    from calib.robot_formats.conventions import as_modified

    rows = replace(
        ROBOT, joints=tuple(replace(joint, beta_rad=0.0, com_mm=None, mass_kg=None) for joint in ROBOT.joints)
    )
    (tmp_path / "robot.toml").write_text(robot_to_toml(rows))
    meant = as_modified(rows)
    assert meant is not None
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (40, 6))
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([q, measured_with(meant, q)]))
    plan = plan_import(ImportSources(tuple(robot_readings(str(tmp_path / "robot.toml"), ReadOptions())), log))
    assert plan.faults == ()
    assert any("is taken for modified Denavit-Hartenberg (Craig)" in line for line in plan.notes)
    made = write_plan(plan, tmp_path / "cell")
    assert made.robot.n_joints == 6
    assert np.abs(made.robot.table - rows.table).max() > 1.0


# ---- faults ---------------------------------------------------------------------------------------------------------


def test_all_faults_of_all_files_stand_in_one_list(truth: Dataset, tmp_path: Path) -> None:
    joints = table(tmp_path / "joints.csv", ["q1", "q2", "q2", "q4", "q5", "q6"], truth.poses.q)
    lines = joints.read_text().splitlines()
    lines[3] += ",7"
    lines[5] = lines[5].replace(".", "x", 1)
    joints.write_text("\n".join(lines))
    points = table(tmp_path / "points.csv", ["x", "y", "w"], points_of(truth)[:30])
    plan = plan_import(ImportSources((), joints, points, faults=("arm.urdf: several tips; choose one with --tip",)))
    assert plan.content is None
    said = "\n".join(plan.faults)
    for part in (
        "several tips",
        "column 'q2' stands there twice",
        "line 4: found 7 cells",
        "no column for z",
    ):
        assert part in said
    with pytest.raises(DatasetError, match="nothing was written, "):
        write_plan(plan, tmp_path / "cell")
    assert not (tmp_path / "cell").exists()


def test_bad_cells_roles_and_half_points_are_listed_each(truth: Dataset, tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([truth.poses.q, points_of(truth)]))
    lines = log.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    for i, row in enumerate(rows):
        row += ["role", "time"] if i == 0 else ["train", str(i)]
    rows[2][0], rows[4][7], rows[6][9], rows[8][10], rows[9][3] = "n/a", "", "maybe", "late", "1e40"
    log.write_text("\n".join(",".join(row) for row in rows))
    said = "\n".join(plan_import(ImportSources(ASKED, log)).faults)
    for part in (
        "line 3, column A1: found 'n/a'",
        "line 5: y is empty",
        "line 7, column role: found 'maybe'",
        "line 9, column time: found 'late'",
        "line 10, column A4: found 1e+40",
    ):
        assert part in said


def test_decimal_commas_and_examples_are_shown(truth: Dataset, tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", [*Q, "x", "y", "z"], np.hstack([truth.poses.q, points_of(truth)]), ",")
    plan = plan_import(ImportSources(ASKED, log))
    assert plan.faults == ()
    assert plan.columns[0].examples[0] == f"{truth.poses.q[0, 0]:.9f}"
    assert plan.columns[6].why.startswith("by its name; mm: ")
