"""Mistakes in the data and tables of many arms are found with their remedy, and no effect is taken for a mistake."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.consistency.data_problem import DataProblem, suspicions
from calib.consistency.hypotheses import column_names, of_reading
from calib.consistency.joint_reading import JointReading, edits, simple_readings
from calib.consistency.row_matching import matched_rows
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.frames import apply, make_transform, rotation_from_rotvec
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.arm_sampling import SIMULATED_EFFECTS
from tests.support import ROOT
from tests.support.changed import with_xyz
from tests.support.commands import answered, printed
from tests.support.sweeps import sweep
from tests.support.wrong_sheets import ARMS, simulated, turned, with_joints, with_points

SHARED = ROOT.parent / "shared" / "data"


def problem_of(dataset: Dataset) -> DataProblem:
    found = suspicions(calibrate(dataset), calibrate).problem
    assert found is not None
    return found


def two_rows(dataset: Dataset) -> Dataset:
    rows = np.arange(len(dataset.poses))
    rows[[3, 11]] = rows[[11, 3]]
    return with_joints(dataset, dataset.poses.q[rows])


SHEETS: dict[str, tuple[Callable[[Dataset], Dataset], str, str]] = {
    "permuted": (
        lambda d: with_joints(d, d.poses.q[np.random.default_rng(1).permutation(len(d.poses))]),
        "row_order",
        "one order",
    ),
    "shifted": (
        lambda d: with_joints(d, np.roll(d.poses.q, 1, axis=0)),
        "row_order",
        "move the columns of joints",
    ),
    "two rows changed places": (two_rows, "row_order", "p04 has the joints of p12"),
    "upside down": (lambda d: with_joints(d, d.poses.q[::-1]), "row_order", "turn the order"),
    "inch": (lambda d: with_points(d, 1.0 / 25.4), "units", "multiply x, y and z by 25.4"),
    "metres": (lambda d: with_points(d, 1e-3), "units", "multiply x, y and z by 1000"),
    "left-handed": (lambda d: with_points(d, np.array([1.0, 1.0, -1.0])), "mirrored", "or exchange two"),
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arm", "sheet"),
    sweep(
        [(arm, sheet) for arm in ARMS for sheet in SHEETS],
        every_run=[("rb5", sheet) for sheet in SHEETS]
        + [("panda", "shifted"), ("scara", "inch"), ("gantry", "metres")],
    ),
)
def test_rows_and_units_are_told_with_their_mend(arm: str, sheet: str) -> None:
    change, kind, mend = SHEETS[sheet]
    given = simulated(arm, effect=("joint_scale", 5.0))
    found = problem_of(change(given))
    assert found.kind == kind
    assert mend in found.warning
    assert found.then_mm < 0.1 * found.now_mm
    again = calibrate(found.mended)
    assert again.sigma_mm == pytest.approx(calibrate(given).sigma_mm, rel=0.3)


@pytest.mark.thorough
@pytest.mark.parametrize("arm", sweep(ARMS, every_run=["rb5", "gantry"]))
def test_turned_joints_are_told_or_left_open_with_all_that_makes_the_same_of_the_points(arm: str) -> None:
    """Another sign of a last joint with its tool near the axis stays open; three slides mirror each other."""
    given = simulated(arm)
    for joint in range(1, given.robot.n_joints + 1):
        data = turned(given, joint)
        found = suspicions(calibrate(data), calibrate)
        shown = found.open if found.problem is None else (found.problem.hypothesis, *found.problem.rivals)
        assert (joint,) in {hypothesis.joints for hypothesis in shown}
        assert found.problem is not None or joint == given.robot.n_joints
    found = suspicions(calibrate(turned(given, 1, 2)), calibrate)
    mirrored = (
        ("joint_sign", "joint_zero") if arm == "gantry" else ("joint_sign",)
    )  # two slides: half a turn of the rest
    assert found.problem.kind in mirrored
    assert calibrate(found.problem.mended).fit.reduced_chi < 1.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "columns"),
    sweep(
        [("rb5", (2, 3)), ("rb5", (5, 6)), ("panda", (4, 5)), ("gantry", (1, 2))],
        every_run=[("rb5", (5, 6)), ("gantry", (1, 2))],
    ),
)
def test_columns_that_changed_places_are_told(arm: str, columns: tuple[int, int]) -> None:
    given = simulated(arm)
    order = list(range(given.robot.n_joints))
    a, b = columns[0] - 1, columns[1] - 1
    order[a], order[b] = b, a
    found = problem_of(with_joints(given, given.poses.q[:, order]))
    assert (found.kind, found.joints) == ("joint_order", columns)
    assert "have changed places" in found.warning


@pytest.mark.slow
def test_angles_in_another_unit_are_told() -> None:
    given = simulated("rb5")
    found = problem_of(with_joints(given, np.radians(given.poses.q)))
    assert (found.kind, "in radians" in found.warning) == ("units", True)


@pytest.mark.slow
@pytest.mark.parametrize("joint", sweep([1, 2, 3, 4, 5], every_run=[2, 4]))
def test_a_turned_joint_is_told_of_few_poses_in_a_narrow_range(joint: int) -> None:
    arm = ARMS["rb5"]
    ranges = [(-40.0, 0.0), (20.0, 60.0), (40.0, 90.0), (-30.0, 30.0), (50.0, 100.0), (-60.0, 60.0)]
    joints = [
        replace(joint, min=np.radians(low), max=np.radians(high))
        for joint, (low, high) in zip(arm.joints, ranges, strict=True)
    ]
    given = simulate_dataset(replace(arm, joints=tuple(joints)), rng=3, poses=22).dataset
    found = problem_of(turned(given, joint))
    shown = {hypothesis.joints for hypothesis in (found.hypothesis, *found.rivals)}
    assert (joint,) in shown, found.warning


@pytest.mark.thorough
@pytest.mark.parametrize("name", sweep(["hidden_effect_a", "hidden_effect_c"], every_run=["hidden_effect_a"]))
def test_a_turned_last_joint_is_no_wobbling_axis(name: str, tmp_path: Path) -> None:
    data = load_dataset(ROOT / "sample_data" / name)
    folder = tmp_path / name
    write_dataset(turned(data, 6), folder)
    told = answered("diagnose", folder)
    assert (told["verdict"], told["missing"], told["suspected"]) == ("unexplained", [], [])
    problem = told["data_problem"]
    assert (problem["kind"], problem["joints"]) == ("joint_sign", [6])
    assert "negate column q6_deg" in problem["mend"]
    assert problem["rmse_mm"]["then"] < 0.7 * problem["rmse_mm"]["now"]
    assert told["explanation"].startswith("Joint 6 turns the other way than robot.toml says")
    assert re.search(r"FAIL +data +joint 6 turns the other way", printed("check", folder, code=1))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", sweep(range(4), every_run=[0, 1]))
def test_an_arm_with_a_wobbling_last_axis_keeps_its_wobble(seed: int) -> None:
    assert diagnose(simulated("rb5", seed, poses=64, effect=("axis_wobble", 6.0))).data_problem is None


@pytest.mark.thorough
def test_no_effect_is_taken_for_wrong_data() -> None:
    """Simulated effects of every kind, of 0.5 to 15 sigma, are not taken for mistakes; the thorough run has more."""
    rng = np.random.default_rng(7)
    for effect in sorted(set(SIMULATED_EFFECTS) - {"scanner_scale"}):
        arm = "panda" if effect == "joint_coupling" else "rb5"
        size = float(np.exp(rng.uniform(np.log(0.5), np.log(15.0))))
        data = simulated(arm, int(rng.integers(1000)), effect=(effect, size))
        assert suspicions(calibrate(data), calibrate).problem is None, (effect, size)


REAL = sorted(SHARED.glob("*/dataset.toml")) if SHARED.is_dir() else []
SAMPLES = sorted((ROOT / "sample_data").glob("*/points.csv"))


@pytest.mark.slow
@pytest.mark.parametrize("path", [*SAMPLES, *REAL], ids=lambda path: path.parent.name)
def test_right_data_of_real_and_sample_arms_are_right(path: Path) -> None:
    data = load_dataset(path.parent)
    assert suspicions(calibrate(data), calibrate).problem is None


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_every_simple_reading_of_the_joints_changes_something(joints: int) -> None:
    readings = simple_readings(np.ones(joints, dtype=bool))
    assert readings
    assert all(reading.edits for reading in readings)
    assert all(of_reading(reading, column_names(ARMS["rb5"])[:joints]).remedy for reading in readings)


def test_every_change_of_a_reading_leaves_columns_that_tell_the_joints() -> None:
    turns = np.ones(3, dtype=bool)
    twice = [each for once in edits(JointReading.plain(3), turns, far=True) for each in edits(once, turns, far=True)]
    assert all(of_reading(each, column_names(ARMS["rb5"])[:3]).remedy for each in twice if each.edits)


@pytest.mark.parametrize("count", [5, 40])
def test_points_find_the_joints_that_reach_them(count: int) -> None:
    rng = np.random.default_rng(count)
    arm_mm = rng.uniform(-500.0, 500.0, (count, 3)) * [1.0, 0.7, 0.4]
    source = rng.permutation(count)
    frame = make_transform(rotation_from_rotvec(np.array([2.0, 1.0, -1.5])), [300.0, 20.0, 900.0])
    seen_mm = apply(frame, arm_mm[source]) + rng.normal(scale=1.0, size=(count, 3))
    found = matched_rows(arm_mm, seen_mm)
    assert found.tolist() == source.tolist()
    if count > 6:
        assert matched_rows(arm_mm, rng.uniform(-500.0, 500.0, (count, 3))) is None


@pytest.mark.parametrize("share", sweep([0.1, 0.33], every_run=[0.33]))
def test_bad_rows_turn_no_joint_and_no_unit(share: float) -> None:
    dataset, rng = simulated("rb5"), np.random.default_rng(0)
    bad = rng.choice(len(dataset.points), round(share * len(dataset.points)), replace=False)
    for wrong in (rng.normal(0.0, 30.0, (len(bad), 3)), 0.05 * dataset.points.xyz_mm[bad]):
        xyz_mm = dataset.points.xyz_mm.copy()
        xyz_mm[bad] += wrong
        moved = with_xyz(dataset, xyz_mm)
        assert suspicions(calibrate(moved), calibrate).problem is None


def test_points_that_are_all_one_place_accuse_no_table() -> None:
    dataset = with_points(simulated("rb5", 1), 0.0)
    places = np.full_like(dataset.points.xyz_mm, 100.0 / 3.0)
    found = diagnose(with_xyz(dataset, places))
    assert found.data_problem is None
    assert f"all {len(places)} points are one place" in found.summary()
