"""Processes of this machine: what one does, or how it ends, spoils no other task for good."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor

import pytest

from calib.extras.fleet.processes import Processes

pytestmark = pytest.mark.slow  # processes that start


@pytest.fixture
def two() -> Iterator[Processes]:
    with Processes(2) as made:
        yield made


def test_results_and_exceptions_come_back(two: Processes) -> None:
    futures = [two.submit(pow, k, 2) for k in range(20)]
    assert [future.result() for future in futures] == [k**2 for k in range(20)]
    assert len(two.pids) <= 2
    with pytest.raises(ZeroDivisionError):
        two.submit(divmod, 1, 0).result()
    with pytest.raises(TypeError, match="pickle"):
        two.submit(threading.Lock).result()
    assert two.submit(os.getpid).result() != os.getpid()


def test_where_a_process_ends_others_take_its_place(two: Processes) -> None:
    with pytest.raises(BrokenExecutor):
        two.submit(os._exit, 3).result()
    assert [two.submit(pow, k, 2).result() for k in range(6)] == [k**2 for k in range(6)]


def test_one_that_asks_for_too_much_memory_is_refused_it() -> None:
    with Processes(1, memory_bytes=3e9) as one:
        with pytest.raises(MemoryError):
            one.submit(eval, "b'x' * 4_000_000_000").result()
        assert one.submit(pow, 2, 3).result() == 8


def test_the_end_waits_for_nothing() -> None:
    with Processes(2) as made:
        futures = [made.submit(time.sleep, 600) for _ in range(4)]
        while not made.pids:
            time.sleep(0.01)
    assert all(future.done() for future in futures)
