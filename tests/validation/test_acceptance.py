"""The check: what fails it, what is a warning, and what is only told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import check, find_corners
from calib.dataset.dataset import Dataset, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.jig import Jig
from calib.present.over_time.checks import check_head
from calib.rendering.text import block_text
from calib.scans.scan import READERS, PointCount
from calib.simulation.simulate import simulate_dataset, write_simulation
from calib.validation import acceptance
from calib.validation.acceptance import CheckItem, ErrorRatio, ResidualSigma, thin_scans
from inspector.cli.parser import main
from tests.support.arms import dataset_of, jang_arm, perturbed
from tests.support.changed import with_xyz
from tests.support.commands import answered, printed
from tests.support.scan_scene import make_scene


def measured(poses: int = 50, noise_mm: float = 0.03, sigma_mm: float | None = 0.03) -> Dataset:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    made = dataset_of(robot, perturbed(robot, rng), rng, poses=poses, test=13, noise_mm=noise_mm)
    return replace(made, scanner=Scanner(sigma_mm))


def spoilt(dataset: Dataset, by_mm: float, poses: int = 13) -> Dataset:
    """The first test poses' points moved by so much, each along an axis of its own."""
    xyz = dataset.points.xyz_mm.copy()
    rows = np.flatnonzero(dataset.poses.is_test[dataset.points.pose])[:poses]
    xyz[rows, np.arange(len(rows)) % 3] += by_mm
    return with_xyz(dataset, xyz)


def finding(of: tuple[CheckItem, ...], name: str) -> CheckItem:
    (found,) = (f for f in of if f.name == name)
    return found


@pytest.mark.thorough
def test_a_test_error_of_a_multiple_of_the_training_error_is_a_warning() -> None:
    """The warning names the worst pose; where all test poses are off by more than was promised, the check fails."""
    good = finding(check(measured()).items, "test against training")
    assert (good.passed, good.warning) == (None, False)
    for poses, least in ((13, 10.0), (1, 2.0)):
        dataset = spoilt(measured(), 0.5, poses=poses)
        found = check(dataset)
        against = finding(found.items, "test against training")
        assert (against.passed, against.warning) == (None, True)
        assert isinstance(against.evidence, ErrorRatio)
        assert against.evidence.ratio > least
        expected = np.sqrt((111 + 25) / (111 - 25))  # 19 and a frame of 37 poses
        assert against.evidence.expected == pytest.approx(expected, abs=0.01)
        assert found.passed is (poses == 1)  # all of them break what the fit promised; of one it may be the pose
        assert against in found.warnings
        if poses > 1:
            assert "promise" in [item.name for item in found.failed]
        assert "    WARN  test against training  " in found.summary()
    first = dataset.poses.ids[int(np.flatnonzero(dataset.poses.is_test)[0])]
    assert isinstance(against.evidence, ErrorRatio)
    assert against.evidence.worst_pose == first
    assert 0.0 < against.evidence.worst_mm < 1.0
    assert not check(dataset, max_test_rmse_mm=0.1).passed


@pytest.mark.slow
def test_no_more_than_noise_is_well_however_small_the_training_error() -> None:
    """Few poses more than parameters: the fit bends to its own noise, and does not know the arm the worse for it."""
    declared = check(measured(poses=22 + 13, noise_mm=0.0, sigma_mm=0.03))
    assert finding(declared.items, "test against training").passed is None
    assert not finding(declared.items, "test against training").warning
    exact = check(measured(noise_mm=0.0, sigma_mm=None))
    assert finding(exact.items, "test against training").passed is None
    assert exact.passed


@pytest.mark.thorough
def test_points_of_another_arm_fail_without_test_poses_too() -> None:
    dataset = measured()
    only_training = replace(dataset.poses, role=np.where(dataset.poses.is_test, "train", dataset.poses.role))
    mixed = np.random.default_rng(0).permutation(dataset.points.xyz_mm)
    found = check(replace(dataset, poses=only_training, points=replace(dataset.points, xyz_mm=mixed)))
    assert not found.passed
    residual = finding(found.items, "residual").evidence
    assert isinstance(residual, ResidualSigma)
    assert residual.meaning == "implausible"


