"""Fleets of small datasets: points only, an arm each or two dates of one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from calib.dataset.dataset import About
from calib.dataset.files.folder import write_dataset
from calib.simulation.simulate import simulate_dataset

TOO_FEW = 4  # poses: no fit is tried, so that a dataset takes milliseconds
ENOUGH = 18


def write_cell(folder: Path, seed: int, poses: int = TOO_FEW, **about: str) -> Path:
    """A simulated dataset of an RB5 with [about]; keys beside serial, site and date are further ones."""
    simulated = simulate_dataset("rb5", rng=seed, poses=poses, name=folder.name).dataset
    known = {key: about.pop(key) for key in ("serial", "site", "date") if key in about}
    write_dataset(replace(simulated, about=About(**known, extra=about)), folder)
    return folder
