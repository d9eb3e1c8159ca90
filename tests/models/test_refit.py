"""Refit of a saved model to a later recording: held effects, new frame, tool and links."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, frames
from calib.calibration.promise import promise
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.errors import FitError
from calib.models.model_file import load_model
from calib.models.refit import refit
from calib.simulation.simulate import simulate_dataset
from inspector.__main__ import main
from tests.support.arms import random_transform
from tests.support.changed import with_poses
from tests.support.commands import answered, printed, refused

EFFECT = "transmission_error"
TOOL_MM = 3.0
EARLIER = 90  # poses; those behind them are measured later


@pytest.fixture(scope="module")
def whole() -> Dataset:
    """One arm with an effect, measured at the poses of both campaigns."""
    return simulate_dataset("rb5", rng=6, effects=[(EFFECT, 8.0)], poses=180, noise_mm=0.03).dataset


@pytest.fixture(scope="module")
def earlier(whole: Dataset) -> Calibration:
    return calibrate(part(whole, np.arange(EARLIER), "earlier", train=EARLIER - 20), effects=[EFFECT])


@pytest.fixture(scope="module")
def later(whole: Dataset, earlier: Calibration) -> Dataset:
    """Poses of the second campaign, with the instrument elsewhere and another tool; 20 to fit, the rest to test."""
    dataset = part(whole, np.arange(EARLIER, 180), "later", train=20)
    model, x, points = earlier.model, earlier.fit.x, dataset.points
    longer = x + TOOL_MM * np.array([p.name == "dTCP" for p in model.parameters])
    moved_mm = model.predict(longer, dataset.poses) - model.predict(x, dataset.poses)
    scanner_T_base = next(iter(earlier.after.scanner_T_base.values()))
    seen_mm = points.xyz_mm + moved_mm[points.pose] @ scanner_T_base[:3, :3].T
    motion = random_transform(np.random.default_rng(1))
    return dataset.with_points(replace(points, xyz_mm=frames.apply(motion, seen_mm)))


def part(dataset: Dataset, rows: np.ndarray, name: str, train: int) -> Dataset:
    points = dataset.points
    own = points.select(np.isin(points.pose, rows))
    role = np.where(np.arange(len(rows)) < train, "train", "test").astype("<U9")
    role[0] = "reference"
    poses = replace(dataset.poses.select(rows), role=role)
    return replace(dataset, name=name, poses=poses, points=replace(own, pose=np.searchsorted(rows, own.pose)))


def test_held_effects_keep_their_values_and_frame_and_tool_are_found(earlier: Calibration, later: Dataset) -> None:
    for what in ("frame", "links"):
        again = refit(earlier.fitted_model, later, what)
        old = dict(zip((p.name for p in earlier.fit.parameters), earlier.fit.x, strict=True))
        new = dict(zip((p.name for p in again.fit.parameters), again.fit.x, strict=True))
        assert set(old) == set(new)
        sigma = dict(zip(new, again.fit.sigma, strict=True))
        held = [name for name in old if name.startswith(EFFECT) or (what == "frame" and name in ("a2", "theta3"))]
        assert [new[name] for name in held] == pytest.approx([old[name] for name in held], abs=1e-12)
        assert not any(sigma[name] for name in held)
        longer = sum(new[name] - old[name] for name in ("d6", "dTCP"))  # of one length, which two entries share
        assert longer == pytest.approx(TOOL_MM, abs=0.15)
        assert again.after.test.rmse_mm < 1.7 * np.sqrt(3.0) * 0.03
        assert again.before.test.rmse_mm > 5.0 * again.after.test.rmse_mm
        share = promise(again).coverage_90
        assert 0.8 < share < 0.99


def test_it_is_better_than_links_alone_and_frame_needs_few_poses(earlier: Calibration, later: Dataset) -> None:
    again, alone = refit(earlier.fitted_model, later, "links"), calibrate(later)
    assert again.after.test.rmse_mm < 0.7 * alone.after.test.rmse_mm
    few = with_poses(later, role=np.where(np.arange(len(later.poses)) < 6, "train", "test"))
    with pytest.raises(FitError, match="measure at least"):
        refit(earlier.fitted_model, few, "links")
    by_few = refit(earlier.fitted_model, few, "frame").after.test
    assert by_few.rmse_mm < alone.after.test.rmse_mm


def test_the_same_recording_gives_the_same_model(earlier: Calibration) -> None:
    again = refit(earlier.fitted_model, earlier.dataset, "links")
    assert again.after.error_mm == pytest.approx(earlier.after.error_mm, abs=0.02)
    poses = earlier.dataset.poses
    assert again.predict(poses.q, poses) == pytest.approx(earlier.predict(poses.q, poses), abs=0.2)


def test_a_refitted_model_is_saved_and_predicts_the_same(earlier: Calibration, later: Dataset, tmp_path: Path) -> None:
    again = refit(earlier.fitted_model, later, "links")
    again.save(tmp_path / "model.json")
    model = load_model(tmp_path / "model.json")
    q = later.poses.q
    assert model.predict(q, later.poses) == pytest.approx(again.predict(q, later.poses), abs=1e-9)
    assert model.discrepancy is not None
    promised = model.promise(later, model.evaluate(later))
    assert promised.sigma_mm == pytest.approx(promise(again).sigma_mm, rel=0.02)


def test_another_arm_and_an_unknown_part_are_refused(earlier: Calibration, later: Dataset) -> None:
    with pytest.raises(FitError, match="another arm"):
        refit(earlier.fitted_model, simulate_dataset("panda", rng=0, poses=40).dataset, "frame")
    with pytest.raises(FitError, match="expected frame or links"):
        refit(earlier.fitted_model, later, "tool")


@pytest.mark.thorough
def test_the_command_refits_and_says_what_goes_together(
    earlier: Calibration, later: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    earlier.save(tmp_path / "old.json")
    write_dataset(later, tmp_path / "later")
    given = ["calibrate", str(tmp_path / "later"), "--model", str(tmp_path / "old.json")]
    document = answered(*given, "--refit", "links")
    assert document["effects"] == [EFFECT]
    assert document["test"]["rmse_mm"] < 0.3 * document["before"]["test"]["rmse_mm"]
    assert 0.0 <= document["coverage_90"] <= 1.0
    few = [f"--leave-out={name}" for name in later.poses.ids[7:20]]
    assert "90 % intervals" in printed(*given, "--refit", "frame", *few)
    for wrong, words in (
        (given, "--refit frame or --refit links"),
        ([*given[:2], "--refit", "frame"], "--model FILE.json"),
        ([*given, "--refit", "links", "--add", "backlash"], "leave out --add"),
    ):
        assert main(wrong) == 2
        assert words in capsys.readouterr().err
    write_dataset(simulate_dataset("panda", rng=0, poses=40).dataset, tmp_path / "panda")
    assert "another arm" in refused("calibrate", tmp_path / "panda", *given[2:], "--refit", "frame")
