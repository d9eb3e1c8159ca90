"""Encoders on the links: the arm is fitted by them, and what lies between motor and link is told without a tracker."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.models.model_file import load_model
from tests.support.mujoco_arm import mujoco
from tests.support.signal_cell import COMPLIANCE, Measured, measured, write

N = 70
SIGMA_DEG = 3e-4
ECCENTRIC_RAD = 4e-4  # of joint 5, twice a turn


@pytest.fixture(scope="module")
def cell() -> Measured:
    """An arm whose joints 2 and 3 yield and whose joint 5 runs unevenly."""
    mujoco()
    q = measured(N).q
    uneven = np.zeros_like(q)
    uneven[:, 4] = ECCENTRIC_RAD * np.sin(2.0 * q[:, 4] + 0.7)
    return measured(N, further=uneven)


def columns(cell: Measured, joints: tuple[int, ...] = (1, 2, 4)) -> dict:
    """Angles of the links, each with a zero of its own."""
    rng = np.random.default_rng(8)
    return {
        f"link_q{j + 1}_deg": np.degrees(cell.link_q[:, j]) + 3.0 - j + SIGMA_DEG * rng.normal(size=N) for j in joints
    }


@pytest.fixture(scope="module")
def dataset(cell: Measured, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return write(tmp_path_factory.mktemp("links") / "cell", cell, columns(cell), masses=True)


def test_the_drive_is_told_without_the_instrument(dataset: Dataset) -> None:
    second, third, fifth = dataset.robot.link_encoders
    for encoder, joint in ((second, 1), (third, 2)):
        (term,) = encoder.terms
        assert (encoder.joint, term.law) == (joint, "joint_compliance")
        assert abs(term.values[0] - COMPLIANCE[joint]) < max(4.0 * term.sigmas[0], 0.004 * COMPLIANCE[joint])
    assert [term.law for term in fifth.terms] == ["harmonic 2"]
    np.testing.assert_allclose(fifth.terms[0].values, ECCENTRIC_RAD * np.array([np.cos(0.7), np.sin(0.7)]), atol=4e-6)
    assert fifth.left_rad < 1.5 * np.radians(SIGMA_DEG)


def test_the_links_alone_fit_the_points_to_their_noise(dataset: Dataset, cell: Measured, tmp_path: Path) -> None:
    fit = calibrate(dataset)
    assert fit.sigma_mm < 0.036
    by_motor = calibrate(write(tmp_path / "motors", cell, {}, masses=True))
    assert by_motor.sigma_mm > 0.5


def test_a_saved_model_reaches_targets_by_the_laws_of_the_drives(
    dataset: Dataset, cell: Measured, tmp_path: Path
) -> None:
    calibrate(dataset).save(tmp_path / "model.json")
    model = load_model(tmp_path / "model.json")
    assert model.needs == ()
    off_mm = np.linalg.norm(model.predict(cell.q) - model.predict(cell.q, dataset.poses), axis=1)
    assert off_mm.max() < 0.1
    write_dataset(dataset, tmp_path / "again")
    assert load_dataset(tmp_path / "again").robot.link_encoders == dataset.robot.link_encoders


def test_without_masses_the_difference_is_still_explained(cell: Measured, tmp_path: Path) -> None:
    encoder = write(tmp_path / "cell", cell, columns(cell, (1,))).robot.link_encoders[0]
    assert [term.law for term in encoder.terms] == ["unknown_masses"]
    assert encoder.left_rad < 0.02 * encoder.rms_rad


def test_a_column_of_another_sign_is_not_used(cell: Measured, tmp_path: Path) -> None:
    dataset = write(tmp_path / "cell", cell, {"link_q2_deg": -np.degrees(cell.link_q[:, 1])})
    assert not dataset.robot.link_encoders
    assert "check its sign and its joint" in dataset.warnings[-1]
