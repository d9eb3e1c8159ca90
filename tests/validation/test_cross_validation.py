"""Cross-validation, the learning curve and the residual sigma: nothing leaks, and the words follow the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import calibrate, cross_validate, frames, learning_curve
from calib.calibration.noise_level import SigmaCheck, check_sigma
from calib.dataset.dataset import Dataset, Points, Scanner
from calib.dataset.files.folder import write_dataset
from calib.errors import FitError
from calib.options import FitOptions
from calib.present.fit.errors import sigma_sentence
from calib.validation.cross_validation import LearningCurve, LearningStep, deal_folds, growing_order, training_groups
from tests.support.arms import dataset_of, elementary_points, jang_arm, perturbed, random_transform
from tests.support.changed import with_poses, with_xyz
from tests.support.commands import answered, refused


def simulated(seed: int = 0, **more: object) -> Dataset:
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    options: dict = {"poses": 64, "test": 0, "noise_mm": 0.02, "sigma_mm": 0.02} | more
    return dataset_of(robot, perturbed(robot, rng), rng, base_T_scanner=random_transform(rng), **options)


def in_setups(dataset: Dataset, setup: np.ndarray) -> Dataset:
    """The same measurements, each setup in a scanner frame of its own."""
    rng = np.random.default_rng(0)
    xyz = dataset.points.xyz_mm.copy()
    for name in np.unique(setup):
        xyz[setup == name] = frames.apply(random_transform(rng), xyz[setup == name])
    moved = with_poses(dataset, setup=setup)
    return moved.with_points(Points(dataset.points.pose, xyz, dataset.points.target))


def bent(dataset: Dataset) -> Dataset:
    """Physics that no five-parameter model has: waves along the joints' angles."""
    q = dataset.poses.q
    waves = 0.5 * np.stack([np.sin(3 * q[:, 1]), np.cos(4 * q[:, 2]), np.sin(3 * q[:, 3])], axis=-1)
    points = dataset.points
    return dataset.with_points(Points(points.pose, points.xyz_mm + waves[points.pose], points.target))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    sizes=st.lists(st.integers(1, 25), min_size=1, max_size=4),
    folds=st.integers(2, 8),
    repeats=st.integers(1, 3),
    seed=st.integers(0, 99),
)
def test_folds_hold_out_each_place_once_and_leave_every_setup_its_frame(
    sizes: list[int], folds: int, repeats: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    n = sum(sizes)
    dataset = dataset_of(jang_arm(), jang_arm(), rng, poses=n * repeats)
    q = np.repeat(dataset.poses.q[:n], repeats, axis=0)  # other ids, the same joints
    setup = np.repeat([f"s{k}" for k, size in enumerate(sizes) for _ in range(size)], repeats)
    dataset = with_poses(dataset, q=q, setup=setup)
    groups = training_groups(dataset)
    assert len(groups) == n
    dealt, small = deal_folds(groups, folds, rng)
    held = np.concatenate(dealt)
    assert len(held) == len(set(held.tolist()))
    assert set(held.tolist()) == set(np.flatnonzero(~np.isin(groups.setup, small)).tolist())
    assert max(map(len, dealt)) - min(map(len, dealt)) <= 1
    for fold in dealt:
        poses = groups.poses_of(fold)
        assert len(poses) == repeats * len(fold)
        outside = np.setdiff1d(np.arange(n * repeats), poses)
        assert not set(map(bytes, q[poses])) & set(map(bytes, q[outside]))  # no place on both sides
        for name in np.unique(setup[poses]):
            assert len(np.unique(q[outside][setup[outside] == name], axis=0)) >= 3
    order = growing_order(groups, np.arange(n), rng)
    assert sorted(order.tolist()) == list(range(n))
    start = groups.setup[order[: 3 * len(sizes)]]
    assert all(np.sum(start == f"s{k}") >= min(size, 3) for k, size in enumerate(sizes))


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["position", "distance"])
def test_held_out_poses_have_no_say_in_their_own_fold(residual: str) -> None:
    """Moving one measurement by 3 mm shows in its own held-out error in full; leaked, the fit would bend to it."""
    dataset = simulated()
    xyz = dataset.points.xyz_mm.copy()
    xyz[20] += [3.0, 0.0, 0.0]
    clean = cross_validate(dataset, FitOptions(residual))
    moved = cross_validate(with_xyz(dataset, xyz), FitOptions(residual))

    def error(result: object) -> np.ndarray:
        after = result.after  # type: ignore[attr-defined]
        return after.error_mm[after.pose == 20][0]

    np.testing.assert_allclose(error(clean) - error(moved), [3.0, 0.0, 0.0], atol=1e-9)


