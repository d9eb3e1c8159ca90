"""How soon the page shows and answers, and what the server's process takes of memory.

    python benchmarks/page.py [--scans 200000 1000000] [--count 64] [--dataset sample_data/hidden_effect_b]

The server runs in a process of its own; this one is a page that speaks its protocol
(tests/support/wire_client.py) and takes the time until the last message of an answer is there and decoded. The
browser's own time comes on top. Scans are corners of 60 mm edges with 0.02 mm noise, at the places of a simulated RB5,
written straight to a temporary folder: it is the server that is tried, not the scanner. `peak` is the server's largest
resident memory, interpreter and libraries included. "after 3 s": the advised model
is judged while its advice is read. `processor` is the time that the server itself used, whoever else was busy on the
machine."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.wire_client import WireClient  # noqa: E402

LONG_S = 3600.0
SWITCHES = 20  # poses turned to
READS_S = 3.0  # that somebody reads a verdict before the next click


class Server:
    """`serving(path)` in a process of its own: it prints its port, then answers each line with its peak memory."""

    def __init__(self, path: Path) -> None:
        self.started = time.perf_counter()
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve", str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )  # fmt: skip
        self.port = int(self._line())

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def peak_mb(self) -> float:
        """Peak memory of the server, once it has nothing left to do."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return float(self._line())

    def cpu_s(self) -> float:
        """Processor time so far: unlike the wall, it does not know who else uses the machine."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(60)


def serve(path: Path) -> None:
    """The server's process."""
    from inspector.app.serving import serving

    with serving(path, port=0) as app:
        print(app.server.get_port(), flush=True)
        for _ in sys.stdin:
            assert app.worker.wait_idle(LONG_S)
            status = Path("/proc/self/status").read_text()
            print(int(status.split("VmHWM:")[1].split()[0]) / 1024, flush=True)


def says(*parts: str) -> Callable[[WireClient], bool]:
    """Whether the page has these words."""
    return lambda page: all(part in page.text() for part in parts)


def quiet(page: WireClient) -> float:
    """When the last message came: waits until none has come for 0.3 s."""
    last, count = time.perf_counter(), page.bytes_received
    while time.perf_counter() - last < 0.3:
        time.sleep(0.01)
        if page.bytes_received != count:
            last, count = time.perf_counter(), page.bytes_received
    return last


def switches(server: Server, page: WireClient, poses: int) -> tuple[float, float, float]:
    """Median and largest seconds from "next pose" to its last message, and the processor's mean."""
    out, cpu_s = [], server.cpu_s()
    for k in range(SWITCHES):
        began = time.perf_counter()
        page.trigger("Next pose")
        page.wait(says(f"{k + 2} of {poses}"), 60)
        out.append(quiet(page) - began)
    return float(np.median(out)), max(out), (server.cpu_s() - cpu_s) / SWITCHES


def points_case(path: Path) -> None:
    """A dataset of measured points: from start to ranking, switching, adding what leads."""
    server = Server(path)
    with WireClient(server.port) as page:
        page.wait(lambda p: any(name.endswith("/corners/points") for name in p.scene), LONG_S)
        print(
            f"start to first picture       {time.perf_counter() - server.started:7.2f} s   "
            f"processor: {server.cpu_s():.2f} s"
        )
        page.wait(says("What could be missing:"), LONG_S)
        print(f"start to ranking             {quiet(page) - server.started:7.2f} s")
        poses = len(page.props("Pose")["options"])
        middle, largest, cpu_s = switches(server, page, poses)
        print(
            f"pose switch                  {middle:7.3f} s   largest of {SWITCHES}: {largest:.3f} s   "
            f"processor: {cpu_s:.3f} s"
        )
        for reads_s in (0.0, READS_S):
            adds(server, page, reads_s)
        print(f"peak                         {server.peak_mb():7.0f} MB")
    server.close()


