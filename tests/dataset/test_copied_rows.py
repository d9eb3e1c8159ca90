"""Rows copied under other pose ids are no repeats: each point counts once, and the verdict stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.dataset import Dataset, Points
from calib.dataset.repeats import average_repeats, find_repeats, pooled_sigma_mm
from calib.simulation.simulate import simulate_dataset

REPEATED, COPIED = 10, 40


def with_rows(dataset: Dataset, poses: np.ndarray, xyz_mm: np.ndarray, prefix: str) -> Dataset:
    """The dataset with some training poses added again under other names, with the given points."""
    given, points = dataset.poses, dataset.points
    rows = np.concatenate([np.arange(len(given)), poses])
    role = given.role[rows]
    role[len(given) :] = "train"
    more = replace(
        given,
        ids=(*given.ids, *(f"{prefix}{given.ids[i]}" for i in poses)),
        role=role,
        q=given.q[rows],
        setup=given.setup[rows],
        scan_names=tuple(given.scan_names[i] for i in rows),
        **{
            name: values[rows]
            for name in ("payload_kg", "temperature_c", "time_s", "approach")
            if (values := getattr(given, name)) is not None
        },
    )
    new = Points(
        np.concatenate([points.pose, len(given) + np.arange(len(poses))]),
        np.vstack([points.xyz_mm, xyz_mm]),
        np.concatenate([points.target, np.full(len(poses), "jig")]),
    )
    return replace(dataset, poses=more, points=new)


@pytest.fixture(scope="module")
def datasets() -> tuple[Dataset, Dataset]:
    """Datasets of an arm without effects: with some poses measured twice, and with other rows copied as well."""
    rng = np.random.default_rng(1)
    simulated = simulate_dataset("rb5", rng=rng, effects=(), poses=60, noise_mm=0.05).dataset
    assert np.array_equal(simulated.points.pose, np.arange(len(simulated.poses)))
    training = np.flatnonzero(simulated.poses.role == "train")
    twice, copied = training[:REPEATED], training[REPEATED:][:COPIED]
    xyz_mm = simulated.points.xyz_mm
    honest = with_rows(simulated, twice, xyz_mm[twice] + 0.05 * (rng.normal(size=(REPEATED, 3))), "again ")
    assert honest.points is not None
    return honest, with_rows(honest, copied, xyz_mm[copied], "copy ")


def test_copies_are_no_repeats(datasets: tuple[Dataset, Dataset]) -> None:
    honest, copied = map(find_repeats, datasets)
    assert len(honest) == len(copied) == REPEATED
    assert pooled_sigma_mm(copied) == pooled_sigma_mm(honest)
    assert 0.035 < pooled_sigma_mm(copied) < 0.065


@pytest.mark.slow
def test_the_verdict_stays(datasets: tuple[Dataset, Dataset]) -> None:
    assert diagnose(datasets[1], max_steps=0).verdict == "adequate"


def test_a_mean_counts_each_measurement_once(datasets: tuple[Dataset, Dataset]) -> None:
    honest = datasets[0]
    again = np.flatnonzero([name.startswith("again ") for name in honest.poses.ids])
    copied = with_rows(honest, again, honest.points.xyz_mm[again], "copy ")
    one, other = average_repeats(honest).points, average_repeats(copied).points
    np.testing.assert_array_equal(one.xyz_mm, other.xyz_mm)
    np.testing.assert_array_equal(one.counts_as, other.counts_as)