def test_figures_are_those_of_fits_made_by_hand() -> None:
    dataset = simulated(test=10)
    result = cross_validate(dataset, folds=4)
    frame = result.to_frame()
    assert sorted(frame["pose"]) == sorted(dataset.poses.ids[:54])  # every training pose once, no test pose
    errors = {}
    for fold in result.folds:
        role = dataset.poses.role.copy()
        held = np.isin(dataset.poses.ids, fold.poses)
        keep = ~dataset.poses.is_test[dataset.points.pose]
        role[held] = "test"
        by_hand = calibrate(with_poses(dataset, role=role).with_points(dataset.points.select(keep)))
        assert fold.held_out.rmse_mm == pytest.approx(by_hand.after.test.rmse_mm, rel=1e-6)
        table = by_hand.after.to_frame(dataset)
        errors |= {p: e for p, e in zip(table["pose"], table["error_mm"], strict=True) if p in fold.poses}
    np.testing.assert_allclose(frame["error_mm"], [errors[p] for p in frame["pose"]], rtol=1e-5)
    assert result.held_out.rmse_mm == pytest.approx(np.sqrt(np.mean(np.square(list(errors.values())))), rel=1e-6)
    assert result.held_out.points == 54
    assert (frame["nominal_mm"] > frame["error_mm"]).mean() > 0.9


def test_test_poses_are_never_used() -> None:
    dataset = simulated(test=13)
    shift = np.where(dataset.poses.is_test[dataset.points.pose], 50.0, 0.0)[:, None]
    other = with_xyz(dataset, dataset.points.xyz_mm + shift)
    assert cross_validate(other).summary() == cross_validate(dataset).summary()


@pytest.mark.slow
def test_setups_and_several_points_a_pose() -> None:
    dataset = simulated(poses=80)
    setup = np.repeat(["left", "middle", "right", "tiny"], [30, 30, 17, 3])
    dataset = in_setups(dataset, setup)
    result = cross_validate(dataset)
    assert result.held_out.rmse_mm < 0.06
    assert any("'tiny' has too few poses" in note for note in result.notes)
    assert set(result.to_frame()["setup"]) == {"left", "middle", "right"}
    points, rng = dataset.points, np.random.default_rng(3)
    twice = Points(
        np.tile(points.pose, 2),
        np.vstack([points.xyz_mm, points.xyz_mm + 0.02 * rng.normal(size=(80, 3))]),
        np.tile(points.target, 2),
    )
    repeated = cross_validate(dataset.with_points(twice))
    assert repeated.held_out.points == 2 * 77
    assert set(repeated.to_frame()["points"]) == {2}


@pytest.mark.slow
def test_noise_alone_and_missing_physics_are_told_apart() -> None:
    good, bad = simulated(), bent(simulated())
    result = cross_validate(good)
    assert result.ratio == pytest.approx(result.expected_ratio, rel=0.15)
    assert result.sigma.verdict == "as declared"
    assert "does not bend to its own poses; expect" in result.headline
    worse = cross_validate(bad)
    assert worse.sigma.verdict == "excess"
    assert worse.held_out.rmse_mm > 5 * result.held_out.rmse_mm
    assert "physics is missing" in worse.summary()
    curve = learning_curve(simulated(poses=150), counts=[20, 60, 120], repeats=3)
    assert curve.flat_since is not None
    assert "none are needed" in curve.headline
    flat = learning_curve(bent(simulated(poses=240, test=60)), counts=[60, 120, 180], repeats=2)
    assert flat.held_out == "test poses"
    assert flat.flat_since is not None
    assert "more poses will not help" in flat.headline
    assert "physics is missing" in flat.headline
    short = learning_curve(simulated(test=0), counts=[11, 13, 15])
    assert short.flat_since is None
    assert "More poses would still help" in short.headline


def test_test_poses_of_another_kind_are_told() -> None:
    """Training in a corner of the joints' range cannot settle what the far test poses need; folds do not see it."""
    dataset = simulated(test=14)
    near = replace(dataset.poses, q=np.where(dataset.poses.is_test[:, None], 1.0, 0.15) * dataset.poses.q)
    rng = np.random.default_rng(2)
    true = perturbed(dataset.robot, np.random.default_rng(1))
    xyz = elementary_points(true, near.q) + 0.02 * rng.normal(size=(64, 3))
    narrow = replace(dataset, poses=near).with_points(replace(dataset.points, xyz_mm=xyz))
    assert cross_validate(narrow).ratio < 1.6
    curve = learning_curve(narrow, counts=[25, 50], repeats=1)
    assert "such poses are not among the training poses" in curve.headline
    assert "such poses" not in learning_curve(dataset, counts=[25, 50], repeats=1).headline


