"""Run of a fleet: datasets below a folder are processed, arms compared over time, and shared causes sought."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from calib.blas_threads import one_blas_thread
from calib.errors import CalibError
from calib.extras.fleet.discovery import Discovered
from calib.extras.fleet.drift import Drift, DriftTask, compare, consecutive
from calib.extras.fleet.judge import FleetOptions, Task, judge, one_line, pair_key
from calib.extras.fleet.kept_results import KeptResults
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Failure
from calib.extras.fleet.shared_causes import shared_causes
from calib.extras.fleet.workers import Workers
from calib.parallel import futures_as_completed
from calib.progress import OnProgress, counted

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
TRIES = 2


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

    Raises DatasetError where the folder of results cannot be written.
    """
    folder = str(found.folder.resolve())
    kept = KeptResults(results)
    kept.begin(fresh=fresh)
    with counted("datasets", "dataset", asked=progress, then=on_progress) as tell:
        paths = found.datasets
        failures, judged, taken_over = list(found.failures), [], 0

        def task(k: int) -> Task:
            before = kept.judged(paths[k])
            return Task(folder, paths[k], options, "" if before is None else before.key)

        for done, (k, answer) in enumerate(_answers(judge, len(paths), task, workers), start=1):
            if isinstance(answer, str):
                failures.append(Failure(paths[k], answer, TRIES))
            else:
                judged.append(paths[k])
                taken_over += answer is None
                if answer is not None:
                    kept.store(answer)
            if tell is not None:
                tell(done, len(paths), paths[k])
        of_path = {path: replace(kept.surely(path), corners=None) for path in sorted(judged)}
        rows = tuple(each.row for each in of_path.values())
        pairs = [(of_path[base.path], of_path[later.path]) for base, later in consecutive(rows)]
        keys = [pair_key(base.key, later.key) for base, later in pairs]
        drifts = [kept.drift(key) for key in keys]
        waiting = [k for k, drift in enumerate(drifts) if drift is None]

        def comparison(k: int) -> DriftTask:
            base, later = (each.row.path for each in pairs[waiting[k]])
            of_base, of_later = (kept.surely(path).corners for path in (base, later))
            return DriftTask(folder, base, later, pairs[waiting[k]][0].row.missing, of_base, of_later, options)

        for done, (k, found_drift) in enumerate(_answers(compare, len(waiting), comparison, workers), start=1):
            base, later = (each.row.path for each in pairs[waiting[k]])
            if isinstance(found_drift, str):
                drifts[waiting[k]] = Drift(base, later, "", (), None, None, reason=found_drift, settled=False)
            else:
                drifts[waiting[k]] = found_drift
                kept.store_drift(found_drift, keys[waiting[k]])
            if tell is not None:
                tell(len(pairs) - len(waiting) + done, len(pairs), later)
    failures.sort(key=lambda failure: failure.path)
    settled = tuple(drift for drift in drifts if drift is not None)
    seconds = sum(each.seconds for each in of_path.values())
    return Fleet(found.folder, rows, tuple(failures), settled, shared_causes(rows), taken_over, seconds)


def _answers(
    function: Callable[[Asked], Answer], count: int, task: Callable[[int], Asked], workers: Workers
) -> Iterator[tuple[int, Answer | str]]:
    """Number and answer of each of so many tasks as it is known; where there is none after a second try, why.

    No more tasks are made and submitted at a time than can run.
    """
    executor: Executor = workers.executor or ThreadPoolExecutor(1)
    waiting = list(range(count))
    for attempt in range(1, TRIES + 1):
        tasks = (task(k) for k in waiting)
        failed = []
        for index, future in futures_as_completed(partial(answer_to, function), tasks, executor, workers.count):
            answer = _settled(future)
            if isinstance(answer, str) and attempt < TRIES:
                failed.append(waiting[index])
            else:
                yield waiting[index], answer
        waiting = sorted(failed)


def answer_to(function: Callable[[Asked], Answer], task: Asked) -> Answer | str:
    """What a function answers to a task, on one thread; where it raises, one line that says why. Runs on the worker."""
    try:
        with one_blas_thread():
            return function(task)
    except CalibError as error:
        return one_line(str(error))
    except Exception as error:
        return one_line(f"{type(error).__name__}: {error}")


def _settled(future: Future[Answer | str]) -> Answer | str:
    """Answer of a worker, or why it gave none."""
    try:
        return future.result()
    except (TimeoutError, CancelledError):
        return "took longer than a dataset may (--timeout), or the cluster cancelled it"
    except Exception as error:
        if isinstance(error, BrokenExecutor) or type(error).__name__ in ("ProcessExpired", "KilledWorker"):
            return "the process that was at it died: killed, or out of memory"
        return one_line(f"the worker failed ({type(error).__name__}: {error})")
