"""Run of a fleet: datasets below a folder are processed, arms compared over time, and shared causes sought."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from calib.blas_threads import one_blas_thread
from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.errors import CalibError, DatasetError
from calib.extras.fleet.discovery import Discovered
from calib.extras.fleet.drift import Drift, DriftTask, compare, consecutive
from calib.extras.fleet.judge import Judged, Task, judge, one_line
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Failure
from calib.extras.fleet.shared_causes import shared_causes
from calib.extras.fleet.workers import Workers
from calib.parallel import futures_as_completed
from calib.progress import OnProgress

Kept = TypeVar("Kept", Judged, Drift)
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
TRIES = 2


@dataclass(frozen=True)
class KeptResults:
    """Folder with the results of a run so far; damaged files count as missing."""

    folder: Path

    def begin(self) -> None:
        """Make the folder. Raises DatasetError where it cannot."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetError(
                f"{self.folder}: cannot be written ({error.strerror or error}); name another place for the table"
            ) from None

    def write(self, name: str, result: Judged | Drift) -> None:
        """Keep a result under a name, replacing an earlier one."""
        write_bytes_atomically(self._place(name), msgspec.json.encode(result, enc_hook=np.ndarray.tolist))

    def read(self, name: str, kind: type[Kept]) -> Kept | None:
        """The result that is kept under a name; None where there is none."""
        try:
            return msgspec.json.decode(self._place(name).read_bytes(), type=kind, dec_hook=lambda _, of: np.array(of))
        except (OSError, msgspec.MsgspecError):
            return None

    def _place(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.json"


def run_fleet(
    found: Discovered, results: Path, workers: Workers = Workers(), on_progress: OnProgress | None = None
) -> Fleet:
    """Result of all datasets found below a folder: their rows, changes of arms, and shared causes.

    Args:
        found: the datasets, by `discover`.
        results: folder to which each result is written as soon as it is there; a later run takes over the results whose
            files and versions are the same, so that a stopped run continues.
        workers: executor of the tasks; its workers read the files by their absolute paths.
        on_progress: called as (done, total, path) after each dataset, then after each comparison of two.

    A dataset that fails is tried once more, after all others, and then listed with its reason.

    Raises DatasetError where the folder of results cannot be written.
    """
    folder, paths, kept = str(found.folder.resolve()), found.datasets, KeptResults(results)
    tell: OnProgress = on_progress or (lambda *_: None)
    kept.begin()
    failures, of_path, taken_over = list(found.failures), dict[str, Judged](), 0
    before = [kept.read(path, Judged) for path in paths]
    tasks = [Task(folder, path, "" if of is None else of.key) for path, of in zip(paths, before, strict=True)]
    for done, (k, answer) in enumerate(_answers(judge, tasks, workers), start=1):
        if isinstance(answer, str):
            failures.append(Failure(paths[k], answer))
        elif (judged := answer or before[k]) is not None:
            kept.write(paths[k], judged)
            of_path[paths[k]] = judged
            taken_over += answer is None
        tell(done, len(paths), paths[k])
    rows = tuple(of_path[path].row for path in sorted(of_path))
    pairs = [DriftTask(folder, of_path[a.path], of_path[b.path]) for a, b in consecutive(rows)]
    drifts = {pair.key: drift for pair in pairs if (drift := kept.read(pair.key, Drift)) is not None}
    waiting = [pair for pair in pairs if pair.key not in drifts]
    for k, told in _answers(compare, waiting, workers):
        key, base, later = waiting[k].key, waiting[k].base.row.path, waiting[k].later.row.path
        if isinstance(told, str):
            drifts[key] = Drift(base, later, reason=told)
        else:
            drifts[key] = told
            kept.write(key, told)
        tell(len(drifts), len(pairs), later)
    return Fleet(
        found.folder,
        rows,
        tuple(sorted(failures, key=lambda failure: failure.path)),
        tuple(drifts[pair.key] for pair in pairs),
        shared_causes(rows),
        taken_over,
        sum(each.seconds for each in of_path.values()),
    )


def _answers(
    function: Callable[[Asked], Answer], tasks: Sequence[Asked], workers: Workers
) -> Iterator[tuple[int, Answer | str]]:
    """Number and answer of each task as it is known; where there is none after a second try, why.

    No more tasks are submitted at a time than can run.
    """
    waiting: Sequence[int] = range(len(tasks))
    for attempt in range(1, TRIES + 1):
        failed = []
        of_try = (tasks[k] for k in waiting)
        for index, future in futures_as_completed(
            partial(answer_to, function), of_try, workers.executor, workers.count
        ):
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