def curve_of(errors_mm: dict[int, float], sigma: SigmaCheck) -> LearningCurve:
    steps = tuple(LearningStep(n, 5, 0.5 * e, e, 0.0, 0.1, 50.0) for n, e in errors_mm.items())
    return LearningCurve(simulated(), "position", "folds", steps, sigma, ())


def test_the_extrapolation_by_hand() -> None:
    """On an exact A + B / n the doubled error is exact, whatever the sigma says."""
    floor, slope = 0.01, 2.0
    unknown = SigmaCheck(0.1, 0.09, 0.11, None, 100.0)
    curve = curve_of({n: float(np.sqrt(floor + slope / n)) for n in (20, 30, 40, 50)}, unknown)
    assert curve.doubled_rmse_mm == pytest.approx(np.sqrt(floor + slope / 100))
    assert curve.gain == pytest.approx(1 - np.sqrt((floor + slope / 100) / (floor + slope / 50)))
    assert "still help" in curve.headline
    flat = curve_of({10: 0.5, 20: 0.301, 30: 0.3, 40: 0.302, 50: 0.3}, unknown)
    assert flat.flat_since == 20
    assert "does not show whether" in flat.headline
    rising = curve_of({20: 0.3, 30: 0.31, 40: 0.33}, unknown)
    assert rising.gain == pytest.approx(0.0)


@pytest.mark.thorough
def test_the_interval_of_sigma_covers_the_truth() -> None:
    """95 % of intervals hold the true sigma; here 60 fits of 16 poses, so 50 at least."""
    covered = 0
    for seed in range(60):
        check = check_sigma(calibrate(simulated(seed, poses=16)))
        covered += check.low_mm < 0.02 < check.high_mm
    assert covered >= 50


def test_sigma_verdicts_and_none_declared() -> None:
    dataset = simulated()
    for declared, verdict in ((0.02, "as declared"), (0.005, "excess"), (0.2, "below"), (None, "unknown")):
        check = check_sigma(calibrate(replace(dataset, scanner=Scanner(declared))))
        assert check.verdict == verdict
        assert check.sigma_mm == pytest.approx(0.02, rel=0.2)
        assert ("times the declared" in sigma_sentence(check)) == (declared is not None)


@pytest.mark.slow
def test_the_same_deal_every_time_and_another_by_rng() -> None:
    dataset = simulated()
    seen: list[tuple[int, int, str]] = []
    first = cross_validate(dataset, on_progress=lambda *step: seen.append(step))
    assert seen[-1][:2] == (5, 5)
    assert cross_validate(dataset).summary() == first.summary()
    other = cross_validate(dataset, rng=np.random.default_rng(5))
    assert other.folds[0].poses != first.folds[0].poses


def test_what_cannot_be_done_is_one_line() -> None:
    dataset = simulated()
    for folds, says in ((1, "needs 2 at least"), (65, "65 folds for 64 different training poses")):
        with pytest.raises(FitError, match=says):
            cross_validate(dataset, folds=folds)
    with pytest.raises(FitError, match="training poses give"):
        cross_validate(simulated(poses=9, noise_mm=0.1))
    with pytest.raises(FitError, match="no measured points"):
        cross_validate(replace(dataset, points=None))
    with pytest.raises(FitError, match=r"the fewest that carry a fit, and the 7 there are"):
        learning_curve(simulated(poses=9))
    for counts in ([4, 30], [30], [30, 500]):
        with pytest.raises(FitError, match="two counts or more between 11 poses"):
            learning_curve(dataset, counts=counts)
    with pytest.raises(FitError, match="0 repeats"):
        learning_curve(dataset, repeats=0)
    with pytest.raises(FitError, match="cannot fill 2 folds"):
        cross_validate(simulated(poses=4), folds=2)
    with pytest.raises(FitError, match="too few to hold some out"):
        learning_curve(simulated(poses=3))


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    write_dataset(simulated(test=13), tmp_path / "cell")
    document = answered("validate", tmp_path / "cell", "--folds", "4", "--residual", "distance")
    assert document["residual"] == "distance"
    assert len(document["folds"]) == 4
    assert len(document["poses"]) == 51
    assert document["held_out"]["rmse_mm"] < 0.2 < document["before"]["rmse_mm"]
    assert document["sigma"]["low_mm"] < document["sigma"]["sigma_mm"] < document["sigma"]["high_mm"]
    assert document["learning_curve"]["held_out"] == "test poses"
    assert document["learning_curve"]["steps"][-1]["poses"] == 51
    assert "99 folds for 51 different training poses" in refused("validate", tmp_path / "cell", "--folds", "99")
