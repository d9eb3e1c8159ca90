"""What a curve looks like: a slope, a wave, a bump, several waves, or rough; and the sweep that shows it."""

from __future__ import annotations

import numpy as np
import pytest

from calib.array_types import Array
from calib.present.fit.learned import part_words, reading_phrase, readings_document, sweep_sentence
from calib.screening.curves.readings import BUMP, ROUGH, SLOPE, WAVE, WAVES, CurveReading, Sweep, shape_of

U = np.linspace(np.radians(-150.0), np.radians(140.0), 801)


@pytest.mark.parametrize(
    ("value", "kind", "orders"),
    [
        (0.3 * U + 0.02 * np.sin(9 * U), SLOPE, ()),
        (np.sin(9 * U + 0.4) + 0.3 * np.cos(20 * U) + 5.0, WAVE, (9,)),
        (np.sin(120 * U + 0.4), WAVE, (120,)),
        (np.exp(-0.5 * ((U - np.radians(40.0)) / np.radians(8.0)) ** 2), BUMP, ()),
        (np.sin(7 * U) + 0.9 * np.cos(19 * U) + 0.8 * np.sin(31 * U), WAVES, (7, 19)),
    ],
)
def test_a_simple_shape_is_read(value: Array, kind: str, orders: tuple[int, ...]) -> None:
    found, share, waves, place = shape_of(U, value, 130)
    assert (found, waves) == (kind, orders)
    assert share > 0.6
    assert (place is not None) == (kind == BUMP)
    if place is not None:
        assert np.degrees(place) == pytest.approx(40.0, abs=8.0)


def test_many_waves_are_rough_with_the_strongest_named() -> None:
    rng = np.random.default_rng(1)
    value = sum(np.sin(n * U + rng.uniform(0.0, 6.0)) for n in range(3, 40)) + 1.6 * np.sin(24 * U)
    kind, share, waves, _ = shape_of(U, np.asarray(value))
    assert kind == ROUGH
    assert share < 0.6
    assert len(waves) == 3


def test_over_a_narrow_range_the_slowest_wave_that_fits_counts() -> None:
    u = np.linspace(0.0, np.radians(30.0), 801)
    assert shape_of(u, np.sin(5 * u))[2][:1] <= (5,)


def test_it_is_told_with_the_part_and_the_sweep() -> None:
    sweep = Sweep(3, -120.0, 130.0, 5.0)
    one = CurveReading(3, "q3", WAVE, 0.71, (9,), None, 1e-4, None, sweep)
    assert reading_phrase(one) == "joint 3 has a wave of 9 a turn (71 % of its square)"
    assert "bearing" in part_words(one)
    assert sweep.poses == 51
    assert "joint 3 from −120° to 130° in steps of 5° (51 poses)" in sweep_sentence([one])
    geared = CurveReading(3, "q3", WAVE, 0.71, (202,), None, 1e-4, 2, sweep)
    assert "twice a turn of the motor" in part_words(geared)
    assert readings_document([one])[0]["waves_per_turn"] == (9,)
