"""Operations on a page, hundreds at a time: poses, views, effects added, undone and removed; memory."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from soaking.record import Result
from soaking.server.live_server import ROOT
from tests.support.wire_client import WireClient

STEP = 100  # operations of one case
DATASET = ROOT / "sample_data" / "hidden_effect_b"


def run(numbers: Sequence[int], out: Path) -> Iterator[Result]:
    """The cases of these numbers, at one server (that of `benchmarks/page_memory.py`) with a page on it."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / f"server_{int(time.time())}.log"
    server = subprocess.Popen(
        [sys.executable, str(ROOT / "benchmarks" / "page_memory.py"), "--serve", str(DATASET)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log.open("wb"), text=True,
    )  # fmt: skip
    assert server.stdin is not None
    assert server.stdout is not None
    try:
        with WireClient(int(server.stdout.readline())) as page:
            for number in numbers:
                began = time.monotonic()
                server.stdin.write(f"{STEP}\n")
                server.stdin.flush()
                line = server.stdout.readline()
                said = log.read_text("utf-8", "replace")
                trouble = "" if line else "died"
                if "Traceback" in said:
                    trouble = "traceback"
                elif any(message.startswith("connection ended") for message in page.log):
                    trouble, said = (
                        "page lost",
                        str([m for m in page.log if m.startswith("connection ended")]),
                    )
                elif any("internal" in str(m).lower() for m in page.notifications):
                    trouble, said = "problem told", str(page.notifications[-1])
                seconds, told = round(time.monotonic() - began, 2), said[-3000:] if trouble else ""
                end, figures = "done" if line else "died", {"server": float(server.pid)}
                what, mb = f"{STEP} operations", float(line or 0)
                yield Result(number, "page", what, end, trouble, told, seconds=seconds, mb=mb, figures=figures)
                if not line:
                    return
    finally:
        server.stdin.close()
        try:
            server.wait(60)
        except subprocess.TimeoutExpired:
            server.kill()
