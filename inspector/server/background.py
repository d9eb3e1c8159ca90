"""Threads for long work, so that the app's own thread can answer other requests meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TypeVar

T = TypeVar("T")
TURN_S = 0.02  # how long one look at work in the background takes; the app's thread does nothing else in it


class Background:
    """Pool of threads for work that takes seconds."""

    def __init__(self, name: str, threads: int = 1) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix=f"inspector-{name}")

    def close(self) -> None:
        """Drop the work that has not begun, without waiting for running work."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def submit(self, compute: Callable[[], T]) -> Future[T]:
        """Start a computation as soon as a thread is free."""
        return self._pool.submit(compute)

    def run(
        self, compute: Callable[[], T], wanted: Callable[[], bool] = lambda: True
    ) -> Generator[None, None, T | None]:
        """Long work that ends with the result of `compute`, or with None as soon as `wanted` is false."""
        future = self.submit(compute)
        try:
            return (yield from until_done(future, wanted))
        finally:
            future.cancel()


def until_done(future: Future[T], wanted: Callable[[], bool]) -> Generator[None, None, T | None]:
    """Long work (`worker.LongWork`) that waits for a future; it ends with None as soon as `wanted` is false."""
    while not future.done():
        wait([future], TURN_S)
        yield
        if not wanted():
            return None
    return future.result()
