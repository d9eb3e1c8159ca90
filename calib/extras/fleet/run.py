"""Run of a fleet: datasets below a folder are processed, arms compared over time, and shared causes sought."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from calib.extras.fleet.discovery import Discovered
from calib.extras.fleet.drift import Drift, DriftTask, compare, consecutive, not_compared
from calib.extras.fleet.judge import FleetOptions, Judged, Task, Unchanged, judge, one_line, pair_key
from calib.extras.fleet.kept_results import KeptResults
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Failure, Row
from calib.extras.fleet.shared_causes import shared_causes
from calib.parallel import futures_as_completed
from calib.progress import OnProgress, counted

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Workers:
    """Executor of a fleet's tasks, and number of tasks at the same time."""

    executor: Executor | None = None  # None: this thread
    count: int = 1
    own_processes: bool = False  # whether its processes do nothing else, and may be ended


def run_fleet(
    found: Discovered,
    results: Path,
    workers: Workers = Workers(),
    options: FleetOptions = FleetOptions(),
    *,
    fresh: bool = False,
    progress: bool = False,
    on_progress: OnProgress | None = None,
) -> Fleet:
    """Result of all datasets found below a folder: their rows, changes of arms, and shared causes.

    Args:
        found: the datasets, by `discover`.
        results: folder to which each result is written as soon as it is there; a later run takes over the results whose
            files, options and versions are the same, so that a stopped run continues.
        workers: executor of the tasks; its workers read the files by their absolute paths.
        options: how each dataset is judged.
        fresh: delete the results of earlier runs first.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called as (done, total, path) after each dataset, then after each comparison of two.

    A dataset that fails is tried once more, after all others, and then listed with its reason.

    Raises DatasetError where another run keeps its results in the same folder.
    """
    folder = found.folder.resolve()
    kept = KeptResults(results)
    with kept.held(), counted("datasets", "dataset", asked=progress, then=on_progress) as tell:
        if fresh:
            kept.forget()
        failures = list(found.failures)
        judged: list[str] = []
        taken_over = 0
        total = len(found.datasets)
        for outcome in _judged_twice(found.datasets, folder, kept, workers, options):
            if isinstance(outcome, Failure):
                failures.append(outcome)
            else:
                taken_over += isinstance(outcome, Unchanged)
                judged.append(outcome.path)
            if tell is not None:
                tell(len(judged) + len(failures) - len(found.failures), total, outcome.path)
        rows, keys, seconds = _rows(sorted(judged), kept)
        pairs = consecutive(rows)
        drifts = tuple(_drifts(pairs, keys, folder, kept, workers, options, tell))
    failures.sort(key=lambda failure: failure.path)
    return Fleet(found.folder, rows, tuple(failures), drifts, shared_causes(rows), taken_over, seconds)


def _rows(paths: Sequence[str], kept: KeptResults) -> tuple[tuple[Row, ...], dict[str, str], float]:
    """Rows of all datasets, their keys by path, and the sum of their durations, s."""
    rows, keys, seconds = [], {}, 0.0
    for path in paths:
        judged = kept.judged(path)
        assert judged is not None
        rows.append(judged.row)
        keys[path] = judged.key
        seconds += judged.seconds
    return tuple(rows), keys, seconds


@dataclass(frozen=True)
class _Stored:
    path: str


def _judged_twice(
    paths: Sequence[str], folder: Path, kept: KeptResults, workers: Workers, options: FleetOptions
) -> Iterator[_Stored | Unchanged | Failure]:
    """Result of each dataset once known and stored; a failure is reported only after a second try.

    A process that dies takes along what the others are at: those that are lost are tried one by one, and last.
    """
    lost: list[str] = []
    failed: list[str] = []

    def tasks(of: Iterable[str]) -> Iterator[Task]:
        for path in of:
            before = kept.judged(path)
            known = "" if before is None else before.key
            yield Task(str(folder), path, options, known, workers.own_processes)

    def settled(of: Sequence[str], attempt: int, by: Workers) -> Iterator[_Stored | Unchanged | Failure]:
        for index, future in _done(judge, tasks(of), by):
            is_lost = _is_lost(future)
            outcome = Failure(of[index], _lost(future, options)) if is_lost else future.result()
            if isinstance(outcome, Judged):
                kept.store(outcome)
                yield _Stored(outcome.row.path)
            elif isinstance(outcome, Failure) and attempt == 1:
                (lost if is_lost else failed).append(outcome.path)
            else:
                yield replace(outcome, attempts=attempt) if isinstance(outcome, Failure) else outcome

    yield from settled(paths, 1, workers)
    yield from settled(sorted(failed), 2, workers)
    yield from settled(sorted(lost), 2, replace(workers, count=1))


def _done(
    function: Callable[[Asked], Answer], items: Iterable[Asked], workers: Workers
) -> Iterator[tuple[int, Future[Answer]]]:
    """Futures as they complete, submitted only as many at a time as can run."""
    executor = _Here() if workers.executor is None else workers.executor
    return futures_as_completed(function, items, executor, workers.count)


class _Here(Executor):
    """Executor that runs each task at once, in the thread that submits it."""

    def submit(self, fn: Callable[..., Answer], /, *args: object, **kwargs: object) -> Future[Answer]:
        future: Future[Answer] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def _is_lost(future: Future[Answer]) -> bool:
    return future.cancelled() or future.exception() is not None


def _lost(future: Future[Answer], options: FleetOptions) -> str:
    """Reason why a worker gave no result."""
    error = CancelledError() if future.cancelled() else future.exception()
    if isinstance(error, CancelledError):
        return "the cluster cancelled it"
    if isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker":  # ours, or Dask's
        return f"the process that was at it died: killed, out of memory, or stuck for more than {options.limit_s:g} s"
    return one_line(f"the worker failed ({type(error).__name__}: {error})")


def _drifts(
    pairs: Sequence[tuple[Row, Row]],
    keys: dict[str, str],
    folder: Path,
    kept: KeptResults,
    workers: Workers,
    options: FleetOptions,
    on_progress: OnProgress | None,
) -> list[Drift]:
    """Changes between the two datasets of each pair, in the pairs' order."""

    def task(pair: tuple[Row, Row]) -> DriftTask:
        base, later = (kept.judged(row.path) for row in pair)
        assert base is not None
        assert later is not None
        return DriftTask(
            str(folder), base.row.path, later.row.path, base.row.missing, base.corners, later.corners, options,
            workers.own_processes,
        )  # fmt: skip

    pair_keys = [pair_key(keys[base.path], keys[later.path]) for base, later in pairs]
    found = [kept.drift(base.path, later.path, key) for (base, later), key in zip(pairs, pair_keys, strict=True)]
    for last_attempt in (False, True):  # those whose worker was lost once more
        waiting = [k for k, drift in enumerate(found) if drift is None]
        at_once = replace(workers, count=1) if last_attempt else workers
        for index, future in _done(compare, (task(pairs[k]) for k in waiting), at_once):
            k = waiting[index]
            if on_progress is not None:
                on_progress(sum(drift is not None for drift in found), len(found), pairs[k][1].path)
            if not _is_lost(future):
                found[k] = drift = future.result()
                if drift.settled:
                    kept.store_drift(drift, pair_keys[k])
            elif last_attempt:
                found[k] = not_compared(task(pairs[k]), _lost(future, options))
    return [drift for drift in found if drift is not None]
