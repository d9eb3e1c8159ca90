"""A fleet of datasets with scans: one local worker against two, the client's memory, the same table, a killed worker.

    python benchmarks/fleet.py [--datasets 24] [--poses 16] [--workers 1 2 1 2] [--kill] [--folder DIR]

Eight arms are simulated with scans of 12,000 points; each dataset has the scans of one of them with range noise of its
own, a serial number, a date and a gear lot: two datasets an arm. One of the eight has a bad gear and is what the arms
of one lot have. Each run is a process of its own that judges all datasets afresh on local processes, in the
order of `--workers`, so that runs with one and with two take turns. `wall` is from the start of the workers to the last
dataset; `client s` is the processor time of the process that gives out the work, `client MB` its memory after a
quarter of the datasets and at the end; `--kill` ends a worker with SIGKILL after a quarter. The load of the machine
stands beside each row: a ratio of times means something only where nothing else runs. The table is hashed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.dataset.dataset import About  # noqa: E402
from calib.dataset.files.folder import load_dataset, write_dataset  # noqa: E402
from calib.dataset.files.robot_toml import builtin_robot  # noqa: E402
from calib.extras.fleet.discovery import discover  # noqa: E402
from calib.extras.fleet.present.fleets import cause_phrase  # noqa: E402
from calib.extras.fleet.run import run_fleet  # noqa: E402
from calib.extras.fleet.table import table_bytes  # noqa: E402
from calib.extras.fleet.workers import local_workers  # noqa: E402
from calib.scans.scan import Scan, load_scan, write_scan  # noqa: E402
from calib.simulation.simulate import simulate_dataset, write_simulation  # noqa: E402

SETS = 8
BAD = SETS - 1  # the arm with a bad gear
OWN_NOISE_MM = 0.01


def make_fleet(folder: Path, datasets: int, poses: int) -> None:
    """Datasets below `folder/fleet`, two an arm, in a folder for each site."""
    for k in range(SETS):
        simulation = simulate_dataset(
            builtin_robot("rb5"), rng=np.random.default_rng(k), poses=poses, scans=True, name=f"set{k}",
            effects=["transmission_error"] if k == BAD else [],
        )  # fmt: skip
        write_simulation(simulation, folder / "sets" / f"set{k}", truth_path=folder / "truth" / f"set{k}.json")
    sets = [load_dataset(folder / "sets" / f"set{k}") for k in range(SETS)]
    batch = range(datasets // 4, datasets // 4 + max(2, datasets // 10))
    for i in range(datasets):
        rng, arm = np.random.default_rng([1, i]), i // 2
        source = sets[BAD] if i in batch else sets[arm % BAD]
        place = folder / "fleet" / ("Ulm" if arm % 2 else "Busan") / f"cell{i:04d}"
        about = About(
            serial=f"A-{arm:03d}",
            site=place.parent.name,
            date=f"2026-{3 + i % 2 * 7:02d}-01",
            extra={"gear": f"lot {17 if i in batch else arm % 4}"},
        )
        write_dataset(replace(source, name=place.name, about=about), place)
        for name in source.poses.scan_names:
            points = load_scan(place / "scans" / name).points_mm
            noisy = points + rng.normal(0.0, OWN_NOISE_MM, points.shape)
            write_scan(place / "scans" / name, Scan(Path(name).stem, noisy))


def memory_mb(key: str) -> float:
    """VmRSS or VmHWM (peak) of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(key))


def run(folder: Path, workers: int, *, kill: bool) -> None:
    """Results of one run, as JSON."""
    memory: list[float] = []
    started, spent = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as results, local_workers(workers, 1800.0) as pool:
        up = time.perf_counter() - started

        def on_progress(done: int, total: int, path: str) -> None:
            memory.append(memory_mb("VmRSS"))
            if kill and len(memory) == max(1, total // 4):
                multiprocessing.active_children()[0].kill()

        fleet = run_fleet(discover(folder / "fleet"), Path(results), pool, on_progress=on_progress)
    count = len(fleet.rows) + len(fleet.failures)
    print(
        json.dumps(
            {
                "wall": time.perf_counter() - started,
                "cpu": time.process_time() - spent,
                "up": up,
                "work": fleet.seconds,
                "rows": len(fleet.rows),
                "failed": [failure.reason for failure in fleet.failures],
                "shared": [cause_phrase(cause) for cause in fleet.shared],
                "quarter_mb": memory[count // 4],
                "end_mb": memory[-1],
                "peak_mb": memory_mb("VmHWM"),
                "hash": hashlib.sha256(table_bytes(fleet.rows, ".csv")).hexdigest()[:12],
            }
        )
    )


def main() -> None:
    """Make the fleet, run it each way, print the table."""
    parser = argparse.ArgumentParser(description="a fleet of datasets on local workers")
    parser.add_argument("--datasets", type=int, default=24)
    parser.add_argument("--poses", type=int, default=16)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 1, 2])
    parser.add_argument("--kill", action="store_true", help="end a worker with SIGKILL in a further run")
    parser.add_argument("--folder", type=Path, help="where to make the datasets (default: a temporary folder)")
    parser.add_argument("--run", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run:
        run(arguments.folder, arguments.run, kill=arguments.kill)
        return
    if arguments.folder is not None:
        measure(arguments.folder, arguments)
        return
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), arguments)


def measure(folder: Path, arguments: argparse.Namespace) -> None:
    """The rows, and the ratio of the median times."""
    if not (folder / "fleet").exists():
        make_fleet(folder, arguments.datasets, arguments.poses)
    print(f"{arguments.datasets} datasets of {arguments.poses} scans, {len(os.sched_getaffinity(0))} cores")
    print(
        f"{'workers':10}{'wall s':>8}{'up s':>6}{'work s':>8}{'client s':>9}{'client MB: 1/4':>15}{'end':>6}{'peak':>6}"
        f"{'rows':>6}{'load before, after':>20}  table"
    )
    walls: dict[int, list[float]] = {}
    runs = [(workers, False) for workers in arguments.workers] + [(2, True)] * arguments.kill
    for workers, kill in runs:
        load = os.getloadavg()[0]
        command = [sys.executable, __file__, "--run", str(workers), "--folder", str(folder)]
        said = subprocess.run([*command, *(["--kill"] * kill)], check=True, capture_output=True, text=True)
        r = json.loads(said.stdout)
        if not kill:
            walls.setdefault(workers, []).append(r["wall"])
        print(
            f"{str(workers) + (' killed' if kill else ''):10}{r['wall']:8.1f}{r['up']:6.1f}{r['work']:8.1f}"
            f"{r['cpu']:9.1f}{r['quarter_mb']:15.0f}{r['end_mb']:6.0f}{r['peak_mb']:6.0f}{r['rows']:6}"
            f"{load:12.1f}{os.getloadavg()[0]:8.1f}  {r['hash']}",
            *r["failed"],
            flush=True,
        )
    print(*r["shared"], sep="\n")
    if {1, 2} <= walls.keys():
        one, two = (float(np.median(walls[n])) for n in (1, 2))
        print(f"two workers are {one / two:.2f} times one (medians)")


if __name__ == "__main__":
    main()
