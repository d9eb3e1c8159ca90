"""A fleet on a Dask cluster of its own processes: seconds a dataset, memory of the head, a killed worker, 5,000 arms.

    python benchmarks/fleet_cluster.py [--datasets 300] [--poses 30] [--arms 5000] [--folder DIR]

`dask scheduler` and two `dask worker`s (one thread each, with a nanny) are started as processes on this machine, and
every dataset goes the way of `inspector fleet --scheduler`: files, fit, diagnosis, kept result, comparison with the
arm's dataset before, shared causes, table and page. The datasets have points of 0.05 mm noise; one arm in ten has a bad
gear, mostly of one range of serial numbers; every arm has two datasets. In a second run a worker's process is killed
(SIGKILL) after a third of the datasets: nothing may be missing and the table has to be the same, bit by bit. Last, the
rows are handed on as those of `--arms` arms, to measure what grows faster than the number of datasets: the shared
causes, the table and the page of the head process.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np
from distributed import Client

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fleet import memory_mb  # noqa: E402

from calib.dataset.dataset import About  # noqa: E402
from calib.dataset.files.folder import write_dataset  # noqa: E402
from calib.dataset.files.robot_toml import builtin_robot  # noqa: E402
from calib.errors import CalibError  # noqa: E402
from calib.extras.fleet.discovery import discover  # noqa: E402
from calib.extras.fleet.drift import Drift  # noqa: E402
from calib.extras.fleet.result import Fleet  # noqa: E402
from calib.extras.fleet.row import Row  # noqa: E402
from calib.extras.fleet.run import run_fleet  # noqa: E402
from calib.extras.fleet.shared_causes import shared_causes  # noqa: E402
from calib.extras.fleet.table import table_bytes  # noqa: E402
from calib.extras.fleet.workers import cluster_workers  # noqa: E402
from calib.simulation.simulate import simulate_dataset  # noqa: E402
from inspector.extras.fleet.fleet_page import fleet_html  # noqa: E402

UP_S = 60.0


def make_fleet(folder: Path, datasets: int, poses: int) -> None:
    """Datasets of points below a folder, two an arm, in a folder for each site."""
    for i in range(datasets):
        arm, batch = i // 2, range(datasets // 8, datasets // 8 + max(2, datasets // 20))
        simulation = simulate_dataset(
            builtin_robot("rb5"), rng=np.random.default_rng([arm, 5]), poses=poses, noise_mm=0.05,
            effects=["transmission_error"] if arm in batch else [],
        )  # fmt: skip
        place = folder / ("Ulm" if arm % 2 else "Busan") / f"cell{i:05d}"
        about = About(serial=f"A-{arm:05d}", site=place.parent.name, date=f"2026-{3 + i % 2 * 7:02d}-01")
        points = simulation.dataset.points
        assert points is not None
        moved = points.xyz_mm + 0.02 * np.random.default_rng(i).normal(size=points.xyz_mm.shape)
        noisy = simulation.dataset.with_points(replace(points, xyz_mm=moved))
        write_dataset(replace(noisy, name=place.name, about=about), place)


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler, and its processes: the scheduler's first, then each worker's nanny."""
    address_file = folder / "scheduler.json"
    address_file.unlink(missing_ok=True)
    dask = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    own = ["--host", "127.0.0.1", "--scheduler-file", str(address_file), "--no-dashboard"]
    started = [subprocess.Popen([*dask, "scheduler", "--port", "0", *own], env=environment, **quiet)]
    try:
        wait_for(address_file.exists)
        join = ["--nthreads", "1", "--local-directory", str(folder), "--host", "127.0.0.1", "--no-dashboard"]
        for _ in range(workers):
            command = [*dask, "worker", "--scheduler-file", str(address_file), *join]
            started.append(subprocess.Popen(command, env=environment, **quiet))
        with distributed_client(f"file://{address_file}") as client:
            client.wait_for_workers(workers, timeout=UP_S)
            address = str(client.scheduler.address)
        yield address, started
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            with suppress(subprocess.TimeoutExpired):
                process.wait(20.0)
            process.kill()


def distributed_client(address: str) -> Client:
    """Client of a scheduler, by its address or by the file that it has written."""
    file = address.removeprefix("file://")
    where = {"scheduler_file": file} if file != address else {"address": address}
    return Client(**where, set_as_default=False)


def wait_for(holds: object) -> None:
    """Wait until a condition holds."""
    assert callable(holds)
    until = time.monotonic() + UP_S
    while not holds():
        if time.monotonic() > until:
            raise CalibError("the cluster's scheduler did not start")
        time.sleep(0.1)


def child_of(process: subprocess.Popen[bytes]) -> int:
    """Process that a worker's nanny watches: the one that computes."""
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")  # each thread has children of its own
    children = [child for thread in threads for child in thread.read_text().split()]
    busy = [int(c) for c in children if "resource_tracker" not in Path(f"/proc/{c}/cmdline").read_text()]
    return busy[-1]


