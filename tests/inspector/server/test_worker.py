"""The worker's laws: one thread, in order, latest wins, nothing lost, cancel and stop are clean."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator

import pytest

from inspector.server.worker import LongWork, WorkEnded, Worker

WAIT_S = 20.0


class Errors(list[tuple[Hashable, Exception]]):
    """What the worker reported."""

    def __call__(self, key: Hashable, error: Exception) -> None:
        self.append((key, error))


@pytest.fixture
def errors() -> Errors:
    return Errors()


@pytest.fixture
def worker(errors: Errors) -> Iterator[Worker]:
    started = Worker(errors)
    yield started
    assert started.stop(WAIT_S)


class Gate:
    """A job that holds the worker until it is opened, so that what is asked meanwhile has to wait."""

    def __init__(self, worker: Worker) -> None:
        self.entered, self.opened = threading.Event(), threading.Event()
        worker.submit(("gate", id(self)), self)
        assert self.entered.wait(WAIT_S)

    def __call__(self) -> None:
        self.entered.set()
        assert self.opened.wait(WAIT_S)


def test_jobs_run_in_the_order_of_asking_on_one_thread(worker: Worker) -> None:
    done: list[int] = []
    threads: set[int] = set()

    def job(i: int) -> None:
        done.append(i)
        threads.add(threading.get_ident())

    gate = Gate(worker)
    for i in range(50):
        worker.submit(i, lambda i=i: job(i))  # type: ignore[misc]
    gate.opened.set()
    assert worker.wait_idle(WAIT_S)
    assert done == list(range(50))
    assert len(threads) == 1
    assert threading.get_ident() not in threads


def test_latest_wins_per_key_whoever_asks(worker: Worker) -> None:
    done: list[tuple[str, int]] = []
    gate = Gate(worker)
    askers = [
        threading.Thread(target=lambda k=k: [worker.submit(k, lambda i=i: done.append((k, i))) for i in range(100)])  # type: ignore[misc]
        for k in ("a", "b")
    ]
    for asker in askers:
        asker.start()
    for asker in askers:
        asker.join()
    gate.opened.set()
    assert worker.wait_idle(WAIT_S)
    assert sorted(done) == [("a", 99), ("b", 99)]


def test_one_button_never_runs_beside_itself(worker: Worker) -> None:
    inside, most = 0, 0

    def press() -> None:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        threading.Event().wait(0.002)
        inside -= 1

    for _ in range(50):
        worker.submit(object(), press)
    assert worker.wait_idle(WAIT_S)
    assert most == 1


def test_an_exception_is_reported_and_the_worker_lives_on(worker: Worker, errors: Errors) -> None:
    def bad() -> None:
        raise ValueError("no planes")

    def bad_later() -> LongWork:
        yield
        raise ValueError("later")

    done: list[str] = []
    worker.submit("bad", bad)
    worker.submit("bad later", bad_later)
    worker.submit("good", lambda: done.append("good"))
    assert worker.wait_idle(WAIT_S)
    assert [(key, str(error)) for key, error in errors] == [("bad", "no planes"), ("bad later", "later")]
    assert done == ["good"]
    assert not worker.running("bad later")


def test_a_failing_error_handler_does_not_kill_the_worker() -> None:
    def handler(key: Hashable, error: Exception) -> None:
        raise RuntimeError("handler")

    worker = Worker(handler)
    done: list[int] = []
    worker.submit("bad", lambda: 1 / 0)  # type: ignore[arg-type, return-value]
    worker.submit("good", lambda: done.append(1))
    assert worker.wait_idle(WAIT_S)
    assert done == [1]
    assert worker.stop(WAIT_S)


def test_what_is_asked_meanwhile_runs_between_the_steps_of_long_work(worker: Worker) -> None:
    order: list[object] = []
    asked = threading.Event()

    def long() -> LongWork:
        for i in range(4):
            order.append(i)
            if i == 1:
                worker.submit("page", lambda: order.append("page"))
                asked.set()
            yield

    worker.submit("long", long)
    assert asked.wait(WAIT_S)
    assert worker.wait_idle(WAIT_S)
    assert order == [0, 1, "page", 2, 3]


def test_cancel_ends_long_work_at_its_next_yield_and_cleans_up(worker: Worker) -> None:
    steps: list[int] = []
    third, closed = threading.Event(), threading.Event()

    def long() -> LongWork:
        try:
            for i in range(10_000):
                steps.append(i)
                if i == 3:
                    third.set()
                    assert cancelled.wait(WAIT_S)
                yield
        finally:
            closed.set()

    cancelled = threading.Event()
    worker.submit("long", long)
    assert third.wait(WAIT_S)
    assert worker.running("long")
    assert worker.cancel("long")
    assert not worker.running("long")
    cancelled.set()
    assert closed.wait(WAIT_S)
    assert worker.wait_idle(WAIT_S)
    assert steps == [0, 1, 2, 3]
    assert not worker.cancel("long")


def test_cancel_forgets_a_job_that_still_waits(worker: Worker) -> None:
    done: list[int] = []
    gate = Gate(worker)
    worker.submit("later", lambda: done.append(1))
    assert worker.cancel("later")
    gate.opened.set()
    assert worker.wait_idle(WAIT_S)
    assert done == []


def test_the_same_key_replaces_running_long_work(worker: Worker) -> None:
    seen: list[str] = []
    started = threading.Event()

    def long(name: str) -> LongWork:
        try:
            while True:
                started.set()
                yield
                if name == "second":
                    return
        finally:
            seen.append(f"{name} ended")

    worker.submit("open", lambda: long("first"))
    assert started.wait(WAIT_S)
    worker.submit("open", lambda: long("second"))
    assert worker.wait_idle(WAIT_S)
    assert seen == ["first ended", "second ended"]


def test_stop_drops_what_waits_closes_what_runs_and_ends_the_thread(errors: Errors) -> None:
    worker = Worker(errors)
    closed, started = threading.Event(), threading.Event()
    done: list[int] = []

    def endless() -> LongWork:
        try:
            while True:
                started.set()
                yield
        finally:
            closed.set()

    worker.submit("endless", endless)
    assert started.wait(WAIT_S)
    gate = Gate(worker)
    worker.submit("waiting", lambda: done.append(1))
    stopper = threading.Thread(target=worker.stop, args=(WAIT_S,))
    stopper.start()
    gate.opened.set()
    stopper.join(WAIT_S)
    assert closed.is_set()
    assert worker.stop(WAIT_S)
    worker.submit("late", lambda: done.append(2))  # a page that has not noticed yet
    assert worker.wait_idle(WAIT_S)
    assert (done, list(errors)) == ([], [])


@pytest.mark.parametrize("ending", [SystemExit(3), KeyboardInterrupt(), GeneratorExit("x"), BaseException("y")])
def test_work_that_would_end_the_thread_is_an_error_like_others(
    worker: Worker, errors: Errors, ending: BaseException
) -> None:
    def ends() -> None:
        raise ending

    def ends_later() -> LongWork:
        yield
        raise ending

    done = threading.Event()
    worker.submit("ends", ends)
    worker.submit("ends later", ends_later)
    worker.submit("next", done.set)
    assert worker.wait_idle(WAIT_S)
    assert done.is_set()
    assert [key for key, _ in errors] == ["ends", "ends later"]
    assert all(isinstance(error, WorkEnded) for _, error in errors)
    assert type(ending).__name__ in str(errors[0][1])


def test_a_thread_that_died_is_replaced(errors: Errors, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as broken:
        broken.setattr(Worker, "_run", lambda self: None)
        worker = Worker(errors)
        worker._thread.join(WAIT_S)
    done = threading.Event()
    worker.submit("job", done.set)
    assert done.wait(WAIT_S)
    assert worker.stop(WAIT_S)
