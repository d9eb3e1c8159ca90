"""Processes of this machine, connected by pipes, so that no port is open; where one dies, others take its place.

Whoever could reach a scheduler on a port could have it run code, and on a shared machine everybody reaches 127.0.0.1.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_SHARE = 0.9  # of its part of the memory, beyond which a process is refused more before the system ends any
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Processes(Executor):
    """Executor of `count` processes; one that dies costs what the others were at, too, and all start anew."""

    def __init__(self, count: int, memory_bytes: float | None = None) -> None:
        """Set the memory that one process may take, `memory_bytes`; None for an equal share of the machine's memory."""
        self._count = count
        self._memory_bytes = _SHARE * machine_memory_bytes() / count if memory_bytes is None else memory_bytes
        self._pool = self._new()

    def _new(self) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, spawn, initializer=_begin, initargs=(self._memory_bytes,))

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Future of a call of a module's function with arguments that can be pickled."""
        try:
            return self._pool.submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            self._pool.shutdown(wait=False)
            self._pool = self._new()
            return self._pool.submit(fn, *args, **kwargs)

    @property
    def pids(self) -> list[int]:
        """Process ids of the running workers."""
        return list(self._pool._processes or ())

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once, in the middle of their tasks."""
        for process in list((self._pool._processes or {}).values()):
            process.kill()
        self._pool.shutdown(wait, cancel_futures=True)


def _begin(memory_bytes: float) -> None:
    """What a process does before its first task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all processes; the parent handles it
    os.dup2(2, 1)  # what a task prints goes to stderr, as stdout is for the command's own result
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # before numpy is imported: there is one process per core
    if memory_bytes < float("inf"):
        _bound_memory(int(memory_bytes))


def _bound_memory(most: int) -> None:
    """Refuse this process more memory, as far as the system can: what asks for more gets a MemoryError."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
    except (ImportError, OSError, ValueError):  # Windows, macOS
        return


def machine_memory_bytes() -> float:
    """Memory of this machine or container; infinity where the system does not say."""
    try:
        most = float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")
    try:
        return min(most, float(Path("/sys/fs/cgroup/memory.max").read_text("ascii")))
    except (OSError, ValueError):  # none, or "max"
        return most
