"""The command `simulate`: a dataset with known truth, its points, or its scans with a scanner's errors."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.dataset.files.atomic_write import require_free
from calib.dataset.files.points_csv import LEAST_SIGMA_MM, MOST_SIGMA_MM
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, refuse_beyond
from calib.errors import DatasetError
from calib.options import BUILTIN_ROBOTS
from calib.simulation.simulate import simulate_dataset, write_simulation
from inspector.cli.dataset_commands import show
from inspector.cli.options.datasets import SimulateOptions
from inspector.cli.progress import progress


def run_simulate(options: SimulateOptions) -> int:
    """Simulate a dataset with known truth."""
    require_free(options.path)
    least, most = LEAST_SIGMA_MM, MOST_SIGMA_MM
    if options.noise_mm != 0.0 and not least <= options.noise_mm <= most:  # such a dataset could not be read
        raise DatasetError(f"--noise-mm {options.noise_mm:g}: give 0, or {least:g} to {most:g} mm")
    if options.robot not in BUILTIN_ROBOTS and not Path(options.robot).is_file():
        known = ", ".join(BUILTIN_ROBOTS)
        raise DatasetError(f"--robot {options.robot}: no such file; give one of {known}, or a robot.toml")
    if options.robot in BUILTIN_ROBOTS:
        robot = builtin_robot(options.robot)
    else:
        robot = load_robot_toml(Path(options.robot))
        refuse_beyond(robot, Path(options.robot))
    simulation = simulate_dataset(
        replace(robot, carries_scanner=options.mount == "flange"),
        rng=np.random.default_rng(options.seed),
        effects=options.effect,
        poses=options.poses,
        noise_mm=options.noise_mm,
        scans=options.scans,
        name=options.path.resolve().name,
        description=f"simulated {robot.name}, seed {options.seed}",
    )
    with progress("scans") as on_progress, _whole_or_nothing(options.path):
        write_simulation(simulation, options.path, on_progress=on_progress)
    truth = options.path / "truth.json"
    document = {"dataset": str(options.path), "truth": str(truth), "poses": options.poses, "effects": options.effect}
    show(options, document, f"{options.path}: {options.poses} poses of {robot.name}; the truth is in {truth}")
    return 0


@contextmanager
def _whole_or_nothing(folder: Path) -> Iterator[None]:
    """Context that restores an empty or missing folder where the work that fills it fails or is stopped."""
    was_there = folder.exists()
    try:
        yield
    except BaseException:
        for path in list(folder.iterdir()) if folder.is_dir() else ():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if folder.is_dir() and not was_there:
            folder.rmdir()
        raise
