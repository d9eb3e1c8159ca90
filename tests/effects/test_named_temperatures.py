"""Temperatures of several sensors, each by its name: the one that drives the arm is found, and what it drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.dataset.files.folder import load_dataset
from calib.dataset.repeats import groups_by_condition
from calib.effects.catalogue import effects_for
from calib.effects.catalogue.thermal import GrowthBySensor, JointBySensor
from calib.models.model_file import load_model
from tests.support.mujoco_arm import mujoco
from tests.support.signal_cell import measured, write

N = 60
TURN_RAD_PER_K = 3e-5
KAPPA_PER_K = 2e-5


def temperatures() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    return {
        "temperature_motor2_c": 20.0 + 25.0 * rng.random(N),
        "temperature_hall_c": 18.0 + 10.0 * rng.random(N),
    }


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm whose joint 2 turns with its motor's temperature, and whose lengths grow with that of the hall."""
    mujoco()
    told = temperatures()
    turn = np.zeros((N, 6))
    turn[:, 1] = TURN_RAD_PER_K * (told["temperature_motor2_c"] - 20.0)
    cell = measured(N, further=turn, growth=1.0 + KAPPA_PER_K * (told["temperature_hall_c"] - 20.0))
    folder = tmp_path_factory.mktemp("warm") / "cell"
    write(folder, cell, told, masses=True)
    return folder


@pytest.mark.thorough
def test_each_temperature_is_found_with_what_it_drives(warm: Path, tmp_path: Path) -> None:
    diagnosis = diagnose(load_dataset(warm))
    assert set(diagnosis.missing) == {"joint_compliance", "thermal_growth"}
    fit = diagnosis.calibration
    found = fit.fit.by_name
    for name, truth in (
        ("thermal_growth.J2.turn_by_motor2_rad_per_k", TURN_RAD_PER_K),
        ("thermal_growth.kappa_by_hall_per_k", KAPPA_PER_K),
    ):
        value, sigma = found[name]
        assert abs(value - truth) < 4.0 * sigma, name
        assert sigma < 0.15 * truth, name
    fit.save(tmp_path / "model.json")
    assert set(load_model(tmp_path / "model.json").needs) == set(temperatures())


def test_a_sensor_with_a_number_is_of_that_joint_and_any_other_of_all(warm: Path) -> None:
    dataset = load_dataset(warm)
    (family,) = (family for family in effects_for(dataset) if family.name == "thermal_growth")
    of_motor = [m for m in family.members if isinstance(m, JointBySensor) and m.sensor == "motor2"]
    of_hall = [m for m in family.members if isinstance(m, JointBySensor) and m.sensor == "hall"]
    assert ([m.joint for m in of_motor], len(of_hall)) == ([1], 6)
    both = ["joint_compliance", GrowthBySensor(sensor="hall"), JointBySensor(sensor="motor2", joint=1)]
    assert calibrate(dataset, effects=both).sigma_mm < 0.04
    assert calibrate(dataset, effects=both[:2]).sigma_mm > 0.07


def test_poses_at_other_temperatures_are_no_repeats(warm: Path) -> None:
    poses = load_dataset(warm).poses
    still = replace(poses, q=np.tile(poses.q[:1], (N, 1)))
    assert len(np.unique(groups_by_condition(still))) > N / 2
