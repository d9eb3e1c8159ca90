"""Damaged files by the thousand: each a corner, a reasoned rejection or one clear error, or it is counted against us.

    python benchmarks/fuzz.py [--files 10000] [--tables 10000] [--seconds 20] [--processes 2] [--seed 0] [--peer]

Scan files are those of tests/support/scan_mutations.py: every format, of a good scan or of a cloud without a corner,
whole, cut, flipped, refilled. Each is loaded, and searched for the corner where it holds enough points. Tables are
files of a dataset of sample_data, damaged likewise and loaded. Processes with 4 GB of address space do it, and every
warning is an exception there; the parent waits --seconds for each file and replaces a process that died or hangs.

crash: another exception than CalibError, an error or reason of more than one line, or a dead process. wrong: a corner
more than 1 mm from the true one (bytes that say another place, such as swapped columns, can make it so). With --peer,
Open3D loads and nothing is searched; wrong are then the points that it gives for a file which ours refuses.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.corners.search import MIN_POINTS, find_corner  # noqa: E402
from calib.dataset.files.folder import load_dataset  # noqa: E402
from calib.errors import CalibError  # noqa: E402
from calib.jig import Jig  # noqa: E402
from calib.scans.scan import load_scan  # noqa: E402
from tests.support.scan_mutations import CLOUDS, MUTATIONS, WRITERS  # noqa: E402
from tests.support.scan_scene import SceneScan, make_scene  # noqa: E402

DATASET = ROOT / "sample_data" / "hidden_effect_a"
TABLES = ("dataset.toml", "robot.toml", "poses.csv", "points.csv")
OUTCOMES = ("corner", "rejection", "error", "loaded", "crash", "hang")
MOST_MEMORY = 4 * 2**30
Case = tuple[int, str, str]  # number, name of the format or table, name of the mutation or cloud


@lru_cache
def scene_of(seed: int) -> SceneScan:
    """A small scan in which the corner can be found."""
    return make_scene(np.random.default_rng(seed), 1500, field_mm=90)


def cases(files: int, tables: int, seed: int) -> Iterator[Case]:
    """Files to try; a quarter of the scans are clouds without a corner, half of those damaged as well."""
    rng = np.random.default_rng(seed)
    for number in range(files):
        kind = rng.choice([*CLOUDS]) if rng.random() < 0.25 else rng.choice([*MUTATIONS])
        yield number, str(rng.choice([*WRITERS])), str(kind)
    for number in range(files, files + tables):
        yield number, str(rng.choice(TABLES)), str(rng.choice([*MUTATIONS]))


def attempt(case: Case, seed: int, folder: Path, peer: bool) -> tuple[str, str]:
    """Outcome of one case and what the program printed."""
    number, name, kind = case
    rng = np.random.default_rng([seed, number])
    if name in TABLES:
        path = folder / name
        path.write_bytes(MUTATIONS[kind](rng, (DATASET / name).read_bytes()))
        try:
            load_dataset(folder)
        finally:
            shutil.copyfile(DATASET / name, path)
        return "loaded", ""
    scene = scene_of(number % 8)
    points = CLOUDS[kind](rng) if kind in CLOUDS else scene.scan.points_mm
    content = WRITERS[name](points)
    if kind in MUTATIONS:
        content = MUTATIONS[kind](rng, content)
    elif rng.random() < 0.5:
        content = MUTATIONS[str(rng.choice([*MUTATIONS]))](rng, content)
    path = folder / name
    path.write_bytes(content)
    if peer:
        import open3d

        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        read = len(open3d.io.read_point_cloud(str(path)).points)
        try:
            load_scan(path)
        except CalibError as error:
            return ("loaded", f"wrong: {read} points where ours says {error}") if read else ("error", "none read")
        return ("loaded", "") if read else ("error", "none read")
    scan = load_scan(path)
    if len(scan.points_mm) < MIN_POINTS:
        return "rejection", "too few points to search"
    found = find_corner(scan, Jig(), scan_sigma_mm=0.02)
    if found.corner is None:
        return "rejection", found.failure
    off_mm = float(np.linalg.norm(found.corner.xyz_mm - scene.apex_mm))
    return "corner", f"wrong: {off_mm:.3g} mm off" if off_mm > 1.0 else ""


def serve(pipe: Connection, seed: int, folder: Path, peer: bool) -> None:
    """Loop of a worker process: case after case, until it receives None."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    warnings.simplefilter("error")
    for name in TABLES:
        shutil.copyfile(DATASET / name, folder / name)
    while (case := pipe.recv()) is not None:
        try:
            outcome, said = attempt(case, seed, folder, peer)
        except CalibError as error:
            outcome, said = "error", str(error)
        except BaseException:
            outcome, said = "crash", traceback.format_exc()
        if outcome in ("error", "rejection") and ("\n" in said or not said):
            outcome = "crash"
        pipe.send((outcome, said, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


@dataclass
class Tally:
    """Counts of outcomes."""

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)  # of (name, outcome)
    wrong: list[str] = field(default_factory=list)
    bad: list[str] = field(default_factory=list)
    slowest_s: tuple[float, Case] = (0.0, (0, "", ""))
    most_mb: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, case: Case, outcome: str, said: str, seconds: float, mb: float) -> None:
        """Count one case."""
        with self.lock:
            self.outcomes[case[1], outcome] += 1
            self.slowest_s = max(self.slowest_s, (seconds, case))
            self.most_mb = max(self.most_mb, mb)
            if outcome in ("crash", "hang"):
                self.bad.append(f"{case}: {outcome}\n{said}")
            if said.startswith("wrong"):
                self.wrong.append(f"{case}: {said}")

    def lines(self) -> list[str]:
        """The table."""
        names = [name for name in (*WRITERS, *TABLES) if any((name, o) in self.outcomes for o in OUTCOMES)]
        rows = [f"{'file':16}" + "".join(f"{outcome:>11}" for outcome in OUTCOMES)]
        rows += [f"{n:16}" + "".join(f"{self.outcomes[n, o]:11}" for o in OUTCOMES) for n in names]
        rows.append(f"{'all':16}" + "".join(f"{sum(self.outcomes[n, o] for n in names):11}" for o in OUTCOMES))
        seconds, case = self.slowest_s
        rows.append(f"slowest {seconds:.1f} s {case}; most memory of a process {self.most_mb:.0f} MB")
        rows.append(f"wrong: {len(self.wrong)}")
        return rows + [f"  {line}" for line in self.wrong[:20]] + self.bad[:40]


