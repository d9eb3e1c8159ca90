"""Executor of local processes, each connected by an anonymous socket pair, so that no port is open.

Whoever could reach a scheduler on a port could have it run code, and on a shared machine everybody reaches 127.0.0.1. A
process that dies loses the task that it was at, and no other: the next task starts a new one.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_LOOK_S = 0.2  # between two checks of a process's memory
_SHARE = 0.9  # of its part of the memory, beyond which a process is ended before the system ends any
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class WorkerDied(Exception):
    """Error: a worker process ended without a result."""


class Processes(Executor):
    """Executor of `count` processes, each with one task at a time."""

    def __init__(self, count: int, memory_bytes: float | None = None) -> None:
        """Set the memory limit of one process, `memory_bytes`; None for an equal share of the machine's memory."""
        self._memory_bytes = _SHARE * machine_memory_bytes() / count if memory_bytes is None else memory_bytes
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="processes")
        self._places: SimpleQueue[_Worker | None] = SimpleQueue()
        for _ in range(count):
            self._places.put(None)
        self._alive: set[_Worker] = set()
        self._lock, self._over = threading.Lock(), threading.Event()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Future of a call of a module's function with arguments that can be pickled."""
        return self._threads.submit(self._ask, (fn, args, kwargs))

    @property
    def pids(self) -> list[int]:
        """Process ids of the running workers."""
        with self._lock:
            return [worker.pid for worker in self._alive]

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once, in the middle of their tasks."""
        with self._lock:
            self._over.set()
            for worker in self._alive:
                worker.kill()
        self._threads.shutdown(wait=wait, cancel_futures=True)

    def _ask(self, task: tuple[Any, ...]) -> Any:
        worker = self._places.get()
        try:
            with self._lock:
                if self._over.is_set():
                    raise WorkerDied
                if worker is None:
                    worker = _Worker()
                    self._alive.add(worker)
            done, answer = worker.answer(task, self._memory_bytes)
        except BaseException:
            with self._lock:
                self._alive -= {worker}
            if worker is not None:
                worker.kill()
            worker = None
            raise
        finally:
            self._places.put(worker)
        if done:
            return answer
        raise answer


class _Worker:
    """A worker process, with the main program's end of the connection."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        return self._process.pid or 0

    def answer(self, task: tuple[Any, ...], memory_bytes: float) -> tuple[bool, Any]:
        """Pair (True, result) of a task, or (False, exception). Raises WorkerDied."""
        try:
            self._connection.send(task)
            while not self._connection.poll(_LOOK_S):
                if resident_bytes(self.pid) > memory_bytes:
                    raise WorkerDied
            answer: tuple[bool, Any] = self._connection.recv()
        except (EOFError, OSError):
            raise WorkerDied from None
        return answer

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()


def _serve(connection: Connection) -> None:
    """Main loop of a worker process: runs tasks until the connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all processes; the parent handles it
    os.dup2(2, 1)  # what a task prints goes to stderr, as stdout is for the command's own result
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # before numpy is imported: there is one process per core
    while True:
        try:
            function, args, kwargs = connection.recv()
        except EOFError:
            return
        try:
            answer = (True, function(*args, **kwargs))
        except Exception as error:
            answer = (False, error)
        try:
            connection.send(answer)
        except OSError:
            return
        except Exception as error:  # what cannot be pickled
            connection.send((False, RuntimeError(f"{type(error).__name__}: {error}")))


def resident_bytes(pid: int) -> int:
    """Resident memory of a process; 0 where the system does not say."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text("ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


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
