"""The solver: exact for exact data, finite for bad data, independent of the scanner's pose."""

from __future__ import annotations

import csv
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calib.dataset.dataset import Dataset
from calib.effects.effect import Parameter
from calib.errors import FitError
from calib.fitting.distance_residuals import DistanceResiduals
from calib.fitting.fit import Fit
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.residual import Linearisation
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.trust_region import solve
from calib.kinematics.robot import Robot
from tests.support.arms import (
    PANDA_CASES,
    RB5_CASES,
    REFERENCE,
    dataset_of,
    elementary_points,
    jang_arm,
    park_arm,
    perturbed,
    random_arm,
    random_transform,
)

SEEDS = st.integers(0, 2**32 - 1)


def park_fit(robot: Robot, eliminated: str, seed: int) -> tuple[Robot, Robot, Fit]:
    """Nominal robot, true robot and fit in Park's set-up: exact positions at random poses in the base frame."""
    rng = np.random.default_rng(seed)
    true = perturbed(robot, rng)
    dataset = dataset_of(robot, true, rng)
    model = geometric_model(robot).with_fixed(eliminated.split())
    fit = solve(PositionResiduals(model, Observations.of(dataset), frame_known=True), prior=False)
    return true, model.calibrated_robot(fit.x), fit


@pytest.mark.parametrize(("arm", "eliminated"), [("rb5", c) for c in RB5_CASES] + [("panda", c) for c in PANDA_CASES])
@pytest.mark.parametrize("seed", range(3))
def test_parks_set_up_is_met_to_rounding_in_eight_iterations(arm: str, eliminated: str, seed: int) -> None:
    _, found, fit = park_fit(park_arm(arm), eliminated, seed)
    assert fit.converged
    assert len(fit.iterations) - 1 <= 8
    rmse_mm = 0.05 * np.sqrt(3 * fit.iterations[-1].cost / fit.rows)
    assert rmse_mm < 1e-12
    # And it is the arm, not only the poses that were seen.
    rng = np.random.default_rng(99)
    true = park_fit(park_arm(arm), eliminated, seed)[0]
    q = rng.uniform(-np.pi, np.pi, (20, found.n_joints))
    np.testing.assert_allclose(elementary_points(found, q), elementary_points(true, q), atol=1e-8)


def printed_sums(file: str) -> list[dict[str, str]]:
    """Rows of Park's Table 9 or 10, with EE renamed to TCP and "none" to an empty text."""
    with (REFERENCE / file).open() as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:
        row["eliminated"] = row["eliminated"].replace("EE", "TCP").replace("none", "")
    return rows


@pytest.mark.parametrize(
    ("arm", "cases", "file"),
    [
        ("rb5", RB5_CASES, "park_table9_rb5_d2d3d4.csv"),
        ("panda", PANDA_CASES, "park_table10_panda_theta1beta1.csv"),
    ],
)
def test_tables_9_and_10_to_the_last_digit(arm: str, cases: tuple[str, ...], file: str) -> None:
    """Errors of d2 and theta1 as in the paper are found in the parameter kept, or as the sum of several."""
    robot = park_arm(arm)
    table = robot.table
    if arm == "rb5":
        table[1, 2] += 0.51
    table[0, 3] += 0.00075
    dataset = dataset_of(robot, robot.with_table(table), np.random.default_rng(4))
    rows = printed_sums(file)
    assert {row["eliminated"] for row in rows} == set(cases)
    of = {"d2_mm": (1, 2), "d3_mm": (2, 2), "d4_mm": (3, 2), "theta1_rad": (0, 3), "beta1_rad": (0, 4)}
    for row in rows:
        model = geometric_model(robot).with_fixed(row["eliminated"].split())
        residuals = PositionResiduals(model, Observations.of(dataset), frame_known=True)
        found = model.calibrated_robot(solve(residuals, prior=False).x).table
        printed = {name: float(row[name]) for name in of if name in row}
        total = float(row["sum_mm" if arm == "rb5" else "sum_rad"])
        assert sum(found[of[name]] for name in printed) == pytest.approx(total, abs=1e-8)
        assert found[0, 3] + found[0, 4] == pytest.approx(0.00075, abs=1e-9)
        for name, value in printed.items() if row["eliminated"] else ():
            assert found[of[name]] == pytest.approx(value, abs=1e-8), (row["eliminated"], name)


