"""The evidence of curves: its gradient, the two ways to work it out, and what it makes of noise and of a curve."""

from __future__ import annotations

import numpy as np
import pytest

from calib.array_types import Array
from calib.effects.effect import apply_values, moves_one_joint, state_derivative
from calib.fitting.model import effect_columns
from calib.fitting.observations import nominal_state
from calib.screening.curves.curve_evidence import CurveColumns, CurveEvidence, Spectrum
from calib.screening.curves.joint_curves import visible_modes
from calib.screening.curves.smooth_joint_error import (
    CurveModes,
    FormulaModes,
    FormulaTerm,
    SmoothJointError,
    harmonics,
)
from tests.support.fit_cases import rich_dataset

ORDERS = np.arange(1, 13)


def curve_columns(rows: int, rng: np.random.Generator, members: int = 2) -> CurveColumns:
    """Curves over uniform angles; each member moves the residual by a factor of its own a row."""
    blocks = [rng.normal(size=(rows, 1)) * harmonics(rng.uniform(-2.0, 2.0, rows), ORDERS) for _ in range(members)]
    width = 2 * len(ORDERS)
    return CurveColumns(
        np.concatenate(blocks, axis=1),
        np.repeat(np.arange(members), width),
        np.tile(np.repeat(ORDERS, 2), members),
        np.repeat(np.arange(members) == 0, width),  # the second has a spectrum of its own
    )


def brute_force(curve: CurveColumns, residual: Array, freedom: int, sigma: Array) -> float:
    """log E as its definition has it."""
    covariance = np.eye(len(residual)) + (curve.columns * sigma**2) @ curve.columns.T
    quadratic = residual @ np.linalg.solve(covariance, residual)
    fit = -0.5 * freedom * np.log(quadratic / (residual @ residual))
    return float(fit - 0.5 * np.linalg.slogdet(covariance)[1])


@pytest.mark.parametrize("rows", [20, 400], ids=["fewer rows than columns", "more rows than columns"])
def test_both_ways_are_the_definition_and_the_gradient_is_its_derivative(rows: int) -> None:
    rng = np.random.default_rng(3)
    curve, residual = curve_columns(rows, rng), rng.normal(size=rows)
    evidence = CurveEvidence(curve, residual, rows - 3)
    assert evidence.few_rows == (rows == 20)
    logs = np.log([0.3, 0.7, 4.0, 1.5])
    sigma, _ = evidence.prior_sigma(Spectrum(logs))
    assert evidence.at(Spectrum(logs)).log_evidence == pytest.approx(
        brute_force(curve, residual, rows - 3, sigma), rel=1e-9
    )
    _, gradient = evidence._falling(logs)
    for k in range(len(logs)):
        step = 1e-5 * (np.arange(len(logs)) == k)
        high, low = (evidence._falling(logs + sign * step)[0] for sign in (1.0, -1.0))
        assert gradient[k] == pytest.approx((high - low) / 2e-5, rel=1e-4, abs=1e-5)


def test_what_a_further_block_adds_is_the_difference_of_two_evidences() -> None:
    rng = np.random.default_rng(4)
    curve, residual = curve_columns(120, rng), rng.normal(size=120)
    evidence = CurveEvidence(curve, residual, 110)
    at = Spectrum(np.log([0.3, 0.2, 4.0, 1.5]))
    block = curve_columns(120, rng, members=1)
    block = CurveColumns(block.columns, block.member, block.order, np.zeros(len(block.order), dtype=bool))
    ((gain, log_size),) = evidence.gains(at, [block])
    both = CurveEvidence(curve.joined(block), residual, 110)
    together = both.at(Spectrum(np.concatenate([at.logs[:-2], [log_size], at.logs[-2:]]))).log_evidence
    assert gain == pytest.approx(together - evidence.at(at).log_evidence, abs=1e-6)


def test_noise_has_no_evidence_and_a_curve_has() -> None:
    rng = np.random.default_rng(5)
    curve = curve_columns(300, rng)
    noise = rng.normal(size=300)
    assert CurveEvidence(curve, noise, 290).best()[0] < 5.0
    of_first = curve.columns[:, :4] @ rng.normal(size=4)
    assert CurveEvidence(curve, noise + of_first, 290).best()[0] > 50.0


def test_a_curve_is_bounded_where_nothing_was_measured() -> None:
    modes = CurveModes("temperature_c", np.arange(1, 4), np.eye(6), 10.0, 0.1, 10.0, 30.0)
    inside, outside = modes.at(np.array([10.0, 30.0])), modes.at(np.array([-500.0, 900.0]))
    np.testing.assert_array_equal(inside, outside)


@pytest.mark.parametrize(
    "modes",
    [
        CurveModes("q2", np.arange(1, 4), np.random.default_rng(0).normal(size=(6, 2))),
        FormulaModes("q2", (FormulaTerm("harmonic", order=5),)),
        FormulaModes("q1+q2", (FormulaTerm("bump", place=0.1, width=0.2), FormulaTerm("kink", place=-0.3))),
        FormulaModes("q2", (FormulaTerm("step", place=0.1), FormulaTerm("square"))),
    ],
)
def test_an_effect_of_curves_is_linear_and_absent_at_zero(modes: CurveModes | FormulaModes) -> None:
    state = nominal_state(rich_dataset())
    count = modes.at(np.zeros(1)).shape[1]
    effect = SmoothJointError(1, modes, (1e-3,) * count)
    assert len({p.name for p in effect.parameters}) == count
    values = np.random.default_rng(1).normal(size=count) * 1e-3
    zero = apply_values(effect, state, np.zeros(count)).vector
    np.testing.assert_array_equal(np.broadcast_to(state.vector, zero.shape), zero)
    once, twice = (apply_values(effect, state, k * values).vector - state.vector for k in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-15)
    assert moves_one_joint(effect)  # its derivative at once is that of its parameters one by one
    columns = effect_columns(np.eye(state.vector.shape[1])[None], effect, state, values)
    for k, derivative in enumerate(state_derivative(effect, state, values)):
        np.testing.assert_allclose(columns[..., k], derivative, rtol=1e-9, atol=1e-12)


def test_what_a_curve_does_between_the_poses_it_was_learned_from_is_as_uncertain_as_its_prior() -> None:
    state = nominal_state(rich_dataset())
    q_rad = state.q_rad[:, 1]
    known = q_rad < np.median(q_rad)
    spread = np.full(2 * len(ORDERS), 1e-4)
    waves = harmonics(q_rad[known], ORDERS)
    weights, sizes = visible_modes(waves * spread, spread, 1e3 * waves, 1e-3)
    whole = float(np.sqrt(0.5 * np.sum(spread**2)))
    effect = SmoothJointError(1, CurveModes("q2", ORDERS, weights, whole_rad=whole), sizes)
    unseen = effect.unseen_variance(state) / whole**2
    assert unseen[known].max() < 0.05
    assert np.median(unseen[~known]) > 0.3


def test_faint_harmonics_are_taken_to_first_order() -> None:
    """A steep spectrum leaves most harmonics below what noise moves; the evidence is the definition's all the same."""
    rng = np.random.default_rng(4)
    curve, residual = curve_columns(400, rng), rng.normal(size=400)
    evidence = CurveEvidence(curve, residual, 397)
    for logs in (np.log([0.3, 1e-9, 0.8, 4.0]), np.log([1e-12, 1e-12, 4.0, 2.0])):
        sigma, _ = evidence.prior_sigma(Spectrum(logs))
        exact = brute_force(curve, residual, 397, sigma)
        assert evidence.at(Spectrum(logs)).log_evidence == pytest.approx(exact, abs=1e-3)
