"""Many large scans: wall time, cores and memory of find_corners, alone, on processes and on Dask.

    python benchmarks/many_scans.py [--scans 64] [--points 200000] [--processes 1 2] [--dask 2] [--folder DIR]

The scans are those of the tests' ray caster: eight scenes, and turns of them about the scanner, written once to a
folder that goes away afterwards. Each row is a process of its own that loads the dataset and searches all. `cores` is
the processor time of it and its children over the wall time: the share of the machine that it got and used; `search` is
the sum of the searches' own seconds over the wall time. Memory is the peak of the parent, and of the largest child.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib import find_corners  # noqa: E402
from calib.dataset.files.folder import load_dataset  # noqa: E402
from calib.scans.scan import Scan, write_scan  # noqa: E402
from tests.support.scan_scene import make_scene  # noqa: E402

SCENES = 8
SEEN = 0.92  # share of the rays that give a point


def make_dataset(folder: Path, scans: int, points: int) -> None:
    """A dataset of `scans` scans of about `points` points; its joint angles mean nothing."""
    source = ROOT / "sample_data" / "rb5_jang"
    shutil.copy(source / "robot.toml", folder)
    (folder / "dataset.toml").write_text(
        'format = 1\nname = "many"\nrobot = "robot.toml"\nposes = "poses.csv"\nscans = "scans"\n'
        "[scanner]\nscan_sigma_mm = 0.02\n"
    )
    (folder / "scans").mkdir()
    joints = [f"q{i + 1}_deg" for i in range(len(load_dataset(source).robot.joints))]
    lines = [",".join(["pose", "role", *joints])]
    scenes = [make_scene(np.random.default_rng(seed), round(points / SEEN)).scan for seed in range(SCENES)]
    for i in range(scans):
        angle = 0.1 * (i // SCENES)  # about the line of sight: what a turned scanner would have seen
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0.0, 0.0, 1.0]])
        write_scan(folder / "scans" / f"p{i}.ply", Scan(f"p{i}", scenes[i % SCENES].points_mm @ turn.T))
        lines.append(",".join([f"p{i}", "train" if i else "reference", *(f"{10 * k + i}" for k in range(len(joints)))]))
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")


@contextmanager
def executor_of(kind: str, workers: int) -> Iterator[Executor | None]:
    """Executor on which find_corners runs."""
    if kind == "alone":
        yield None
    elif kind == "processes":
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            yield pool
    else:
        import distributed

        cluster = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        with cluster, distributed.Client(cluster) as client, client.get_executor() as executor:
            yield executor


def peak_mb() -> float:
    """Peak resident memory of this process alone; ru_maxrss would count that of the process that started it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def run(folder: Path, kind: str, workers: int) -> None:
    """One row of the table, as JSON."""
    dataset = load_dataset(folder)
    started = time.perf_counter()
    with executor_of(kind, workers) as executor:
        found = find_corners(dataset, executor=executor, intermediate=False)
        wall = time.perf_counter() - started
    mine, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    corners = [search.corner for search in found.values() if search.corner is not None]
    content = b"".join(c.xyz_mm.tobytes() + c.covariance_mm2.tobytes() for c in corners)
    print(
        json.dumps(
            {
                "wall": wall,
                "cpu": mine.ru_utime + mine.ru_stime + children.ru_utime + children.ru_stime,
                "search": sum(search.seconds for search in found.values()),
                "parent_mb": peak_mb(),
                "child_mb": children.ru_maxrss / 1024,
                "corners": len(corners),
                "hash": hashlib.sha256(content).hexdigest()[:12],
            }
        )
    )


def main() -> None:
    """Make the scans, run each way, print the table."""
    parser = argparse.ArgumentParser(description="wall time, cores and memory of many large scans")
    parser.add_argument("--scans", type=int, default=64)
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--processes", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--dask", type=int, nargs="*", default=[], help="workers")
    parser.add_argument("--folder", type=Path, help="where to put the scans for the time (default: /tmp)")
    parser.add_argument("--run", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run:
        run(Path(arguments.run[0]), arguments.run[1], int(arguments.run[2]))
        return
    cores = len(os.sched_getaffinity(0))
    ways = [("processes" if n > 1 else "alone", n) for n in arguments.processes]
    ways += [("dask", n) for n in arguments.dask]
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        make_dataset(Path(name), arguments.scans, arguments.points)
        print(f"{arguments.scans} scans of {arguments.points} points, {cores} cores")
        print(
            f"{'run by':14}{'wall s':>9}{'cores':>7}{'of all':>8}{'search':>8}{'parent MB':>11}{'child MB':>10}"
            f"{'corners':>9}  bits"
        )
        for kind, workers in ways:
            said = subprocess.run(
                [sys.executable, __file__, "--run", name, kind, str(workers)],
                check=True, capture_output=True, text=True,
            ).stdout  # fmt: skip
            r = json.loads(said)
            print(
                f"{kind + ' ' + str(workers):14}{r['wall']:9.1f}{r['cpu'] / r['wall']:7.2f}"
                f"{r['cpu'] / r['wall'] / cores:8.0%}{r['search'] / r['wall']:8.2f}{r['parent_mb']:11.0f}"
                f"{r['child_mb']:10.0f}{r['corners']:9}  {r['hash']}",
                flush=True,
            )


if __name__ == "__main__":
    main()
