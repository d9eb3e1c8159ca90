"""A fit that raises the test poses' error is reported in warnings, JSON and headline."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.diagnosis.headline import headline_of
from calib.options import FitOptions
from calib.present.fit import errors as headlines
from calib.present.fit.calibration import calibration_document, calibration_warnings
from calib.rendering.numbers import length_change
from tests.support.arms import dataset_of, jang_arm, perturbed
from tests.support.changed import with_poses
from tests.support.commands import answered


def exact_arm(*, slide: bool = False, setups: int = 1) -> Dataset:
    """Dataset of an arm without errors, few poses, 0.05 mm noise, so that any fitted correction is noise."""
    robot = jang_arm()
    if slide:
        joints = list(robot.joints)
        joints[2] = replace(joints[2], type="prismatic", min=-200.0, max=200.0)
        robot = replace(robot, joints=tuple(joints))
    dataset = dataset_of(
        robot, robot, np.random.default_rng(4), poses=12 * setups + 12 * (1 + slide), test=12, noise_mm=0.05
    )
    names = np.array([f"s{i % setups}" for i in range(len(dataset.poses))])
    return with_poses(dataset, setup=names)


@pytest.mark.parametrize(
    ("dataset", "options"),
    [
        (exact_arm(setups=2), FitOptions(prior=False)),
        (exact_arm(slide=True), FitOptions("distance", prior=False)),
        (exact_arm(setups=2), FitOptions("distance", prior=False)),
    ],
)
def test_a_fit_that_is_worse_says_so(dataset: Dataset, options: FitOptions) -> None:
    fit = calibrate(dataset, options)
    before, after = fit.before.test, fit.after.test
    assert after.rmse_mm > before.rmse_mm
    (said,) = [w for w in calibration_warnings(fit) if "worse than robot.toml" in w]
    assert length_change(before.rmse_mm, after.rmse_mm) in said
    assert calibration_document(fit)["worse_than_nominal"] == said
    assert said[1:] in fit.summary()  # with a capital letter
    assert "worse than robot.toml" in headlines.note(headline_of([fit]))


def test_a_fit_that_is_better_does_not() -> None:
    rng = np.random.default_rng(0)
    dataset = dataset_of(jang_arm(), perturbed(jang_arm(), rng), rng, poses=48, test=12, noise_mm=0.05)
    fit = calibrate(dataset)
    assert fit.worsening is None
    assert calibration_document(fit)["worse_than_nominal"] is None
    assert "rose" not in headlines.note(headline_of([fit]))


@pytest.mark.slow
def test_diagnose_has_the_key(tmp_path: Path) -> None:
    write_dataset(exact_arm(setups=2), tmp_path / "cell")
    document = answered("diagnose", tmp_path / "cell", "--no-prior", "--max-steps", "0")
    assert "worse than robot.toml" in document["worse_than_nominal"]
