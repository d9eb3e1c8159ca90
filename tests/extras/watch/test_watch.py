"""What check poses say of a cell that MuJoCo measured: unchanged, the arm, the scanner, or the noise."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.result import Calibration
from calib.dataset.dataset import About, Dataset, Scanner
from calib.dataset.files.folder import write_dataset
from calib.errors import FitError
from calib.extras.watch.watch import ChangeReport, watch
from inspector.cli.parser import main
from tests.support.checked_cell import Cell

pytestmark = pytest.mark.slow
ARMS = 3
Drawn = tuple[np.random.Generator, Cell, Calibration]


@pytest.fixture(scope="module")
def cells() -> list[Drawn]:
    out = []
    for seed in range(ARMS):
        rng = np.random.default_rng(seed)
        cell = Cell.drawn(rng)
        out.append((rng, cell, calibrate(cell.measured(rng, 64, "base"))))
    return out


def whats(seen: ChangeReport) -> list[str]:
    return [f"{change.what} {change.joint or ''}".strip() for change in seen.changes]


def set_up_anew(new: Dataset) -> Dataset:
    """Check poses from a placement of the scanner that the earlier fit does not know."""
    return replace(new, poses=replace(new.poses, setup=np.full(len(new.poses), "another")))


def test_an_unchanged_cell_raises_no_alarm(cells: list[Drawn]) -> None:
    seen = [watch(base, cell.measured(rng)) for rng, cell, base in cells for _ in range(6)]
    assert [w.verdict for w in seen].count("unchanged") >= len(seen) - 1
    calm = next(w for w in seen if w.verdict == "unchanged")
    assert "unchanged" in calm.headline
    assert calm.rmse_mm < 4.0 * calm.expected_mm


@pytest.mark.parametrize("joint", [2, 3])
def test_a_slipped_joint_is_named_with_its_size(cells: list[Drawn], joint: int) -> None:
    by = np.radians(0.03)
    for rng, cell, base in cells:
        found = watch(base, cell.with_changes({f"theta{joint}": by}).measured(rng))
        assert whats(found) == [f"joint_zero {joint}"]
        change = found.changes[0]
        assert abs(change.size - by) < 4.0 * change.sigma < by
        assert f"zero of joint {joint} (theta{joint})" in found.headline


def test_a_scanner_that_moved_is_never_blamed_on_the_arm(cells: list[Drawn]) -> None:
    for rng, cell, base in cells:
        for size in (0.1, 1.0, 10.0):
            moved = cell.with_scanner_moved(rng.normal(size=3) * size * 1e-4, rng.normal(size=3) * size)
            new = moved.measured(rng)
            found = watch(base, new)
            assert whats(found) in (["scanner"], []), found.headline  # a tenth of a millimetre may pass unseen
            assert whats(found) == ["scanner"] or size == 0.1
            assert watch(base, set_up_anew(new)).verdict == "unchanged"


def test_a_slip_beside_a_moved_scanner_is_still_found(cells: list[Drawn]) -> None:
    for rng, cell, base in cells:
        changed = cell.with_changes({"theta3": np.radians(0.08)}).with_scanner_moved(
            np.array([0.01, 0.0, 0.0]), np.array([5.0, 0.0, 0.0])
        )
        assert whats(watch(base, changed.measured(rng))) == ["joint_zero 3", "scanner"]


def test_a_tool_that_moved_and_more_noise(cells: list[Drawn]) -> None:
    for rng, cell, base in cells:
        found = watch(base, cell.with_changes({"aTCP": 0.4}).measured(rng))
        assert whats(found)[0] == "tool"
        assert np.linalg.norm(found.changes[0].vector) == pytest.approx(0.4, abs=0.2)
        new = cell.measured(rng, 12)
        assert new.points is not None
        more_mm = 0.25 * rng.normal(size=new.points.xyz_mm.shape)
        noisy = new.with_points(replace(new.points, xyz_mm=new.points.xyz_mm + more_mm))
        assert whats(watch(base, noisy)) == ["noise"]


def test_what_is_promised_is_found(cells: list[Drawn]) -> None:
    rng, cell, base = cells[0]
    poses = cell.measured(rng)
    calm = watch(base, set_up_anew(poses))
    sizes = {(d.what, d.joint): d.size for d in calm.detectable if d.what == "joint_zero"}
    assert sizes["joint_zero", 1] is None or sizes["joint_zero", 1] > 5 * (sizes["joint_zero", 3] or 0.0)
    size = sizes["joint_zero", 3]
    assert size is not None
    hits = [
        watch(base, set_up_anew(cell.with_changes({"theta3": size}).measured(rng, q=poses.poses.q))).changes
        for _ in range(20)
    ]
    assert sum(map(bool, hits)) >= 16  # 19 of 20 are promised


def test_too_few_poses_and_another_robot_are_refused(cells: list[Drawn]) -> None:
    rng, cell, base = cells[0]
    with pytest.raises(FitError, match="found 2 measured poses"):
        watch(base, cell.measured(rng, 2))
    panda = Cell.drawn(rng, "panda")
    with pytest.raises(FitError, match="other joints"):
        watch(base, panda.measured(rng))


def test_the_command_tells_it_and_its_exit_code_alarms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(7)
    cell = Cell.drawn(rng)
    march = cell.measured(rng, 64, "march")
    q = np.repeat(march.poses.q[:4], 2, axis=0)  # visited again, and twice
    later = cell.with_changes({"theta2": np.radians(0.05)}).measured(rng, q=q)
    for dataset, name, date in (
        (march, "march", "2026-03-02"), (cell.measured(rng, q=q), "april", "2026-04-01"),
        (later, "october", "2026-10-01"),
    ):  # fmt: skip
        write_dataset(replace(dataset, name=name, about=About(date=date)), tmp_path / name)
    folders = [str(tmp_path / name) for name in ("march", "april", "october")]
    assert main(["watch", *folders[:2]]) == 0
    assert "unchanged" in capsys.readouterr().out
    backwards = [folders[0], *folders[:0:-1]]
    assert main(["watch", *backwards, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert [w["name"] for w in document["new"]] == ["april", "october"]  # by date
    assert [w["verdict"] for w in document["new"]] == ["unchanged", "changed"]
    changed = document["new"][1]
    assert (changed["changes"][0]["what"], changed["changes"][0]["joint"]) == ("joint_zero", 2)
    assert {"what", "joint", "size", "sigma", "unit"} <= set(changed["changes"][0])
    assert changed["rmse_mm"] == document["rmse_mm"] > document["limit_mm"] > document["new"][0]["rmse_mm"]
    assert main(["watch", folders[0], str(tmp_path / "none")]) == 2


def test_a_scanner_far_from_where_it_was_is_no_noise(cells: list[Drawn]) -> None:
    rng, cell, base = cells[1]
    for k in range(10):  # turns beside shifts: rad and mm are many powers of ten apart
        moved = cell.with_scanner_moved(rng.normal(size=3) * 10 ** (-0.4 * k - 1), rng.normal(size=3))
        seen = watch(base, moved.measured(rng))
        assert whats(seen) == (["scanner"] if seen.set_up_anew_mm is None else [])
        assert (k < 2) == (seen.set_up_anew_mm is not None)


def test_a_scanner_that_was_set_up_anew_is_no_change_and_hides_none(cells: list[Drawn]) -> None:
    rng, cell, base = cells[1]
    elsewhere = cell.with_scanner_moved(np.array([0.1, -0.05, 0.2]), np.array([200.0, 150.0, -80.0]))
    seen = watch(base, elsewhere.measured(rng))
    assert seen.verdict == "unchanged"
    assert "The instrument was set up anew" in seen.summary()
    slipped = watch(base, elsewhere.with_changes({"theta3": np.radians(0.08)}).measured(rng))
    assert whats(slipped) == ["joint_zero 3"]


def test_residuals_that_happened_to_be_small_make_no_alarms() -> None:
    rng = np.random.default_rng([0, *b"UR10e"])
    cell = Cell.drawn(rng)
    base = calibrate(cell.measured(rng, 64, "base"))

    def with_residuals(reduced_chi: float) -> Calibration:
        covariance = (reduced_chi / base.fit.reduced_chi) ** 2 * base.fit.covariance
        return replace(base, fit=replace(base.fit, reduced_chi=reduced_chi, covariance=covariance))

    lucky, poses = with_residuals(0.8), cell.measured(rng)
    assert watch(lucky, poses).expected_mm == pytest.approx(0.05 * np.sqrt(3.0))
    quiet = with_residuals(0.3)  # no chance: the scanner is better than declared
    assert watch(quiet, poses).expected_mm == pytest.approx(0.3 * 0.05 * np.sqrt(3.0))


def declaring(dataset: Dataset, sigma_mm: float | None) -> Dataset:
    return replace(dataset, scanner=Scanner(point_sigma_mm=sigma_mm))


@pytest.mark.parametrize(("earlier", "later"), [(None, 0.05), (None, None), (0.05, None)])
def test_noise_that_is_not_declared_is_as_the_fit_left_it(
    cells: list[Drawn], earlier: float | None, later: float | None
) -> None:
    for rng, cell, base in cells[:2]:
        new = cell.measured(rng)
        of_both = watch(base, new)
        seen = watch(calibrate(declaring(base.dataset, earlier)), declaring(new, later))
        assert seen.verdict == "unchanged", seen.headline
        assert seen.expected_mm == pytest.approx(of_both.expected_mm, rel=0.1)
        assert seen.limit_mm == pytest.approx(of_both.limit_mm, rel=0.1)


@pytest.mark.parametrize("sigma_mm", [0.05, None])
def test_blunders_of_the_calibration_hide_no_change(cells: list[Drawn], sigma_mm: float | None) -> None:
    rng, cell, base = cells[2]
    measured, wrong = base.dataset.points, [np.flatnonzero(~base.dataset.poses.is_test)[k] for k in (9, 30)]
    assert measured is not None
    xyz_mm = measured.xyz_mm.copy()
    xyz_mm[wrong] += [[6.0, -8.0, 5.0], [0.0, 9.0, 0.0]]
    spoilt = declaring(base.dataset.with_points(replace(measured, xyz_mm=xyz_mm)), sigma_mm)
    slipped = declaring(cell.with_changes({"theta3": np.radians(0.03)}).measured(rng), sigma_mm)
    seen = watch(calibrate(spoilt), slipped)
    assert set(seen.left_out) == {base.dataset.poses.ids[k] for k in wrong}
    assert whats(seen) == ["joint_zero 3"]
    assert seen.limit_mm == pytest.approx(watch(base, slipped).limit_mm, rel=0.1)
    assert seen.left_out[0] in seen.summary()


def test_points_beyond_the_limit_are_never_unchanged(cells: list[Drawn]) -> None:
    rng, cell, base = cells[0]
    new = cell.measured(rng, 3)
    assert new.points is not None
    mirrored = new.with_points(replace(new.points, xyz_mm=new.points.xyz_mm * [1.0, 1.0, -1.0]))
    seen = watch(base, mirrored)  # metres off, by what no part does
    assert (seen.verdict, seen.changes) == ("unclear", ())
    assert seen.rmse_mm > 1000.0 * seen.limit_mm
    assert "no change that is tested explains it" in seen.headline


def test_poses_are_left_out_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(7)
    cell = Cell.drawn(rng)
    later = cell.measured(rng, 9, "later")
    assert later.points is not None
    xyz_mm = later.points.xyz_mm.copy()
    xyz_mm[4] += 3.0
    later = replace(later, poses=replace(later.poses, ids=tuple(f"c{k}" for k in range(9))))
    for dataset in (cell.measured(rng, 64, "base"), later.with_points(replace(later.points, xyz_mm=xyz_mm))):
        write_dataset(dataset, tmp_path / dataset.name)
    told = ["watch", str(tmp_path / "base"), str(tmp_path / "later")]
    assert main(told) == 1
    assert main([*told, "--leave-out", "c4", "--leave-out", "p003", "--json"]) == 0
    document = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (document["poses"], document["left_out"]) == (8, ["p003"])
    assert main([*told, "--leave-out", "c44"]) == 2
    assert "found no pose of this name in base and later" in capsys.readouterr().err