@pytest.mark.thorough
def test_what_to_look_at_is_a_warning_and_in_the_json(tmp_path: Path) -> None:
    dataset = measured(sigma_mm=0.01)
    only_training = replace(dataset.poses, role=np.where(dataset.poses.is_test, "train", dataset.poses.role))
    copied = dataset.points.select(np.r_[np.arange(len(dataset.points)), 0])
    write_dataset(replace(dataset, poses=only_training, points=copied), tmp_path / "cell")
    document = answered("check", tmp_path / "cell")
    assert document["passed"] is True
    assert [warning.split(":")[0] for warning in document["warnings"]] == [
        "dataset",
        "test poses",
        "residual",
        "diagnosis",
    ]
    assert "to the last digit" in document["warnings"][0]
    warned = [f["name"] for f in document["findings"] if f["warning"]]
    assert warned == ["dataset", "test poses", "residual", "diagnosis"]
    assert "passed, with 4 warnings" in printed("check", tmp_path / "cell")


def test_scans_that_lose_more_than_half_of_their_points_are_a_warning() -> None:
    def told(**counts: tuple[int, int]) -> list[str]:
        given = {pose: PointCount(*count) for pose, count in counts.items()}
        return [f.headline for f in thin_scans(given)]

    assert told(p1=(100, 0), p2=(100, 100)) == []
    (words,) = told(p1=(100, 0), p2=(100, 101), p3=(10, 90))
    assert words.startswith("2 of 3 lose more than half of their points")
    assert "the worst, p3, 90 of 100;" in words


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """A dataset of three scans: whole, with 500 pixels at the scanner's own place, and mostly without a value."""
    robot = jang_arm()
    dataset = dataset_of(robot, robot, np.random.default_rng(0), poses=3, test=0)
    folder = tmp_path / "cell"
    names = tuple(f"{pose_id}.xyz" for pose_id in dataset.poses.ids)
    scan_poses = replace(dataset.poses, scan_names=names)
    write_dataset(replace(dataset, points=None, folder=None, scan_folder="scans", poses=scan_poses, jig=Jig()), folder)
    for seed, (name, zeros, nans) in enumerate(zip(names, (0, 500, 0), (0, 0, 9000), strict=True)):
        points = make_scene(np.random.default_rng(seed), 6_000).scan.points_mm
        empty = [np.zeros((zeros, 3)), np.full((nans, 3), np.nan)]
        np.savetxt(folder / "scans" / name, np.concatenate([points, *empty]), fmt="%.5f")
    return folder


@pytest.mark.slow
def test_corners_tells_the_points_that_were_left_out(scans: Path) -> None:
    assert ".xyz" in READERS
    document = answered("corners", scans)
    scanned = document["corners"] + document["failed"]
    assert [c["dropped_points"] for c in scanned] == [0, 500, 9000]
    assert all(4000 < c["points"] < 7000 for c in scanned)
    heading, *rows = printed("corners", scans).splitlines()
    assert "points without a value, left out" in heading
    for row, dropped in zip(rows, ("–", "500", "9,000"), strict=False):
        assert f"  {dropped}  " in row


@pytest.mark.slow
def test_check_warns_of_a_scan_without_most_of_its_points(capsys: pytest.CaptureFixture[str], scans: Path) -> None:
    main(["check", str(scans)])
    assert "1 of 3 lose more than half of their points" in capsys.readouterr().out


def test_a_scan_that_cannot_be_read_is_not_counted(scans: Path) -> None:
    (scans / "scans" / "p0001.xyz").write_text("no numbers here\n")
    searches = find_corners(load_dataset(scans), intermediate=False)
    counts = {pose_id: search.count for pose_id, search in searches.items()}
    assert counts["p0001"] is None
    assert counts["p0000"].dropped == 0
    assert counts["p0002"].dropped == 9000


@pytest.mark.slow
@pytest.mark.parametrize(("sigma_mm", "warned"), [(0.03, False), (0.04, False), (0.12, True)])
def test_a_sigma_declared_far_too_large_is_a_warning(sigma_mm: float, warned: bool) -> None:
    """0.03 mm were simulated; a little more is a cautious user's."""
    found = finding(check(measured(sigma_mm=sigma_mm)).items, "residual")
    assert (found.passed, found.warning) == (None, warned)
    assert isinstance(found.evidence, ResidualSigma)
    assert (found.evidence.meaning == "below") == warned


def test_scans_are_judged_before_there_are_poses_enough_for_a_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two scans: good enough to go on, or coarser than what tells much of an arm."""
    write_simulation(simulate_dataset("rb5", rng=1, poses=2, scans=True), tmp_path / "first")
    found = check(tmp_path / "first")
    assert found.poses_missing is not None
    assert (found.passed, found.poses_missing.needed) == (False, 9)
    assert "the scans are good enough; measure 9 training poses" in block_text(*check_head(found))

    monkeypatch.setattr(acceptance, "COARSE_CORNER_MM", 0.01)
    coarse = check(tmp_path / "first")
    assert coarse.poses_missing is None
    assert finding(coarse.items, "corners").status == "WARN"