def adds(server: Server, page: WireClient, reads_s: float) -> None:
    """Add what leads, five times, after so long a look at the verdict before: until the error and the new verdict."""
    shown, judged, spent = [], [], []
    for _ in range(5):
        time.sleep(reads_s)
        name = page.value("Effect")
        began, cpu_s = time.perf_counter(), server.cpu_s()
        page.click("Add to the model")
        page.wait(says(f"+ {name}: the"), 60)
        shown.append(time.perf_counter() - began)
        page.wait(says(f"calibrated links + {name}", "What is left: "), 60)
        judged.append(time.perf_counter() - began)  # the arrows move on for a while
        quiet(page)
        spent.append(server.cpu_s() - cpu_s)
        page.set("Model", "Undo")
        page.wait(lambda p, name=name: f"+ {name}: the" not in p.text(), 60)  # type: ignore[misc]
        quiet(page)
    print(f"add after {reads_s:g} s to fallen error {np.median(shown):7.3f} s   largest of 5: {max(shown):.3f} s")
    print(
        f"add after {reads_s:g} s to new verdict  {np.median(judged):7.3f} s   largest of 5: {max(judged):.3f} s   "
        f"processor: {np.median(spent):.3f} s"
    )


def scans_case(points: int, count: int) -> None:
    """So many scans of so many points: until the first is seen, until all are searched, switching, memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dense"
        write_scans(path, points, count)
        server = Server(path)
        with WireClient(server.port) as page:
            page.wait(lambda p: any("/scan/points" in name for name in p.scene), LONG_S)
            print(f"start to first scan          {time.perf_counter() - server.started:7.2f} s")
            start_mb = server.peak_mb()  # once all is done
            print(f"start to all searched        {time.perf_counter() - server.started:7.2f} s")
            print(f"peak, all searched           {start_mb:7.0f} MB", flush=True)
            before = page.bytes_received
            middle, largest, cpu_s = switches(server, page, count)
            each = (page.bytes_received - before) / SWITCHES / 1e6
            print(
                f"pose switch                  {middle:7.3f} s   largest of {SWITCHES}: {largest:.3f} s   "
                f"processor: {cpu_s:.3f} s"
            )
            print(f"one pose                     {each:7.1f} MB")
            with WireClient(server.port) as late:
                print(f"a second page receives       {late.bytes_received / 1e6:7.1f} MB")
            print(f"peak, {SWITCHES} poses looked at     {server.peak_mb():7.0f} MB")
        server.close()


def write_scans(folder: Path, points: int, count: int) -> None:
    """A dataset of `count` scans of a corner whose three faces look at the scanner."""
    from scipy.spatial.transform import Rotation

    from calib.dataset.files.folder import write_dataset
    from calib.dataset.files.robot_toml import builtin_robot
    from calib.scans.scan import Scan, write_scan
    from calib.simulation.simulate import simulate_dataset

    rng = np.random.default_rng(5)
    dataset = simulate_dataset(builtin_robot("rb5"), rng=rng, poses=count, name="dense").dataset
    assert dataset.points is not None
    (folder / "scans").mkdir(parents=True)
    edge_mm = dataset.jig.edge_mm
    upright = Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.ones(3) / np.sqrt(3.0)])[0]
    for name, apex_mm in zip(dataset.poses.scan_names, dataset.points.xyz_mm, strict=True):
        look = Rotation.align_vectors([apex_mm / np.linalg.norm(apex_mm)], [[0.0, 0.0, 1.0]])[0]
        turn = Rotation.from_rotvec([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-np.pi, np.pi)])
        edges = (look * turn * upright).as_matrix().T  # rows: the unit edges that leave the apex, away from us
        face = rng.integers(0, 3, points)
        across = rng.uniform(0.0, edge_mm, (points, 2))
        folded = across.sum(axis=1) > edge_mm
        across[folded] = edge_mm - across[folded]  # a face is the triangle between two edges
        xyz = apex_mm + across[:, :1] * edges[face] + across[:, 1:] * edges[(face + 1) % 3]
        write_scan(folder / "scans" / name, Scan(name, xyz + rng.normal(0.0, 0.02, xyz.shape)))
    write_dataset(replace(dataset, points=None, scan_folder="scans"), folder)


def main() -> None:
    """Run the cases that are asked for: points, then each size of scan."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--dataset", type=Path, default=ROOT / "sample_data" / "hidden_effect_b")
    parser.add_argument("--scans", type=int, nargs="*", default=[200_000, 1_000_000])
    parser.add_argument("--count", type=int, default=64)
    options = parser.parse_args()
    if options.serve is not None:
        serve(options.serve)
        return
    print(f"{options.dataset.name}")
    points_case(options.dataset)
    for points in options.scans:
        print(f"\n{options.count} scans of {points:,} points")
        scans_case(points, options.count)


if __name__ == "__main__":
    main()
