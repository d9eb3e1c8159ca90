"""Growth of the page server's resident memory while somebody works on it, after each of ten parts.

    python benchmarks/page_memory.py [--count 2000] [--dataset sample_data/hidden_effect_b]

The operations are those of benchmarks/page_operations.py: poses, views, joints, versions, steps, an effect added,
undone, redone and removed, each done before the next. A page is connected all the time and takes every message. The
first tenth warms up: it loads code and fills what is kept by design. The server runs in a process of its own."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

PARTS = 10
GOAL_MB = 20.0


def serve(path: Path) -> None:
    """The server's process: prints its port, then does as many operations as each line says and prints its memory."""
    from benchmarks.page_operations import IDLE_S, operate, rss_mb
    from inspector.app.serving import serving

    with serving(path, port=0) as app:
        assert app.worker.wait_idle(IDLE_S)
        print(app.server.get_port(), flush=True)
        for line in sys.stdin:
            operate(app, int(line))
            print(rss_mb(), flush=True)


def main() -> None:
    """Print the memory after each part, and the growth after the first."""
    from tests.support.wire_client import WireClient

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--dataset", type=Path, default=ROOT / "sample_data" / "hidden_effect_b")
    parser.add_argument("--count", type=int, default=2000)
    options = parser.parse_args()
    if options.serve is not None:
        serve(options.serve)
        return
    server = subprocess.Popen(
        [sys.executable, __file__, "--serve", str(options.dataset)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert server.stdin is not None
    assert server.stdout is not None
    with WireClient(int(server.stdout.readline())):
        began, first = time.perf_counter(), 0.0
        for part in range(PARTS + 1):  # the first warms up
            server.stdin.write(f"{options.count // PARTS}\n")
            server.stdin.flush()
            memory_mb = float(server.stdout.readline())
            first = memory_mb if part == 0 else first
            print(
                f"{part * (options.count // PARTS):6d} operations  {memory_mb:6.1f} MB  {memory_mb - first:+6.1f} MB  "
                f"{time.perf_counter() - began:6.0f} s",
                flush=True,
            )
        print(f"goal: at most {GOAL_MB:+.0f} MB")
    server.stdin.close()
    server.wait(60)
    if memory_mb - first > GOAL_MB:
        sys.exit(1)


if __name__ == "__main__":
    main()
