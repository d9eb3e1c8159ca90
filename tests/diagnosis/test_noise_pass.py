"""Noise that is not white is no missing effect, and no missing effect is noise of a strange shape."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.diagnose import noise_is_believed
from calib.diagnosis.effect_selection import SelectedEffect
from calib.diagnosis.result import Diagnosis
from calib.screening.noise_search import noise_of_residual
from tests.support.odd_noise import SIGMA_MM, odd_arm
from tests.support.sweeps import sweep
from tests.support.third_engine.cases import Case, simulate
from tests.support.third_engine.folder import write_folder

pytestmark = pytest.mark.slow


def shape_words(found: Diagnosis) -> str:
    noise = found.to_dict()["noise"]
    assert noise["words"] in found.summary()
    return str(noise["words"])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "seed", "words"),
    [
        ("deep", 3, "times coarser in depth, along z of its frame,"),
        ("growing", 0, "with each metre of distance"),
        ("wandering", 4, "is a slow drift"),
        ("student", 5, "heavier tails than a normal distribution"),
    ],
)
def test_a_clean_arm_is_adequate_and_the_noise_is_told(kind: str, seed: int, words: str) -> None:
    found = diagnose(odd_arm(kind, seed))
    assert found.verdict == "adequate"
    assert not found.missing
    assert not found.suspected
    assert words in shape_words(found)
    assert found.calibration.sigma_mm == pytest.approx(SIGMA_MM, rel=0.3)


@pytest.mark.parametrize("kind", ["deep", "growing", "wandering"])
@pytest.mark.thorough
def test_an_effect_stays_named_in_such_noise(kind: str) -> None:
    found = diagnose(odd_arm(kind, 2, ["transmission_error"], sigmas=4.0))
    assert (found.verdict, found.missing) == ("named", ("transmission_error",))
    assert found.calibration.options.noise == found.noise.shape


@pytest.mark.parametrize("effect", ["scanner_drift", "thermal_growth"])
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.thorough
def test_a_true_drift_is_no_wander(effect: str, seed: int) -> None:
    found = diagnose(odd_arm("white", seed, [effect], sigmas=3.0))
    assert found.missing == (effect,)
    assert found.unproven == ""
    assert found.noise is None


def swaying(seed: int, sigmas: float) -> Dataset:
    """A scanner that sways three times in a session: no effect of the catalogue, and it looks like a wander."""
    dataset = odd_arm("white", seed)
    phase = 6.0 * np.pi * dataset.poses.time_s / np.ptp(dataset.poses.time_s)
    shift = sigmas * SIGMA_MM * np.sin(phase)[:, None] * [1.0, -0.7, 0.5]
    points = replace(dataset.points, xyz_mm=dataset.points.xyz_mm + shift[dataset.points.pose])
    return dataset.with_points(points)


def test_a_cause_larger_than_the_noise_is_not_taken_for_its_shape() -> None:
    found = diagnose(swaying(0, 4.0))
    assert found.verdict == "unexplained"
    assert found.noise is None


def test_without_a_declared_sigma_no_shape_explains_what_is_left() -> None:
    found = diagnose(odd_arm("deep", 3))
    before = replace(found, implausible="none of the poses fits")
    assert before.verdict == "unexplained"
    assert noise_is_believed(before, found)
    undeclared = replace(found, all_tests=replace(found.all_tests, lack_of_fit_p=None))
    assert not noise_is_believed(before, undeclared)


def test_a_claim_is_not_lost_to_a_shape() -> None:
    found = diagnose(odd_arm("deep", 3))
    drift = SelectedEffect("scanner_drift", (), {})
    before = replace(found, steps=(replace(found.steps[-1], selected=(drift,)),))
    assert (before.verdict, before.missing) == ("named", ("scanner_drift",))
    assert not noise_is_believed(before, found)


@pytest.mark.parametrize("sigmas", sweep([2.0, 6.0], every_run=[2.0]))
def test_what_sways_slowly_is_not_claimed_as_a_step(sigmas: float) -> None:
    found = diagnose(swaying(0, sigmas))
    assert found.verdict in ("unexplained", "adequate")
    assert not found.missing
    if found.verdict == "unexplained":
        assert found.noise is None


def test_nothing_is_told_of_white_noise() -> None:
    found = diagnose(odd_arm("white", 1))
    assert found.noise is None
    assert found.to_dict()["noise"] is None
    assert found.calibration.options.noise is None


def test_repeats_are_believed_whatever_else_is_left() -> None:
    repeats = odd_arm("deep", 0, repeats=3)
    found = diagnose(repeats)
    assert found.verdict == "adequate"
    assert found.noise.from_repeats
    assert "The repeated measurements show this;" in shape_words(found)
    noise = found.to_dict()["noise"]
    assert noise["axes_mm"][2] / noise["axes_mm"][0] == pytest.approx(3.0, rel=0.2)
    assert noise["isotropic_mm"] == pytest.approx(SIGMA_MM, rel=0.15)


@pytest.mark.thorough
def test_a_wander_that_explains_as_much_keeps_a_drift_from_being_claimed() -> None:
    found = diagnose(odd_arm("wandering", 8))
    rival = found.noise.rival
    assert rival in ("scanner_drift", "scanner_step")
    assert rival not in found.named
    assert f"so {rival} is not claimed" in shape_words(found)


def test_what_repeats_show_ends_the_search_for_the_noise_of_single_points(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The means of these repeats seem to scatter more with the distance, which the repeats do not."""
    repeats = load_dataset(write_folder(simulate(Case("nothing", 0, seed=1)), tmp_path / "cell"))
    asked: list[int] = []

    def counted(*arguments: object) -> object:
        asked.append(1)
        assert len(asked) < 5, "the search for the noise does not end"
        return noise_of_residual(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr("calib.diagnosis.diagnose.noise_of_residual", counted)
    found = diagnose(repeats)
    assert asked
    assert found.verdict == "adequate"
    assert found.noise.from_repeats
