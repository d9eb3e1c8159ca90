"""A time limit for work in a thread: an exception where the work still listens, the end of the process where it may."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

GRACE_S = 20.0  # that work has to end in after it was told


class OutOfTime(BaseException):
    """Raised inside work that takes too long. No Exception, so that nothing on the way takes it for its own."""


@contextmanager
def time_limit(seconds: float, *, end_process: bool) -> Iterator[None]:
    """Raise OutOfTime in this thread after so many seconds.

    It shows between two steps of Python. Work that is stuck in one, as in a file system that does not answer, ends with
    its process, where `end_process` allows that: whoever started the process then counts it as died.
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
        with lock:  # where the exception is on its way it comes before this thread can leave here
            over.set()
