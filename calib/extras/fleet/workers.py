"""Workers of a fleet run: processes of this machine (pebble), or a Dask cluster that is running already.

The processes are connected by pipes: who reaches a scheduler on a port can have it run code, and on a shared machine
everybody reaches 127.0.0.1. That holds for a cluster's scheduler, too: with TLS (`tls://head:8786`) it asks for the
certificates that Dask's own settings name, without it has no password.

A process begins with this module, so it imports nothing slow.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import platform
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import Timer
from typing import Any

import calib
from calib.errors import CalibError

CONNECT_S = 10.0  # longest time that a scheduler may take to answer


@dataclass(frozen=True)
class Workers:
    """Who does a fleet's tasks: the `submit` of an executor, and number of tasks at the same time."""

    submit: Callable[..., Future[Any]] = field(default_factory=lambda: ThreadPoolExecutor(1).submit)  # this process
    count: int = 1


@contextmanager
def local_workers(count: int, limit_s: float) -> Iterator[Workers]:
    """Processes on this machine, `count` of them; whatever dies or takes too long is replaced."""
    import pebble

    spawn = multiprocessing.get_context("spawn")
    pools: list[Any] = []

    def submit(fn: Callable[..., Any], *args: Any) -> Future[Any]:
        if not pools or not pools[-1].active:  # a process that dies before it has a task ends its pool
            pools.append(pebble.ProcessPool(count, context=spawn, initializer=_begin))
        future: Future[Any] = pools[-1].schedule(fn, args, timeout=limit_s)
        return future

    try:
        yield Workers(submit, count)
    finally:
        for pool in pools:
            pool.stop()  # in the middle of what was not waited for
            pool.join()


def _begin() -> None:
    """What a process does before its first task."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all processes; the parent handles it
    os.dup2(2, 1)  # what a task prints goes to stderr, as stdout is for the command's own result


@contextmanager
def cluster_workers(address: str, folder: Path, limit_s: float) -> Iterator[Workers]:
    """Workers of a Dask cluster that is running already; a task that takes too long is cancelled.

    Raises CalibError where there is none at the address, where it has no workers, and where one of them has another
    version of this program or does not see the folder.
    """
    import distributed

    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        said = " ".join(str(error).split())
        raise CalibError(f"--scheduler {address}: no Dask scheduler answers there ({said})") from None
    with client:
        threads = client.nthreads()
        if not threads:
            raise CalibError(f"--scheduler {address}: the cluster has no workers; start some")
        place = str(folder.resolve())
        for worker, fault in client.run(fault_of_worker, place, versions(), on_error="return").items():
            if fault:  # or the exception that it ended with
                raise CalibError(f"--scheduler {address}: worker {worker}: {fault}")
        of_dask = client.get_executor(pure=False)  # a pure task would not run again

        def submit(fn: Callable[..., Any], *args: Any) -> Future[Any]:
            future: Future[Any] = of_dask.submit(fn, *args)
            timer = Timer(limit_s, future.cancel)
            timer.daemon = True
            timer.start()
            future.add_done_callback(lambda _: timer.cancel())
            return future

        yield Workers(submit, sum(threads.values()))


def fault_of_worker(folder: str, needed: dict[str, str]) -> str:
    """Reason why a worker cannot judge the datasets of a folder alike; "" for none. Runs on the worker."""
    if versions() != needed:
        return (
            "has another version of this program, Python, numpy, scipy or pandas; install the same there, or the "
            "figures would differ"
        )
    return "" if Path(folder).is_dir() else f"does not see {folder}; share it"


@cache
def versions() -> dict[str, str]:
    """Versions of Python and the libraries, and a hash of this program's files."""
    digest = hashlib.sha256()
    root = Path(calib.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    libraries = {name: version(name) for name in ("numpy", "scipy", "pandas")}
    return {"program": digest.hexdigest(), "python": platform.python_version(), **libraries}
