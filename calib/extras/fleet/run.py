"""Run of a fleet: datasets below a folder are processed, and shared causes sought."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from pathlib import Path

import msgspec

from calib.blas_threads import one_blas_thread
from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.errors import CalibError, DatasetError
from calib.extras.fleet.discovery import Discovered
from calib.extras.fleet.judge import Judged, Task, judge, one_line
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Failure
from calib.extras.fleet.shared_causes import shared_causes
from calib.extras.fleet.workers import Workers
from calib.parallel import futures_as_completed
from calib.progress import OnProgress

Answer = Judged | str | None  # what `judge` gives, or why it gives nothing
TRIES = 2


def run_fleet(
    found: Discovered, results: Path, workers: Workers = Workers(), on_progress: OnProgress | None = None
) -> Fleet:
    """Result of all datasets found below a folder: their rows, and the causes that arms share.

    Args:
        found: the datasets, by `discover`.
        results: folder to which each result is written as soon as it is there; a later run takes over the results whose
            files and versions are the same, so that a stopped run continues.
        workers: who does the tasks, and reads the files by their absolute paths.
        on_progress: called as (done, total, path) after each dataset.

    A dataset that fails is tried once more, after all others, and then listed with its reason.

    Raises DatasetError where the folder of results cannot be written.
    """
    folder, paths = str(found.folder.resolve()), found.datasets
    try:
        results.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DatasetError(
            f"{results}: cannot be written ({error.strerror or error}); name another place for the table"
        ) from None
    places = [results / f"{hashlib.sha256(path.encode()).hexdigest()[:32]}.json" for path in paths]
    failures, of_path, taken_over = list(found.failures), dict[str, Judged](), 0
    before = list(map(_kept, places))
    tasks = [Task(folder, path, "" if of is None else of.key) for path, of in zip(paths, before, strict=True)]
    for done, (k, answer) in enumerate(_answers(tasks, workers), start=1):
        if isinstance(answer, str):
            failures.append(Failure(paths[k], answer))
        elif (judged := answer or before[k]) is not None:
            write_bytes_atomically(places[k], msgspec.json.encode(judged))
            of_path[paths[k]] = judged
            taken_over += answer is None
        if on_progress is not None:
            on_progress(done, len(paths), paths[k])
    rows = tuple(of_path[path].row for path in sorted(of_path))
    return Fleet(
        found.folder,
        rows,
        tuple(sorted(failures, key=lambda failure: failure.path)),
        shared_causes(rows),
        taken_over,
        sum(each.seconds for each in of_path.values()),
    )


def _answers(tasks: Sequence[Task], workers: Workers) -> Iterator[tuple[int, Answer]]:
    """Number and answer of each task as it is known; where there is none after a second try, why.

    No more tasks are submitted at a time than can run.
    """
    waiting: Sequence[int] = range(len(tasks))
    for attempt in range(1, TRIES + 1):
        failed = []
        of_try = (tasks[k] for k in waiting)
        for index, future in futures_as_completed(answer_to, of_try, workers.submit, workers.count):
            answer = _settled(future)
            if isinstance(answer, str) and attempt < TRIES:
                failed.append(waiting[index])
            else:
                yield waiting[index], answer
        waiting = sorted(failed)


def _kept(place: Path) -> Judged | None:
    """Result that an earlier run kept in a file; None where there is none, or the file is damaged."""
    try:
        return msgspec.json.decode(place.read_bytes(), type=Judged)
    except (OSError, msgspec.MsgspecError):
        return None


def answer_to(task: Task) -> Answer:
    """Result of a task, on one thread; where it raises, one line that says why. Runs on the worker."""
    try:
        with one_blas_thread():
            return judge(task)
    except CalibError as error:
        return one_line(str(error))
    except Exception as error:
        return one_line(f"{type(error).__name__}: {error}")


def _settled(future: Future[Answer]) -> Answer:
    """Answer of a worker, or why it gave none."""
    try:
        return future.result()
    except (TimeoutError, CancelledError):
        return "took longer than a dataset may (--timeout), or the cluster cancelled it"
    except Exception as error:
        if isinstance(error, BrokenExecutor) or type(error).__name__ in ("ProcessExpired", "KilledWorker"):
            return "the process that was at it died: killed, or out of memory"
        return one_line(f"the worker failed ({type(error).__name__}: {error})")
