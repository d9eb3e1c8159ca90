"""Progress of long work on stderr, and the process pool for the work."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager

from calib.progress import OnProgress, OnStep, counted, staged

MIN_SCANS_FOR_PROCESSES = 12  # below this, starting further interpreters takes longer than it saves


def stages() -> AbstractContextManager[OnStep | None]:
    """Callback that shows the current step in one line of the terminal; None where stderr is no terminal."""
    return staged(asked=sys.stderr.isatty())


def cores() -> int:
    """Number of CPU cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def processes(scans: int, wanted: int | None = None) -> Iterator[Executor | None]:
    """Executor with the requested number of processes, by default one per core for MIN_SCANS_FOR_PROCESSES or more."""
    count = min(scans, cores() if wanted is None else wanted)
    if count < 2 or (wanted is None and scans < MIN_SCANS_FOR_PROCESSES):
        yield None
        return
    # Not fork: Open3D and BLAS have threads by then, which a forked child would not have.
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as executor:
        with _ignored_interrupts():
            for _ in range(count):
                executor.submit(os.getpid)  # starts a process
        yield executor


@contextmanager
def _ignored_interrupts() -> Iterator[None]:
    """Context in which new processes ignore Ctrl-C, which a terminal sends to all; this process ends them."""
    if threading.current_thread() is not threading.main_thread():  # no other may set signals
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def progress(what: str, unit: str = "scan") -> AbstractContextManager[OnProgress | None]:
    """Callback that moves a progress bar on stderr; None where that is no terminal."""
    return counted(what, unit, asked=sys.stderr.isatty())
