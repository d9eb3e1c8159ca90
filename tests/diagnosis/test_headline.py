"""The headline: which models it tells of, in which unit, and when it says that noise alone is left."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.noise_level import DECLARED, NoiseLevel, noise_level
from calib.calibration.result import Calibration
from calib.dataset.dataset import Scanner
from calib.diagnosis.headline import NOISE_AGREES, ErrorStage, Headline, headline_of, noise_agrees
from calib.effects.catalogue import effects_named
from calib.present.fit.errors import error_headline, note
from calib.rendering.text import block_text
from tests.support.hidden_dataset import arm

NAMES = ("as delivered", "with calibrated links", "with joint_compliance")


def headline_text(headline: Headline) -> str:
    return block_text(error_headline(headline)).splitlines()[0]


def told(*errors_mm: float, noise_mm: float | None = 0.0062, of_test_poses: bool = True) -> Headline:
    stages = [
        ErrorStage(name, mm, k - 1 if k else None) for k, (name, mm) in enumerate(zip(NAMES, errors_mm, strict=False))
    ]
    sigma_mm = np.nan if noise_mm is None else noise_mm / np.sqrt(3.0)
    return Headline(tuple(stages), NoiseLevel(sigma_mm, DECLARED, 1.0), of_test_poses)


@pytest.fixture(scope="module")
def fits() -> dict[str, Calibration]:
    """The same points with four models."""
    dataset = arm(5, ("joint_compliance", 3.0), ("tool_sag", 3.0))
    models: dict[str, list[str]] = {
        "links": [],
        "compliance": ["joint_compliance"],
        "sag": ["tool_sag"],
        "both": ["joint_compliance", "tool_sag"],
    }
    return {name: calibrate(dataset, effects=effects_named(dataset, of)) for name, of in models.items()}


@pytest.mark.slow
def test_a_stage_for_the_nominal_robot_the_links_and_each_effect(fits: dict[str, Calibration]) -> None:
    found = headline_of([fits["links"], fits["compliance"], fits["both"]])
    assert [s.name for s in found.stages] == [*NAMES, "with tool_sag"]
    assert [s.step for s in found.stages] == [None, 0, 1, 2]
    assert [s.effects for s in found.stages] == [(), (), ("joint_compliance",), ("tool_sag",)]
    assert found.of_test_poses
    for stage in found.stages[1:]:
        assert stage.step is not None
        of_it = (fits["links"], fits["compliance"], fits["both"])[stage.step].after.test
        assert stage.error_mm == of_it.rmse_mm
    before = fits["both"].before.test
    assert found.stages[0].error_mm == before.rmse_mm
    assert found.noise == noise_level(fits["both"])


def test_effects_taken_as_present_are_told_with_the_links(fits: dict[str, Calibration]) -> None:
    found = headline_of([fits["compliance"]])
    assert found.stages[1].name == "with calibrated links and joint_compliance"


def test_without_test_poses_the_fitted_ones_are_told_and_it_says_so() -> None:
    dataset = arm(5)
    role = np.where(dataset.poses.role == "test", "train", dataset.poses.role)
    bare = replace(dataset, scanner=Scanner(), poses=replace(dataset.poses, role=role))
    bare = replace(bare, points=replace(bare.points, covariance_mm2=None))
    fit = calibrate(bare)
    found = headline_of([fit])
    assert not found.of_test_poses
    assert found.stages[-1].error_mm == fit.after.train.rmse_mm
    assert "no test poses, so nothing confirms it" in note(found)
    assert re.search(r"\(noise as the fit left it [\d.]+ (mm|µm): not declared\)$", headline_text(found))
    assert not found.reached_noise
    assert "No noise was declared" in note(found)


def test_noise_is_said_only_where_the_test_error_agrees() -> None:
    assert note(told(1.9, 0.72, 0.0065)).endswith("What is left is no more than noise.")
    assert note(told(1.9, 0.72, 0.03954)).endswith("What is left is 6.4 times the noise.")
    assert note(told(1.9, 0.744)).endswith("What is left is 120 times the noise.")
    assert told(1.0, NOISE_AGREES * 0.0062).reached_noise
    assert not told(1.0, 1.01 * NOISE_AGREES * 0.0062).reached_noise


def test_many_points_tell_a_smaller_excess_from_noise() -> None:
    assert all(noise_agrees(1.45, coordinates) for coordinates in (1, 15, 45))
    assert not noise_agrees(1.45, 180)
    assert noise_agrees(1.25, 100_000)  # a declared sigma is no more accurate
    assert replace(told(1.0, 1.45 * 0.0062), points=10).reached_noise
    few, many = (replace(told(1.0, 1.45 * 0.0062), points=points) for points in (10, 60))
    assert note(few).endswith("What is left is no more than noise.")
    assert note(many).endswith("What is left is 1.4 times the noise.")
