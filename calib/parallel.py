"""A function applied to many items on any `concurrent.futures.Executor`: threads, processes, a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_as_completed(
    function: Callable[[Item], Result], items: Iterable[Item], executor: Executor | None, in_flight: int
) -> Iterator[tuple[int, Result]]:
    """Pairs (index of the item, function(item)), each as soon as it is ready; in order where there is no executor.

    At most `in_flight` items are with the executor at a time, running, waiting or done and not yet taken: neither the
    queue nor what a cluster keeps for the caller grows with the number of items. Waiting items are cancelled when the
    caller stops early or an item raises.
    """
    if executor is None:
        for index, item in enumerate(items):
            yield index, function(item)
        return
    for index, future in futures_as_completed(function, items, executor.submit, in_flight):
        yield index, future.result()


def futures_as_completed(
    function: Callable[[Item], Result], items: Iterable[Item], submit: Callable[..., Future[Result]], in_flight: int
) -> Iterator[tuple[int, Future[Result]]]:
    """Pairs (index of the item, its future) as each completes; a future may hold an exception, and the others continue.

    `submit` is that of an executor; `in_flight` bounds them as in `map_as_completed`.
    """
    coming = enumerate(items)
    index_of: dict[Future[Result], int] = {}
    try:
        while True:
            for index, item in islice(coming, in_flight - len(index_of)):
                index_of[submit(function, item)] = index
            if not index_of:
                return
            for future in wait(index_of, return_when=FIRST_COMPLETED).done:
                yield index_of.pop(future), future
    finally:
        for future in index_of:
            future.cancel()