def drive(waiting: Iterator[Case], lock: threading.Lock, tally: Tally, seed: int, limit_s: float, peer: bool) -> None:
    """Run the cases through one worker process after the other, and count the outcomes."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        pipe = process = None
        while True:
            with lock:
                case = next(waiting, None)
            if process is None and case is not None:
                pipe, theirs = context.Pipe()
                process = context.Process(target=serve, args=(theirs, seed, Path(folder), peer), daemon=True)
                process.start()
                theirs.close()
                first = True
            if case is None or pipe is None or process is None:
                break
            started = time.perf_counter()
            pipe.send(case)
            outcome, said, mb = "hang", "", 0.0
            if pipe.poll(limit_s + 60 * first):  # the first has to import
                try:
                    outcome, said, mb = pipe.recv()
                except EOFError:
                    process.join()
                    outcome, said = "crash", f"the process died with {process.exitcode}"
            tally.add(case, outcome, said, 0.0 if first else time.perf_counter() - started, mb)
            first = False
            if outcome == "hang" or not process.is_alive():
                process.kill()
                process = None
        if process is not None and pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.send(None)
            process.join()


def main() -> None:
    """Run and print the tally."""
    parser = argparse.ArgumentParser(description="damaged files, each an answer or an error")
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--tables", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=20.0, help="for one file")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--peer", action="store_true", help="load with Open3D instead, .ply .pcd .xyz only")
    arguments = parser.parse_args()
    tally, lock = Tally(), threading.Lock()
    waiting = cases(arguments.files, arguments.tables, arguments.seed)
    if arguments.peer:
        waiting = (case for case in waiting if case[1].endswith((".ply", ".pcd", ".xyz")))
    threads = [
        threading.Thread(target=drive, args=(waiting, lock, tally, arguments.seed, arguments.seconds, arguments.peer))
        for _ in range(arguments.processes)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print("\n".join(tally.lines()))
    sys.exit(1 if tally.bad else 0)


if __name__ == "__main__":
    main()
