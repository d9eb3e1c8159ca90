"""Time limit for work in a thread: an exception in the running Python code, else the end of the process."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

GRACE_S = 20.0  # for the work to end after the exception


class OutOfTime(BaseException):
    """Exception raised inside work that takes too long; a BaseException, so that `except Exception` misses it."""


@contextmanager
def time_limit(seconds: float, *, end_process: bool) -> Iterator[None]:
    """Context that raises OutOfTime in this thread after a number of seconds.

    The exception is raised between two steps of Python. Work that is stuck in one, such as a file system that does not
    answer, ends with its process where `end_process` allows that: its parent then counts the process as died.
    """
    lock, over, worker = threading.Lock(), threading.Event(), threading.get_ident()

    def watch() -> None:
        if over.wait(seconds):
            return
        with lock:
            if over.is_set():
                return
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(worker), ctypes.py_object(OutOfTime))
        if not over.wait(GRACE_S) and end_process:
            os._exit(1)

    threading.Thread(target=watch, name="time limit", daemon=True).start()
    try:
        yield
    finally:
        with lock:  # an exception on its way arrives before this thread can leave the block
            over.set()
