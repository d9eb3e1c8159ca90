"""The evidence of a family of columns: laws that hold for any residual."""

from __future__ import annotations

import numpy as np
import pytest

from calib.screening.evidence import FamilyColumns, evaluate_family, holm


def test_evidence_and_gate_are_blind_to_the_noises_size_and_order() -> None:
    rng = np.random.default_rng(0)
    columns = tuple(rng.normal(size=(100, 2)) for _ in range(4))
    residual = rng.normal(size=100) + columns[2] @ [0.8, -0.5]
    one = evaluate_family(FamilyColumns(residual, columns, 100))
    scaled = evaluate_family(FamilyColumns(7.0 * residual, tuple(7.0 * c for c in columns), 100))
    turned = evaluate_family(FamilyColumns(residual, columns[::-1], 100))
    assert one.p_value < 1e-6
    assert scaled.p_value == pytest.approx(one.p_value)
    assert scaled.log_evidence == pytest.approx(one.log_evidence, abs=0.1)  # sizes come from a grid
    assert turned.log_evidence == pytest.approx(one.log_evidence)
    assert np.flatnonzero(one.scales).tolist() == [2]
    np.testing.assert_allclose(one.coefficients[2], [0.8, -0.5], atol=0.35)


def test_a_member_that_stood_in_for_two_gives_way_to_them() -> None:
    """The sum of two members looks most like a third, which alone is chosen first and beside both says nothing."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        one, two, third = np.sqrt(120.0) * np.linalg.qr(rng.normal(size=(120, 3)))[0].T
        mixed = one + two + 0.5 * third
        residual = 3.0 * one + 3.0 * two + rng.normal(size=120)
        columns = tuple(column[:, None] for column in (*rng.normal(size=(20, 120)), mixed, one, two))
        alone = [evaluate_family(FamilyColumns(residual, (column,), 120)).log_evidence for column in columns]
        assert int(np.argmax(alone)) == 20
        assert np.flatnonzero(evaluate_family(FamilyColumns(residual, columns, 120)).scales).tolist() == [21, 22]


@pytest.mark.slow
def test_p_values_of_pure_noise_are_uniform_or_larger() -> None:
    rng = np.random.default_rng(1)
    columns = tuple(rng.normal(size=(60, 2)) for _ in range(5))
    p = np.array([evaluate_family(FamilyColumns(rng.normal(size=60), columns, 60)).p_value for _ in range(400)])
    assert np.mean(p < 0.05) < 0.08
    assert np.mean(p < 0.01) < 0.03


def test_a_size_far_above_the_usual_one_costs_as_the_prior_says() -> None:
    rng = np.random.default_rng(2)
    column = rng.normal(size=(200, 1))
    residual = rng.normal(size=200) + column @ [1.0]  # as large as usual
    usual = evaluate_family(FamilyColumns(residual, (column,), 200))
    thousand = evaluate_family(
        FamilyColumns(residual, (1e-3 * column,), 200)
    )  # the same signal, of a thousand times the usual size
    # 1/2 (log10 1000)^2 = 4.5 for the size that suits the data best; the shift of that size gains a little back.
    assert 3.0 < usual.log_evidence - thousand.log_evidence < 5.0
    assert thousand.coefficients[0] * 1e-3 == pytest.approx(usual.coefficients[0], rel=0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_coefficient_of_natures_sign_gains_and_the_other_loses_at_most_so_much(sign: float) -> None:
    rng = np.random.default_rng(3)
    columns = tuple(rng.normal(size=(120, 1)) for _ in range(3))
    residual = rng.normal(size=120) + sign * sum(c[:, 0] for c in columns)
    free = evaluate_family(FamilyColumns(residual, columns, 120))
    bound = evaluate_family(FamilyColumns(residual, columns, 120, positive=(True, True, True)))
    gain = bound.log_evidence - free.log_evidence
    # All three clearly of one sign: 2^3 times as likely, believed to 0.9; or a tenth of the belief is left.
    assert gain == pytest.approx(np.log(0.9 * 8.0 + 0.1) if sign > 0 else np.log(0.1), abs=0.02)
    np.testing.assert_allclose(bound.coefficients, free.coefficients)


def test_signs_say_nothing_about_columns_that_do_not_show() -> None:
    rng = np.random.default_rng(4)
    shown, hidden = rng.normal(size=(80, 1)), np.zeros((80, 1))
    residual = rng.normal(size=80) + shown[:, 0]
    alone = evaluate_family(FamilyColumns(residual, (shown,), 80, positive=(True,)))
    beside = evaluate_family(FamilyColumns(residual, (np.column_stack([shown, hidden]),), 80, positive=(True,)))
    assert beside.log_evidence == pytest.approx(alone.log_evidence)


def test_holm_is_the_textbooks() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