@pytest.mark.parametrize("kind", ["position", "distance"])
@pytest.mark.parametrize("arm", ["rb5", "panda"])
@pytest.mark.parametrize("prior", [False, True])
def test_exact_data_from_an_unknown_place_are_met(kind: str, arm: str, prior: bool) -> None:
    rng = np.random.default_rng(11)
    robot = park_arm(arm)
    dataset = dataset_of(robot, perturbed(robot, rng), rng, base_T_scanner=random_transform(rng))
    fit = solve(make_residuals(kind, geometric_model(robot), Observations.of(dataset)), prior=prior)
    assert fit.converged
    assert 0.05 * np.sqrt(fit.iterations[-1].cost / fit.rows) < 1e-10
    assert fit.rank == {"rb5": 18, "panda": 22}[arm]


def shortened(dataset: Dataset, scanner_T_new: np.ndarray) -> Dataset:
    points = dataset.points
    moved = points.xyz_mm @ scanner_T_new[:3, :3].T + scanner_T_new[:3, 3]
    return dataset.with_points(type(points)(points.pose, moved, points.target))


@pytest.mark.slow
@settings(max_examples=10)
@given(SEEDS, st.sampled_from(["position", "distance"]))
def test_where_the_scanner_stands_changes_nothing(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    here = dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.05)
    there = shortened(here, random_transform(rng))
    fits = [solve(make_residuals(kind, geometric_model(robot), Observations.of(dataset))) for dataset in (here, there)]
    assert fits[1].iterations[0].cost == pytest.approx(fits[0].iterations[0].cost, rel=1e-8)
    assert fits[1].iterations[-1].cost == pytest.approx(fits[0].iterations[-1].cost, rel=1e-5)
    off = np.abs(fits[1].x - fits[0].x) / fits[0].sigma
    assert off.max() < 0.02  # both ended within a small part of a sigma of the one minimum


@pytest.mark.slow
@settings(max_examples=15)
@given(SEEDS, st.integers(4, 7))
def test_noise_and_a_missing_effect_do_not_make_it_diverge(seed: int, joints: int) -> None:
    """Unmodelled joint compliance, for which the plain pseudo-inverse diverges, still converges."""
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, joints)
    true = perturbed(robot, rng)
    dataset = dataset_of(robot, true, rng, noise_mm=0.05, test=20, poses=84)
    sag = 0.004 * np.sin(dataset.poses.q)
    points = elementary_points(true, dataset.poses.q + sag) + 0.05 * rng.normal(size=(84, 3))
    bent = dataset.with_points(type(dataset.points)(dataset.points.pose, points, dataset.points.target))
    for kind in ("position", "distance"):
        for prior in (True, False):
            fit = solve(make_residuals(kind, geometric_model(robot), Observations.of(bent)), prior=prior)
            costs = [i.cost for i in fit.iterations]
            assert np.all(np.isfinite(fit.x))
            assert costs[-1] < costs[0]
            if prior:
                assert np.abs(fit.x / [p.scale for p in fit.parameters]).max() < 100.0


@pytest.mark.parametrize("seed", [1, 6, 11])
@pytest.mark.parametrize("kind", ["position", "distance"])
def test_a_missing_effect_is_settled_in_few_steps_near_the_nominal_arm(kind: str, seed: int) -> None:
    """The residual is ten declared sigmas: with a prior weighed by the declared noise, corrections of ten and more
    tolerances would be tried, and a hundred steps would not suffice."""
    rng = np.random.default_rng(seed)
    robot = park_arm("panda")
    true = perturbed(robot, rng, mm=0.3, rad=0.002)
    dataset = dataset_of(robot, true, rng)
    sag = 0.01 * np.sin(dataset.poses.q)
    points = elementary_points(true, dataset.poses.q + sag) + 0.05 * rng.normal(size=(64, 3))
    bent = dataset.with_points(type(dataset.points)(dataset.points.pose, points, dataset.points.target))
    fit = solve(make_residuals(kind, geometric_model(robot), Observations.of(bent)))
    assert fit.converged
    assert len(fit.iterations) - 1 <= 12
    assert max(np.abs(i.x / [p.scale for p in fit.parameters]).max() for i in fit.iterations) < 10.0


