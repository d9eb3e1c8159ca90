"""Measured torques are the load of joints: of an arm in MuJoCo whose table has no masses, the compliance is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.effects.catalogue.loads import JointCompliance
from calib.effects.state import RobotState
from calib.errors import DatasetError
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model
from tests.support.mujoco_arm import mujoco
from tests.support.signal_cell import COMPLIANCE, Measured, measured, write

N = 70
SOFT = (JointCompliance(1), JointCompliance(2))


@pytest.fixture(scope="module")
def cell() -> Measured:
    mujoco()
    return measured(N)


def columns(cell: Measured, sigma_nm: float, sign: float = -1.0, joints: tuple[int, ...] = (1, 2)) -> dict:
    """Torques as a controller writes them: of the drive, off by 2 Nm, with noise."""
    rng = np.random.default_rng(5)
    return {f"torque{j + 1}_nm": sign * cell.torque_nm[:, j] + 2.0 + sigma_nm * rng.normal(size=N) for j in joints}


def found(dataset: Dataset) -> dict[int, tuple[float, float]]:
    """Compliance and its sigma, by joint."""
    fit = calibrate(dataset, effects=SOFT)
    names = [p.name for p in fit.model.parameters]
    at = {j: names.index(f"joint_compliance.J{j + 1}.c_rad_per_nm") for j in COMPLIANCE}
    return {j: (float(fit.fit.x[k]), float(fit.fit.sigma[k])) for j, k in at.items()}


def assert_compliance(dataset: Dataset, within: float = 3.5) -> None:
    for joint, (value, sigma) in found(dataset).items():
        assert abs(value - COMPLIANCE[joint]) < within * sigma, joint
        assert sigma < 0.05 * COMPLIANCE[joint]


@pytest.mark.parametrize("sign", [-1.0, pytest.param(1.0, marks=pytest.mark.thorough)])
def test_compliance_without_masses_from_torque_of_drive_or_load(tmp_path: Path, cell: Measured, sign: float) -> None:
    dataset = write(tmp_path / "cell", cell, columns(cell, 0.3, sign))
    first, second = dataset.robot.measured_loads
    assert (first.joint, second.joint, first.sign) == (1, 2, sign)
    assert abs(first.offset_nm - 2.0 * sign) < 0.3
    assert 0.2 < first.sigma_nm < 0.45
    torque_nm = RobotState.nominal(dataset.robot, dataset.poses).gravity_torques_nm
    np.testing.assert_allclose(torque_nm[:, 1:3], cell.torque_nm[:, 1:3], atol=0.6)
    assert_compliance(dataset)
    assert "drive" in dataset.notes[0] if sign < 0.0 else "load's own" in dataset.notes[0]


def test_noise_in_the_torque_does_not_shrink_the_compliance(tmp_path: Path, cell: Measured) -> None:
    """Over plain readings a sixth of the slope of joint 3 would be lost; the load by weight keeps it."""
    dataset = write(tmp_path / "cell", cell, columns(cell, 8.0))
    assert dataset.robot.measured_loads[1].slope_lost > 0.08
    values = found(dataset)
    for joint, (value, sigma) in values.items():
        assert abs(value - COMPLIANCE[joint]) < 3.0 * sigma  # which has the noise of the torques in it
        assert 0.02 * value < sigma < 0.15 * value
    trusted = tuple(replace(load, trust=1.0) for load in dataset.robot.measured_loads)
    plain = found(replace(dataset, robot=replace(dataset.robot, measured_loads=trusted)))
    assert plain[2][0] < 0.85 * COMPLIANCE[2]
    assert "taken for noise" in dataset.warnings[-1]
    told = " ".join([*dataset.warnings, *dataset.notes])
    assert [told.count(f"{100.0 * load.explained:.3g} %") for load in dataset.robot.measured_loads] == [1, 1]


@pytest.mark.parametrize(
    "told",
    ["nothing", pytest.param("payload", marks=pytest.mark.thorough), pytest.param("sigma", marks=pytest.mark.thorough)],
)
def test_a_load_that_comes_and_goes_is_in_the_torque(tmp_path: Path, told: str) -> None:
    mujoco()
    kg = np.where(np.arange(N) % 2 == 0, 0.0, 3.0)
    cell = measured(N, payload_kg=kg)
    further = columns(cell, 0.3) | ({"payload_kg": kg} if told == "payload" else {})
    dataset = write(tmp_path / "cell", cell, further)
    if told == "sigma":
        text = (tmp_path / "cell" / "dataset.toml").read_text(encoding="utf-8")
        (tmp_path / "cell" / "dataset.toml").write_text(text + "\n[signals]\ntorque_sigma_nm = 0.3\n", encoding="utf-8")
        dataset = load_dataset(tmp_path / "cell")
        assert dataset.robot.measured_loads[0].sigma_from == "dataset.toml"
    assert dataset.robot.measured_loads[0].trust > 0.9 or told == "payload"
    assert_compliance(dataset)


def test_a_saved_model_predicts_where_no_torque_was_measured(tmp_path: Path, cell: Measured) -> None:
    dataset = write(tmp_path / "cell", cell, columns(cell, 0.3))
    fit = calibrate(dataset, effects=SOFT)
    fit.save(tmp_path / "model.json")
    model = load_model(tmp_path / "model.json")
    assert model.needs == ()
    there = FittedModel.of(fit).predict(dataset.poses.q, dataset.poses)
    np.testing.assert_allclose(model.predict(dataset.poses.q), there, atol=0.02)
    write_dataset(dataset, tmp_path / "again")
    again = load_dataset(tmp_path / "again")
    assert again.robot.measured_loads == dataset.robot.measured_loads
    assert again.robot.joints[0].mass_kg is None


def test_torques_that_follow_no_weight_are_not_used(tmp_path: Path, cell: Measured) -> None:
    noise = np.random.default_rng(1).normal(size=N)
    dataset = write(tmp_path / "cell", cell, {"torque2_nm": noise})
    assert not dataset.robot.measured_loads
    assert "do not follow weight" in dataset.warnings[-1]


def test_a_word_for_a_torque_is_an_error_with_its_place(tmp_path: Path, cell: Measured) -> None:
    write(tmp_path / "cell", cell, columns(cell, 0.3))
    path = tmp_path / "cell" / "poses.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[3] = lines[3].rpartition(",")[0] + ",much"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(DatasetError, match=r"poses\.csv: line 4, column torque3_nm: found 'much'; a number is needed"):
        load_dataset(tmp_path / "cell")


def test_a_torque_that_no_weight_makes_is_no_load(tmp_path: Path, cell: Measured) -> None:
    dataset = write(tmp_path / "cell", cell, columns(cell, 0.3, joints=(0, 1, 2)))
    assert [load.joint for load in dataset.robot.measured_loads] == [1, 2]
    assert "torque1_nm" not in dataset.notes[0]
