"""The app's single worker thread, which does all work in order.

Viser calls back on 32 threads at once: twenty slider messages arrive shuffled and one button runs beside itself. So a
callback only says what is to be done (`Worker.submit`), and one thread does it: in the order of asking, with the latest
request winning where several have the same key.

Long work is a generator: each `yield` is a place where the worker does what has been asked in the meantime and where
the work can be cancelled. So sixty scans are searched one by one while the user already turns pages.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Hashable
from typing import TypeVar

log = logging.getLogger(__name__)

LongWork = Generator[None, None, None]
Job = Callable[[], "LongWork | None"]
T = TypeVar("T")


class WorkEnded(Exception):
    """Error: work tried to end its thread, as by sys.exit()."""

    def __init__(self, cause: BaseException) -> None:
        super().__init__(f"the work ended with {type(cause).__name__}: {cause}".rstrip(": "))


class Worker:
    """Runner of jobs on one thread; `on_error(key, exception)` is called on that thread for every job that fails."""

    def __init__(self, on_error: Callable[[Hashable, Exception], None]) -> None:
        self._on_error = on_error
        self._changed = threading.Condition()
        self._waiting: OrderedDict[Hashable, Job] = OrderedDict()
        self._long: deque[tuple[Hashable, LongWork]] = deque()  # the first is stepped until it ends
        self._dropped: set[Hashable] = set()  # long work that is to end at its next yield
        self._busy = False
        self._stopping = False
        self._thread = self._started()

    def _started(self) -> threading.Thread:
        thread = threading.Thread(target=self._run, name="inspector", daemon=True)
        thread.start()
        return thread

    def submit(self, key: Hashable, job: Job) -> None:
        """Queue a job. A waiting or long-running job with the same key is dropped.

        A replaced job's place in the queue is lost: the new one is done when its own turn comes. After `stop` nothing
        is accepted, silently, because pages may still be sending.
        """
        with self._changed:
            if self._stopping:
                return
            if not self._thread.is_alive():  # nothing is known that ends it; a page that never reacts would be worse
                log.error("the worker's thread has died; another takes its place")
                self._thread = self._started()
            self._waiting.pop(key, None)
            self._waiting[key] = job
            if any(k == key for k, _ in self._long):
                self._dropped.add(key)
            self._changed.notify_all()

    def cancel(self, key: Hashable) -> bool:
        """Drop the waiting job and end the long work with this key; True where there was any."""
        with self._changed:
            waiting = self._waiting.pop(key, None) is not None
            running = any(k == key for k, _ in self._long)
            if running:
                self._dropped.add(key)
            self._changed.notify_all()
            return waiting or running

    def running(self, key: Hashable) -> bool:
        """Whether a job with this key is waiting, or long work with it is running."""
        with self._changed:
            return key in self._waiting or any(k == key and k not in self._dropped for k, _ in self._long)

    def wait_idle(self, timeout_s: float) -> bool:
        """Block until no job waits or runs; False where the timeout passed first."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._waiting or self._long or self._busy), timeout_s)

    def stop(self, timeout_s: float = 5.0) -> bool:
        """Finish the current step, drop all other jobs and end the thread; True where it ended within the timeout."""
        with self._changed:
            self._stopping = True
            self._waiting.clear()
            self._dropped.update(key for key, _ in self._long)
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    # ---- the thread -------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._long or self._stopping)
                self._busy = True
                ended = [(key, work) for key, work in self._long if key in self._dropped]
                self._long = deque((key, work) for key, work in self._long if key not in self._dropped)
                self._dropped.clear()
                job = self._waiting.popitem(last=False) if self._waiting else None
                stopping = self._stopping
            for key, work in ended:
                self._guarded(key, work.close)  # runs the generator's own `finally`
            if stopping:
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()
                return
            if job is not None:
                self._start(*job)
            else:
                self._step()

    def _start(self, key: Hashable, job: Job) -> None:
        work = self._guarded(key, job)
        if work is not None:
            with self._changed:
                self._long.appendleft((key, work))  # what was asked for last is what the user waits for

    def _step(self) -> None:
        with self._changed:
            if not self._long:
                return
            key, work = self._long[0]
        alive = self._guarded(key, lambda: next(work, StopIteration) is not StopIteration)
        if not alive:
            with self._changed:
                self._long = deque(item for item in self._long if item[1] is not work)

    def _guarded(self, key: Hashable, call: Callable[[], T]) -> T | None:
        try:
            return call()
        except BaseException as error:  # whatever it is, it must not end the thread that does all the work
            try:
                self._on_error(key, error if isinstance(error, Exception) else WorkEnded(error))
            except BaseException:
                log.exception("the error handler failed while it reported %r", error)
            return None
