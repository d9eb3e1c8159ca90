"""Diagnoses of what a camera measured: the lens that it found itself is no cause, a joint that errs is one."""

from __future__ import annotations

import numpy as np
import pytest

from calib import FitOptions, calibrate, diagnose, load_dataset
from calib.dataset.dataset import Dataset
from calib.extras.camera.board import board_of
from calib.present.fit.calibration import calibration_warnings
from inspector.cli.parser import main
from tests.extras.camera.camera_dataset import simulated_dataset
from tests.extras.camera.marker_poses import write_marker_poses
from tests.support.camera_scene import Scene

BOARD = board_of("charuco:8x6:30:22")
TWICE_A_TURN_RAD = 6e-4  # of joint 3's true angle about what it reports


def dataset_of(seed: int, *, on_flange: bool, poses: int = 40, **scene) -> Dataset:
    rng = np.random.default_rng(seed)
    drawn = Scene.draw(rng, on_flange=on_flange, poses=poses, link_mm=1.0, link_deg=0.1, **scene)
    return simulated_dataset(drawn, BOARD, rng, sigma_px=0.1)


@pytest.mark.thorough
def test_images_are_fitted_as_full_poses_unless_something_else_is_asked_for():
    dataset = dataset_of(0, on_flange=True, poses=20)
    assert dataset.usual_residual == "pose"
    assert calibrate(dataset).residual == "pose"
    assert calibrate(dataset, prior=False).residual == "pose"
    assert calibrate(dataset, residual="position").residual == "position"
    assert calibrate(dataset, FitOptions()).residual == "position"
    assert not any("share" in words for words in calibration_warnings(calibrate(dataset)))
    assert any("share" in words for words in calibration_warnings(calibrate(dataset, residual="position")))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("on_flange", "seeds"),
    [
        pytest.param(True, (3,), id="on the flange"),
        pytest.param(False, (15,), id="in the room", marks=pytest.mark.thorough),
    ],
)
def test_errors_of_a_lens_found_from_the_images_are_no_missing_effect(on_flange, seeds):
    """Draws in which the error of the lens was named, or the residual said to depend on the place in its field."""
    found = [diagnose(dataset_of(seed, on_flange=on_flange)) for seed in seeds]
    assert [one.verdict for one in found] == ["adequate"] * len(seeds)


@pytest.mark.thorough
def test_a_joint_that_errs_twice_a_turn_is_named():
    def driven(q):
        return q + TWICE_A_TURN_RAD * np.sin(2.0 * q) * (np.arange(len(q)) == 2)

    found = diagnose(dataset_of(1, on_flange=True, driven=driven))
    assert found.verdict == "named"
    assert found.missing == ("transmission_error",)
    fit = found.calibration.fit
    of_joint = [x for p, x in zip(fit.parameters, fit.x, strict=True) if p.name.startswith("transmission_error.J3.")]
    assert np.linalg.norm(of_joint) == pytest.approx(TWICE_A_TURN_RAD, rel=0.3)


@pytest.mark.thorough
def test_marker_poses_of_an_arm_with_link_errors_hide_no_effect(tmp_path, capsys):
    """Their noise is not told: what the arm as delivered leaves, 2 mm, is no measure of it."""

    def driven(q):
        return q + 2.0 * TWICE_A_TURN_RAD * np.sin(2.0 * q) * (np.arange(len(q)) == 2)

    rng = np.random.default_rng(2)
    scene = Scene.draw(rng, on_flange=True, poses=40, link_mm=1.0, link_deg=0.1, driven=driven)
    joints, markers = scene.write_joints(tmp_path / "joints.csv"), tmp_path / "markers.csv"
    write_marker_poses(scene, markers, rng, sigma_mm=0.1, sigma_deg=0.03)
    told = ("import", str(tmp_path / "cell"), "--robot", "rb5", "--joints", str(joints), "--marker-poses", str(markers))
    assert main(told) == 0
    assert "which a fit of the links leaves" in capsys.readouterr().out
    dataset = load_dataset(tmp_path / "cell")
    assert not dataset.declares_noise
    assert dataset.scanner.point_sigma_mm < 0.25  # the effect is part of what is left
    assert dataset.usual_residual == "pose"
    found = diagnose(dataset)
    assert found.missing == ("transmission_error",)
