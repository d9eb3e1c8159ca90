"""A small dataset of measured points whose arm has a transmission error that the five-parameter model lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.simulate import simulate_dataset

HIDDEN = "transmission_error"


def write_hidden(folder: Path, name: str = "hidden") -> Path:
    """45 poses of an RB5 at `folder/name`, no scans; the effect is visible at four sigmas."""
    simulation = simulate_dataset(
        builtin_robot("rb5"),
        rng=np.random.default_rng(11),
        effects=[(HIDDEN, 4.0)],
        conditions=True,
        poses=45,
        name=name,
    )
    write_dataset(simulation.dataset, folder / name)
    return folder / name
