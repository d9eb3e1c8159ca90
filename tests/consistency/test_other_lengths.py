"""Lengths of another arm in robot.toml, and the one entry that explains most of its error, by another kinematics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.consistency.leading_entry import leading_entry
from calib.dataset.dataset import Dataset
from calib.dataset_import.import_dataset import plan_of_files, unpacked, write_plan
from calib.dataset_import.plan import ImportSources
from calib.present.fit.calibration import leading_entry_sentence
from tests.support.scenarios.shop import Arm, session


def imported(folder: Path, told: Arm, *, seed: int, links: float = 1.0, poses: int = 60) -> Dataset:
    """Dataset of a session whose URDF is `told`."""
    session(seed, told=told, links=links, poses=poses).write(folder / "files")
    with unpacked(folder / "files") as files:
        return write_plan(plan_of_files(files, ImportSources()), folder / "cell")


def with_origin(joint: int, *, longer_m: tuple[float, float, float] = (0, 0, 0), turned_deg: float = 0.0) -> Arm:
    """The arm with another origin of a joint, counted from 1; turned about the joint's own axis."""
    nominal = Arm()
    origins = list(nominal.origins)
    xyz, rpy = origins[joint - 1]
    assert not turned_deg or rpy[0] == -np.pi / 2  # then the joint's axis is the fixed y, about which pitch turns
    turned = (rpy[0], rpy[1] + float(np.radians(turned_deg)), rpy[2])
    origins[joint - 1] = (tuple(np.add(xyz, longer_m)), turned)
    return replace(nominal, origins=tuple(origins))


@pytest.mark.thorough
def test_two_lengths_of_another_size_are_told_and_no_effect_is_named(tmp_path: Path) -> None:
    told = with_origin(3, longer_m=(0.0, -0.06, 0.0))
    origins = list(told.origins)
    origins[4] = ((0.0, 0.0, 0.465), origins[4][1])
    found = diagnose(imported(tmp_path, replace(told, origins=tuple(origins)), seed=31))
    assert found.data_problem.kind == "robot_table"
    assert found.verdict == "unexplained"
    assert not found.missing
    assert (
        "a2 is +6" in found.data_problem.mistake
    )  # mm shorter than the table, with its sign in the five-parameter table
    assert "d4 is -5" in found.data_problem.mistake
    assert found.data_problem.then_mm < 0.03 * found.data_problem.now_mm


@pytest.mark.parametrize(("joint", "off_deg"), [(2, 0.9), (4, -1.3)])
def test_a_zero_that_was_set_wrong_is_told_beside_link_errors(tmp_path: Path, joint: int, off_deg: float) -> None:
    fit = calibrate(imported(tmp_path, with_origin(joint, turned_deg=off_deg), seed=32 + joint))
    found = leading_entry(fit)
    assert f"theta{joint}" in (found.parameter, *found.rivals)
    assert abs(found.off) == pytest.approx(np.radians(abs(off_deg)), abs=np.radians(0.2))
    assert found.corrected_mm < 0.5 * found.delivered_mm
    assert f"theta{joint}" in leading_entry_sentence(fit)
    assert found.share == pytest.approx(1.0 - (found.corrected_mm / found.delivered_mm) ** 2)


@pytest.mark.parametrize("seed", [41, 42, 43])
def test_an_arm_whose_links_are_all_a_little_off_has_no_such_entry(tmp_path: Path, seed: int) -> None:
    fit = calibrate(imported(tmp_path, Arm(), seed=seed))
    found = leading_entry(fit)
    assert found is None or found.corrected_mm > 0.2 * found.delivered_mm  # at most one that happens to be the largest
    exact = calibrate(imported(tmp_path / "exact", Arm(), seed=seed, links=0.0))
    assert leading_entry(exact) is None
    assert not leading_entry_sentence(exact)
