"""Work on other threads, waited for in steps."""

from __future__ import annotations

import threading
from collections.abc import Generator, Iterator
from typing import TypeVar

import pytest

from inspector.server.background import Background

T = TypeVar("T")
WAIT_S = 30.0


@pytest.fixture
def background() -> Iterator[Background]:
    made = Background("test")
    yield made
    made.close()


def result_of(work: Generator[None, None, T]) -> T:
    while True:
        try:
            next(work)
        except StopIteration as end:
            result: T = end.value
            return result


def test_the_result_comes_once_it_is_there(background: Background) -> None:
    gate = threading.Event()

    def compute() -> str:
        assert gate.wait(WAIT_S)
        return threading.current_thread().name

    work = background.run(compute)
    next(work)  # not there yet: the caller's thread is free meanwhile
    gate.set()
    assert str(result_of(work)).startswith("inspector-test")


def test_what_is_not_wanted_any_more_is_let_go_at_the_next_step(background: Background) -> None:
    gate, begun, second = threading.Event(), threading.Event(), threading.Event()

    def compute() -> None:
        begun.set()
        assert gate.wait(WAIT_S)

    wanted = [True]
    first = background.run(compute, lambda: wanted[0])
    waiting = background.run(second.set, lambda: wanted[0])
    next(first)
    next(waiting)  # the one thread is busy
    assert begun.wait(WAIT_S)
    wanted[0] = False
    assert result_of(first) is None
    assert result_of(waiting) is None
    gate.set()
    background.submit(lambda: None).result(WAIT_S)
    assert not second.is_set()  # it had not begun, and never did


def test_an_error_comes_out_where_the_result_is_waited_for(background: Background) -> None:
    def compute() -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        result_of(background.run(compute))
