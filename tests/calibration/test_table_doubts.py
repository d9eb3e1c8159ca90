"""Entries of a robot's table that are far from what a fit found are doubted, and ordinary link errors are not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, check, diagnose
from calib.calibration.table_doubts import common_scale, doubtful_entries
from calib.dataset.dataset import Dataset
from calib.diagnosis.result import Diagnosis
from calib.present.diagnosis.verdict import verdict
from calib.present.fit.calibration import calibration_warnings
from calib.rendering.blocks import plain
from calib.simulation.simulate import simulate_dataset
from tests.support.changed import with_xyz


def measured_arm(robot: str = "rb5", seed: int = 0) -> Dataset:
    rng = np.random.default_rng(seed)
    return simulate_dataset(robot, rng=rng, poses=50, noise_mm=0.05).dataset


def with_another_table(dataset: Dataset, entry: str, by: float) -> Dataset:
    """The dataset with one entry of its robot's table changed; the points stay those of the true arm."""
    table = dataset.robot.table.copy()
    table.flat[dataset.robot.parameter_names.index(entry)] += by
    return replace(dataset, robot=dataset.robot.with_table(table))


@pytest.mark.parametrize(
    ("entry", "by", "named", "unit"),
    [
        ("a2", -10.0, "a2", "mm"),
        ("a3", 6.0, "a3", "mm"),
        ("d3", 8.0, "d2 + d3 + d4", "mm"),  # parallel axes: only the sum is known
        ("dTCP", -5.0, "d6 + dTCP", "mm"),  # a flange that the table does not have
        ("alpha3", float(np.radians(3.0)), "alpha3", "rad"),
    ],
)
def test_a_table_with_one_wrong_entry_is_doubted_there(entry: str, by: float, named: str, unit: str) -> None:
    calibration = calibrate(with_another_table(measured_arm(), entry, by))
    found = doubtful_entries(calibration)
    assert [(one.name, one.unit) for one in found] == [(named, unit)]
    assert found[0].off == pytest.approx(-by, rel=0.15)
    assert found[0].of_tool == ("TCP" in named)
    warning = next(one for one in calibration_warnings(calibration) if one.startswith(f"in robot.toml {named} is"))
    assert "times what links of arms usually are off" in warning
    assert ("less" if by < 0 else "more") in warning


@pytest.mark.parametrize("robot", ["rb5", "panda"])
def test_ordinary_link_errors_are_not_doubted(robot: str) -> None:
    for seed in range(3):
        assert doubtful_entries(calibrate(measured_arm(robot, seed))) == ()


@pytest.mark.slow
def test_a_calm_verdict_and_the_check_ask_whether_the_table_is_right() -> None:
    dataset = with_another_table(measured_arm(), "a2", -10.0)
    found = diagnose(dataset)
    assert isinstance(found, Diagnosis)
    assert found.verdict == "adequate"
    assert re.search(r"In robot.toml a2 is \d+(\.\d+)? mm less than measured", plain(verdict(found)))
    document = found.to_dict()
    assert [entry["name"] for entry in document["table_doubts"]] == ["a2"]
    assert any(item.name == "robot table" and item.warning for item in check(dataset).items)


@pytest.mark.parametrize("scale", [1.02, 0.985])
def test_an_instrument_of_another_scale_is_told_and_no_link_is_doubted(scale: float) -> None:
    dataset = measured_arm()
    scaled = with_xyz(dataset, scale * dataset.points.xyz_mm)
    calibration = calibrate(scaled)
    assert common_scale(calibration) == pytest.approx(scale - 1.0, abs=2.5e-3)
    assert doubtful_entries(calibration) == ()
    told = next(one for one in calibration_warnings(calibration) if one.startswith("all lengths came out"))
    assert ("longer" if scale > 1.0 else "shorter") in told
    assert common_scale(calibrate(dataset)) is None
