"""Processes of this machine: what one does, or how it ends, is the affair of its task alone."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator

import pytest

from calib.extras.fleet.processes import Processes, WorkerDied

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
    with pytest.raises(RuntimeError, match="pickle"):
        two.submit(threading.Lock).result()
    assert two.submit(os.getpid).result() != os.getpid()


def test_a_process_that_ends_costs_its_task_alone(two: Processes) -> None:
    ended, others = two.submit(os._exit, 3), [two.submit(pow, k, 2) for k in range(6)]
    with pytest.raises(WorkerDied):
        ended.result()
    assert [future.result() for future in others] == [k**2 for k in range(6)]


def test_one_that_takes_too_much_memory_is_ended() -> None:
    with Processes(1, memory_bytes=300e6) as one:
        large = one.submit(eval, "(b'x' * 600_000_000, __import__('time').sleep(20))")
        with pytest.raises(WorkerDied):
            large.result()
        assert one.submit(pow, 2, 3).result() == 8


def test_the_end_waits_for_nothing() -> None:
    with Processes(2) as made:
        futures = [made.submit(time.sleep, 600) for _ in range(4)]
        while not made.pids:
            time.sleep(0.01)
    assert all(future.done() for future in futures)
