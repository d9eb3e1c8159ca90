"""What arms of a type share, and another arm that begins there, on an engine that shares no code with calib."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import calibrate
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.errors import CalibError
from calib.extras.fleet.arm_type import ArmType, fit_from_type, learn_type, type_report, with_few_poses
from calib.extras.fleet.type_file import load_type, save_type
from calib.options import FitOptions, TypePrior
from tests.support.commands import answered
from tests.support.fleet_of_type import drawn_fleet

SOFT = "joint_compliance.J2.c_rad_per_nm"


@pytest.fixture(scope="module")
def fleet() -> list[Dataset]:
    """Four arms and a new one with 20 poses."""
    return drawn_fleet(1, arms=5, poses=40)


@pytest.fixture(scope="module")
def fits(fleet: list[Dataset]) -> list[Calibration]:
    return [calibrate(arm, effects=["joint_compliance"]) for arm in fleet[:-1]]


@pytest.fixture(scope="module")
def arm_type(fits: list[Calibration]) -> ArmType:
    return learn_type(fits)


def test_a_type_has_the_mean_of_its_arms_and_their_scatter(arm_type: ArmType, fits: list[Calibration]) -> None:
    values = [fit.fit.x[[p.name for p in fit.fit.parameters].index(SOFT)] for fit in fits]
    prior = arm_type.prior
    assert prior.means[SOFT] == pytest.approx(np.mean(values), rel=0.1)
    usual = next(p.scale for p in fits[0].fit.parameters if p.name == SOFT)
    assert prior.sigmas[SOFT] < 0.5 * usual
    assert prior.sigmas["theta1"] > 0.9 * np.radians(0.5)  # which no frame of a scanner tells
    assert not any(name.endswith("TCP") for name in prior.means)  # tools are each arm's own


def test_a_new_arm_begins_from_its_type(fleet: list[Dataset], arm_type: ArmType) -> None:
    found = fit_from_type(fleet[-1], arm_type)
    assert found.is_of_type
    assert found.log_bayes_factor > 3.0
    links, alone, pooled = (fit.after.test for fit in (calibrate(fleet[-1]), found.alone, found.calibration))
    assert links is not None
    assert alone is not None
    assert pooled is not None
    assert pooled.rmse_mm < 0.5 * links.rmse_mm  # its compliance is known, without a payload and a search
    assert pooled.rmse_mm < 1.02 * alone.rmse_mm


def test_an_arm_of_another_type_is_fitted_alone(fleet: list[Dataset], arm_type: ArmType) -> None:
    far = {name: mean + 6.0 * arm_type.prior.sigmas[name] for name, mean in arm_type.prior.means.items()}
    foreign = replace(arm_type, prior=replace(arm_type.prior, means=far))
    found = fit_from_type(fleet[-1], foreign)
    assert not found.is_of_type
    assert found.calibration is found.alone
    with pytest.raises(CalibError, match="has no a7"):
        fit_from_type(fleet[-1], learn_type([calibrate(arm) for arm in drawn_fleet(2, arms=3, poses=25)[:-1]]))


def test_a_prior_mean_draws_what_the_points_do_not_tell(fleet: list[Dataset]) -> None:
    held = TypePrior({"a2": 0.4, "beta2": 2e-3}, {"a2": 1e-7, "beta2": 1e-9})
    fit = calibrate(fleet[0], type_prior=held)
    x = dict(zip((p.name for p in fit.fit.parameters), fit.fit.x, strict=True))
    assert x["a2"] == pytest.approx(0.4, rel=1e-3)
    assert x["beta2"] == pytest.approx(2e-3, rel=1e-3)
    asked = calibrate(fleet[0], type_prior=held, tolerances={"a2": 1.0}).fit
    assert abs(asked.x[[p.name for p in asked.parameters].index("a2")] - 0.4) > 0.01  # the user's tolerance goes first


def test_arms_that_are_none_of_a_type_are_refused(fits: list[Calibration]) -> None:
    with pytest.raises(CalibError, match="shows in 2 or more"):
        learn_type(fits[:1])
    other = calibrate(drawn_fleet(0, arms=2, poses=25)[0])
    with pytest.raises(CalibError, match="these are no arms of"):
        learn_type([fits[0], other])


def test_a_type_is_read_as_it_was_written(arm_type: ArmType, fleet: list[Dataset], tmp_path: Path) -> None:
    path = tmp_path / "type.json"
    save_type(arm_type, path)
    assert load_type(path, fleet[0].robot) == arm_type
    document = json.loads(path.read_text(encoding="utf-8"))
    document["parameters"][3]["sigma"] = -1.0
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(CalibError, match=r"type\.json: parameters\[3\]\.sigma: found -1; a number above 0 is needed"):
        load_type(path, fleet[0].robot)


def test_a_model_keeps_the_prior_that_it_was_fitted_with(
    arm_type: ArmType, fleet: list[Dataset], tmp_path: Path
) -> None:
    found = fit_from_type(fleet[-1], arm_type).calibration
    found.save(tmp_path / "model.json")
    model = calib.load_model(tmp_path / "model.json")
    assert model.options == found.options
    assert np.allclose(model.model.means, found.model.means)


def test_few_poses_come_from_few_setups(fleet: list[Dataset]) -> None:
    poses = fleet[0].poses
    several = replace(fleet[0], poses=replace(poses, setup=np.array([f"s{k % 4}" for k in range(len(poses))])))
    few = with_few_poses(several, 20, np.random.default_rng(0))
    trained = few.poses.setup[~few.poses.is_test]
    assert np.unique(trained, return_counts=True)[1].tolist() == [10, 10]


def test_pool_prints_each_arm_left_out_and_calibrate_begins_from_it(fleet: list[Dataset], tmp_path: Path) -> None:
    folders = [tmp_path / f"arm{k}" for k in range(4)]
    for folder, arm in zip(folders, [*fleet[:3], fleet[-1]], strict=True):
        write_dataset(arm, folder)
    out = tmp_path / "type.json"
    told = answered("pool", *folders[:3], "--effect", "joint_compliance", "--out", out)
    assert [one["arm"] for one in told["left_out"]] == ["arm 1", "arm 2", "arm 3"]
    assert all(one["poses"] == 20 and one["ratio"] < 1.1 for one in told["left_out"])
    fitted = answered("calibrate", folders[3], "--type", out)
    assert fitted["type"]["is_of_type"]
    assert fitted["type"]["log_bayes_factor"] > 3.0
    words = type_report([calib.load_dataset(folder) for folder in folders[:2]], FitOptions()).summary()
    assert "with three arms or more it could be tried on each" in words