def run(folder: Path, address: str, kill: subprocess.Popen[bytes] | None) -> Fleet:
    """The fleet judged afresh; prints what it took."""
    memory: list[float] = []
    killed: list[int] = []
    found = discover(folder)
    begun, spent = time.perf_counter(), time.process_time()

    def on_progress(done: int, total: int, path: str) -> None:
        memory.append(memory_mb("VmRSS"))
        if kill is not None and not killed and done >= total // 3:
            killed.append(child_of(kill))
            os.kill(killed[0], signal.SIGKILL)

    with tempfile.TemporaryDirectory() as results, cluster_workers(address, folder, 1800.0) as pool:
        fleet = run_fleet(found, Path(results), pool, on_progress=on_progress)
    wall = time.perf_counter() - begun
    with distributed_client(address) as client:
        worked = sum(client.run(time.process_time).values())  # of the workers that are alive
    count = len(found.datasets)
    at, spent = [memory[k] for k in (count // 4, count - 1, -1)], time.process_time() - spent
    print(
        f"{'one worker killed' if killed else 'as it is'}: {count} datasets in {wall:.0f} s, {wall / count:.2f} s each "
        f"({fleet.seconds / count:.2f} s of work, {worked / count:.2f} s of processor time); head: {spent:.0f} s of "
        f"processor time, {at[0]:.0f} MB after a quarter, {at[1]:.0f} MB after all, {at[2]:.0f} MB at the end; "
        f"{len(fleet.rows)} rows, {len(fleet.failures)} failures, {len(fleet.drifts)} comparisons; table "
        f"{hashlib.sha256(table_bytes(fleet.rows, '.csv')).hexdigest()[:12]}; load {os.getloadavg()[0]:.1f}",
        *(f"{failure.path}: {failure.reason}" for failure in fleet.failures),
        flush=True,
        sep="\n  ",
    )
    return fleet


def as_of(fleet: Fleet, arms: int) -> Fleet:
    """The fleet with its rows and comparisons repeated, as those of so many arms."""
    rows: list[Row] = []
    drifts: list[Drift] = []
    by_serial = {serial: list(of) for serial, of in itertools.groupby(fleet.rows, key=lambda row: row.serial)}
    sources = sorted(by_serial)
    for arm in range(arms):
        serial = sources[arm * len(sources) // arms]  # neighbours stay neighbours
        for row in by_serial[serial]:
            rows.append(replace(row, serial=f"B-{arm:05d}", path=f"{row.path}/{arm:05d}"))
    drifts = [fleet.drifts[k * len(fleet.drifts) // arms] for k in range(arms)] if fleet.drifts else []
    return replace(fleet, rows=tuple(rows), drifts=tuple(drifts))


def many_arms(fleet: Fleet, arms: int) -> None:
    """Print what the head process takes for a fleet of many arms, once its rows are there."""
    large = as_of(fleet, arms)

    def timed(what: str, begun: float, words: str) -> None:
        seconds = time.perf_counter() - begun
        print(f"{arms} arms, {len(large.rows)} rows: {what} {seconds:.1f} s, {words}, peak {memory_mb('VmHWM'):.0f} MB")

    begun = time.perf_counter()
    shared = shared_causes(large.rows)
    timed("shared causes", begun, f"{len(shared)} causes")
    begun = time.perf_counter()
    timed("table", begun, f"{len(table_bytes(large.rows, '.csv')) / 1e6:.1f} MB")
    begun = time.perf_counter()
    page = fleet_html(replace(large, shared=shared), Path("fleet.html"), now=datetime(2026, 1, 1))
    timed("page", begun, f"{len(page) / 1e6:.1f} MB")


def main() -> None:
    """Make the fleet, run it as it is and with a killed worker, and hand its rows on as a larger fleet's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--datasets", type=int, default=300)
    parser.add_argument("--poses", type=int, default=30)
    parser.add_argument("--arms", type=int, default=5000)
    parser.add_argument("--folder", type=Path, help="where to make the datasets (default: a temporary folder)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = arguments.folder or Path(name)
        if not (folder / "fleet").exists():
            make_fleet(folder / "fleet", arguments.datasets, arguments.poses)
        print(f"{arguments.datasets} datasets of {arguments.poses} poses, {len(os.sched_getaffinity(0))} cores")
        with cluster(2, folder) as (address, _):
            plain = run(folder / "fleet", address, None)
        with cluster(2, folder) as (address, processes):
            broken = run(folder / "fleet", address, processes[1])
        same = table_bytes(plain.rows, ".csv") == table_bytes(broken.rows, ".csv") and plain.drifts == broken.drifts
        print(f"with a killed worker {'the same' if same else 'ANOTHER'} table and comparisons")
        many_arms(plain, arguments.arms)


if __name__ == "__main__":
    main()
