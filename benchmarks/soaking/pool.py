"""Processes that are kept alive for many cases, each with a limit of memory and of time. Whoever hangs is replaced."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import resource
import shutil
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from soaking.record import Result

MOST_MEMORY = 4 * 2**30  # bytes of address space of a process
CASES_A_PROCESS = 300
IMPORT_S = 120.0  # on top for a process's first case


@dataclass(frozen=True)
class Work:
    """Function that a process runs for each number: `module.attempt(number, seed, material, scratch) -> Result`."""

    module: str
    seed: int
    material: Path  # good inputs, which nobody changes
    limit_s: float  # for one case


def peak_mb() -> float:
    """The largest resident memory since `forget_peak`."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def forget_peak() -> None:
    """Begin to look for the largest memory anew, where the system allows it."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def serve(pipe: Connection, work: Work, scratch: Path) -> None:
    """A process: number after number until None."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    module: Any = importlib.import_module(work.module)
    while (number := _next(pipe)) is not None:
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        forget_peak()
        began = time.perf_counter()
        try:
            result = module.attempt(number, work.seed, work.material, scratch)
        except BaseException:  # whatever it is, it is told, and the next case is tried
            result = Result(number, "?", trouble="traceback", said=traceback.format_exc()[-4000:])
        pipe.send(replace(result, seconds=round(time.perf_counter() - began, 3), mb=round(peak_mb(), 1)))


def _next(pipe: Connection) -> int | None:
    """The next case; None where there is none, or nobody to ask any more."""
    try:
        number: int | None = pipe.recv()
    except (EOFError, OSError):
        return None
    return number


class _Slot:
    """A process of the pool with the case that it runs."""

    def __init__(self, work: Work, scratch: Path) -> None:
        self.work, self.scratch = work, scratch
        self.number: int | None = None
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs, self.work, self.scratch), daemon=True)
        self.process.start()
        theirs.close()
        self.done = 0

    def give(self, number: int) -> None:
        if self.done >= CASES_A_PROCESS:
            self.close()
            self._start()
        self.deadline = time.monotonic() + self.work.limit_s + IMPORT_S * (self.done == 0)
        self.number = number
        self.pipe.send(number)

    def take(self) -> Result:
        assert self.number is not None
        try:
            result: Result = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(10)
            result = Result(self.number, "?", trouble="died", said=f"the process ended: {self.process.exitcode}")
            self._start()
        self.done += 1
        self.number = None
        return result

    def give_up(self) -> Result:
        assert self.number is not None
        self.process.kill()
        self.process.join(10)
        result = Result(self.number, "?", trouble="hang", said=f"no answer in {self.work.limit_s:g} s", seconds=-1)
        self._start()
        self.number = None
        return result

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send(None)
        self.process.join(10)
        if self.process.is_alive():
            self.process.kill()


def run(work: Work, numbers: Sequence[int], scratch: Path, jobs: int) -> Iterator[Result]:
    """The results as they come, of `jobs` processes at most."""
    waiting = list(reversed(numbers))
    slots = [_Slot(work, scratch / str(k)) for k in range(min(jobs, len(numbers)))]
    try:
        while waiting or any(slot.number is not None for slot in slots):
            for slot in slots:
                if slot.number is None and waiting:
                    slot.give(waiting.pop())
            busy = [slot for slot in slots if slot.number is not None]
            ready = wait([slot.pipe for slot in busy], timeout=1.0)
            for slot in busy:
                if slot.pipe in ready:
                    yield slot.take()
                elif time.monotonic() > slot.deadline:
                    yield slot.give_up()
    finally:
        for slot in slots:
            slot.close()
        shutil.rmtree(scratch, ignore_errors=True)
