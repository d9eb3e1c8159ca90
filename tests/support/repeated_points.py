"""Datasets whose poses are measured several times each, every repeat in a row of poses.csv of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.dataset.dataset import Dataset, Points


def repeated(
    dataset: Dataset, repeats: int, rng: np.random.Generator, *, noise_mm: float = 0.0, rounds: bool = False
) -> Dataset:
    """Each pose of a dataset `repeats` times, one after the other or in rounds, each time with new noise."""
    count = len(dataset.poses)
    rows = np.tile(np.arange(count), repeats) if rounds else np.repeat(np.arange(count), repeats)
    poses = dataset.poses.select(rows)
    role = np.where(poses.role == "reference", "train", poses.role)
    role[0] = "reference"
    ids = tuple(f"s{i:04d}" for i in range(len(rows)))
    xyz = dataset.points.xyz_mm[rows] + noise_mm * rng.normal(size=(len(rows), 3))
    points = Points(np.arange(len(rows)), xyz, dataset.points.target[rows])
    return replace(dataset, poses=replace(poses, ids=ids, role=role), points=points)