@dataclass(frozen=True)
class Curved:
    """Problem r = (x - 0.01, k - c x^2 / 2) in each coordinate, where a full step leaves the share k c of the error."""

    c: NDArray[np.float64]
    k: float = 2.0
    degrees_spent = 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"x{i}", unit="1", scale=1.0) for i in range(len(self.c)))

    def residual(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([x - 0.01, self.k - self.c * x**2 / 2.0])

    def linearise(self, x: NDArray[np.float64]) -> Linearisation:
        return Linearisation(self.residual(x), np.vstack([np.eye(len(x)), np.diag(-self.c * x)]))


def test_steps_that_shrink_slowly_are_followed_to_their_limit() -> None:
    """Steps too short in one coordinate and too long in others converge fast; full steps alone need more than 40."""
    problem = Curved(np.array([0.47, -0.475, -0.2]))
    fit = solve(problem, prior=False)
    assert fit.converged
    assert len(fit.iterations) - 1 <= 15
    for c, x in zip(problem.c, fit.x, strict=True):
        # d/dx of (x - 0.01)^2 + (k - c x^2 / 2)^2, divided by 2
        roots = np.roots([c**2 / 2.0, 0.0, 1.0 - problem.k * c, -0.01])
        real = roots[np.abs(roots.imag) < 1e-9].real
        assert np.abs(real - x).min() < 1e-3


@pytest.mark.thorough
def test_estimates_lie_within_their_sigmas() -> None:
    """Normalised errors of non-redundant parameters over 40 arms have unit variance."""
    robot = park_arm("rb5")
    sure = ("a2", "a3", "theta3", "alpha3", "beta2")
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        true = perturbed(robot, rng, mm=0.3, rad=0.0005)
        dataset = dataset_of(robot, true, rng, noise_mm=0.05)
        fit = solve(PositionResiduals(geometric_model(robot), Observations.of(dataset)))
        truth = (true.table - robot.table).ravel()
        at = [robot.parameter_names.index(name) for name in sure]
        errors.append((fit.x[at] - truth[at]) / fit.sigma[at])
    assert 0.7 < float(np.mean(np.square(errors))) < 1.35


@pytest.mark.slow
def test_degrees_of_freedom_and_noise_are_right() -> None:
    robot = park_arm("rb5")
    noise = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        dataset = dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.1, sigma_mm=0.05)
        fit = solve(PositionResiduals(geometric_model(robot), Observations.of(dataset)))
        # 192 coordinates, 6 for the frame, 18 knowable directions and a few near-redundant ones
        assert 192 - 6 - 22 < fit.degrees_of_freedom < 192 - 6 - 16
        noise.append(fit.reduced_chi)
    assert np.mean(noise) == pytest.approx(2.0, rel=0.03)


def test_without_a_prior_what_nothing_bounds_has_no_sigma() -> None:
    rng = np.random.default_rng(0)
    robot = park_arm("rb5")
    dataset = dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.05)
    fit = solve(DistanceResiduals(geometric_model(robot), Observations.of(dataset)), prior=False)
    sigma = dict(zip(robot.parameter_names, fit.sigma, strict=True))
    assert np.isinf(sigma["d1"])
    assert np.isinf(sigma["theta1"])
    assert np.isfinite(sigma["a2"])


def test_bad_problems_are_one_clear_error() -> None:
    rng = np.random.default_rng(0)
    robot = park_arm("rb5")
    model = geometric_model(robot)
    dataset = dataset_of(robot, robot, rng)
    with pytest.raises(FitError, match="no parameter named 'a9'"):
        model.with_fixed(["a9"])
    with pytest.raises(FitError, match="no free parameter"):
        solve(PositionResiduals(model.with_fixed(robot.parameter_names), Observations.of(dataset)))
    points = dataset.points
    broken = dataset.with_points(type(points)(points.pose, points.xyz_mm * np.nan, points.target))
    with pytest.raises((FitError, ValueError, np.linalg.LinAlgError)):
        solve(PositionResiduals(model, Observations.of(broken)))
