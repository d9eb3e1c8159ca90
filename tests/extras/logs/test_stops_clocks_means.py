"""Standing phases, offsets of clocks and means over a simulated run, whose truth a kinematics of its own made."""

from __future__ import annotations

import numpy as np
import pytest

from calib.extras.logs.clocks import offset_of_single_points, possible_offsets
from calib.extras.logs.means import means_of
from calib.extras.logs.series import RecordingError, in_order, lost_rows
from calib.extras.logs.standstill import approach_of, standstill_of
from tests.support.recorded_run import recorded_run, tool_mm

RUNS = {
    "50 Hz": {},
    "10 Hz": {"joint_hz": 10.0},
    "500 Hz": {"joint_hz": 500.0, "point_hz": 250.0},
    "noise of 1 mrad": {"joint_sigma_rad": 1e-3},
    "points at 10 Hz": {"point_hz": 10.0},
}


@pytest.mark.parametrize("digits", [9, 3])  # rounded to 1 mrad, 50 times the noise
@pytest.mark.parametrize("name", RUNS)
def test_every_stop_is_found_and_the_clock_to_a_millisecond(name: str, digits: int) -> None:
    run = recorded_run(np.random.default_rng(2), 24, **RUNS[name])
    q = np.round(run.q, digits)
    rest = standstill_of("run", run.joint_s, q)
    assert len(rest.phases) == 24
    means = np.array([q[phase].mean(axis=0) for phase in rest.phases])
    assert np.abs(means - run.stops_q).max() < (1e-3 if digits == 3 or "mrad" in name else 5e-5)
    path_mm = tool_mm(q, (0.0,) * 6)
    ((offset_s, correlation),) = possible_offsets(run.joint_s, path_mm, run.point_s, run.xyz_mm)
    assert abs(offset_s - run.offset_s) < 1e-3
    assert correlation > 0.95


@pytest.mark.parametrize(("noise_rad", "creep_deg", "stands_s"), [(1e-5, 0.2, 1.6), (1e-4, 0.0, 1.6), (2e-5, 0.2, 0.9)])
@pytest.mark.parametrize("move_s", [0.1, 1.4])
@pytest.mark.parametrize("step_deg", [0.1, 0.3])
def test_a_small_move_parts_stops_and_a_creep_before_one_costs_none(
    step_deg: float, move_s: float, noise_rad: float, creep_deg: float, stands_s: float
) -> None:
    rng = np.random.default_rng(0)
    stops = np.repeat(rng.uniform(-1.2, 1.2, (8, 6)), 2, axis=0)
    stops[1::2, 2] += np.radians(step_deg)
    rows = []
    for k, (here, there) in enumerate(zip(stops, [*stops[1:], stops[-1]], strict=True)):
        way = np.linspace(0.0, 1.0, round(50 * (1.4 if k % 2 else move_s)))[:, None]
        creep = np.radians(creep_deg) * np.exp(-np.arange(50 * stands_s) / 15.0)[:, None] * np.eye(6)[0]
        rows += [here + creep * (k % 2 == 0), here + (3.0 * way**2 - 2.0 * way**3) * (there - here)]
    q = np.vstack(rows)
    q += rng.normal(0.0, noise_rad, q.shape)
    rest = standstill_of("log", np.arange(len(q)) * 0.02, q)
    means = np.array([q[phase].mean(axis=0) for phase in rest.phases])
    assert len(means) == len(stops)
    assert np.degrees(np.abs(means - stops).max()) < (0.04 if stands_s < 1.0 else 0.01)


def test_single_points_are_laid_into_the_stops() -> None:
    rng = np.random.default_rng(0)
    starts = np.cumsum(rng.uniform(3.0, 9.0, 20))
    ends = starts + rng.uniform(1.0, 2.0, 20)
    taken = rng.uniform(starts + 0.1, ends - 0.1)
    assert offset_of_single_points(("j", "p"), starts, ends, taken) == 0.0
    at = taken + 777.7 - offset_of_single_points(("j", "p"), starts, ends, taken + 777.7)
    assert ((starts < at) & (at < ends)).all()
    regular = np.arange(20) * 5.0
    with pytest.raises(RecordingError, match="is ambiguous"):
        offset_of_single_points(("j", "p"), regular, regular + 1.0, regular[:16] + 100.5)
    with pytest.raises(RecordingError, match="at most"):
        offset_of_single_points(("j", "p"), starts, ends, np.cumsum(rng.uniform(3.0, 9.0, 20)) * 1.7)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_sigma_of_a_mean_is_that_of_correlated_noise(rho: float) -> None:
    """Against the scatter of the means themselves; (1 + rho) / (1 - rho) is the exact time of such noise."""
    rng = np.random.default_rng(1)
    noise = np.zeros((60, 200, 3))
    fresh = rng.normal(0.0, np.sqrt(1.0 - rho**2), noise.shape)
    noise[:, 0] = rng.normal(0.0, 1.0, (60, 3))
    for i in range(1, 200):
        noise[:, i] = rho * noise[:, i - 1] + fresh[:, i]
    found = means_of(list(noise))
    assert found.tau == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.2)
    assert float(found.sigma.mean()) == pytest.approx(float(found.mean.std()), rel=0.2)
    assert found.scatter == pytest.approx(1.0, rel=0.1)


def test_outlying_samples_and_empty_phases_do_no_harm() -> None:
    rng = np.random.default_rng(0)
    samples = [rng.normal(0.0, 0.01, (50, 3)) for _ in range(4)]
    samples[1][7] = 5.0
    found = means_of([*samples, np.zeros((0, 3))])
    assert found.counts.tolist() == [50, 49, 50, 50, 0]
    assert np.abs(found.mean[:4]).max() < 0.01
    assert np.isnan(found.mean[4]).all()
    assert np.isnan(found.sigma[4])


def test_the_side_is_that_of_the_last_motion() -> None:
    path = np.concatenate([np.linspace(0.0, 1.0, 50), np.full(20, 1.0), np.linspace(1.0, 0.5, 50), np.full(20, 0.5)])
    values = np.column_stack([path, np.where(np.arange(140) < 30, -1.0, 0.0), np.full(140, 0.2)])
    side = approach_of(values, 122, values[130], 1e-3)
    assert side.tolist() == [-1.0, 1.0, 0.0]


def test_rows_come_in_order_of_time_once() -> None:
    time_s, values = in_order(np.array([3.0, 1.0, np.nan, 3.0, 2.0]), np.arange(5.0))
    assert time_s.tolist() == [1.0, 2.0, 3.0]
    assert values.tolist() == [1.0, 4.0, 0.0]


def test_zeros_and_held_values_of_a_lost_target_are_no_points() -> None:
    xyz = np.random.default_rng(0).normal(0.0, 1.0, (100, 3))
    lost = np.zeros(100, dtype=bool)
    xyz[10:20], xyz[41:60] = 0.0, xyz[40]
    lost[10:20] = lost[41:60] = True
    assert lost_rows(xyz).tolist() == lost.tolist()
    assert not lost_rows(np.repeat(np.delete(xyz, np.flatnonzero(lost), axis=0), 10, axis=0)).any()  # a faster log
