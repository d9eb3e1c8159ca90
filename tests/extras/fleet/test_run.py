"""A fleet's run: every dataset once, failures alone, results kept, the same whoever works and in which order."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from calib.errors import CalibError
from calib.extras.fleet import judge as judging
from calib.extras.fleet import workers as fleet_workers
from calib.extras.fleet.discovery import discover
from calib.extras.fleet.result import Fleet
from calib.extras.fleet.run import _settled, run_fleet
from calib.extras.fleet.table import table_bytes
from calib.extras.fleet.workers import Workers, cluster_workers, local_workers
from tests.support.fleet import ENOUGH, write_cell


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three datasets, one of them deeper, and one that cannot be read."""
    for seed, name in enumerate(("a", "b", "deep/er/c")):
        write_cell(tmp_path / "fleet" / name, seed, serial=f"S{seed}")
    broken = write_cell(tmp_path / "fleet" / "broken", 7)
    (broken / "poses.csv").write_text("pose,role\n")
    return tmp_path / "fleet"


def run(folder: Path, workers: Workers = Workers(), **more: object) -> Fleet:
    results = folder.parent / "fleet.results"
    return run_fleet(discover(folder), results, workers, **more)  # type: ignore[arg-type]


class Lossy(Executor):
    """Loses the first answers of some datasets, as a cluster does whose workers die."""

    def __init__(self, losses: dict[str, int]) -> None:
        self.losses, self.asked = dict(losses), []  # type: ignore[var-annotated]

    def submit(self, fn: Callable[..., object], /, *args: object, **kwargs: object) -> Future[object]:  # type: ignore[override]
        (task,) = args
        path = getattr(task, "path", "")
        self.asked.append(path)
        future: Future[object] = Future()
        if self.losses.get(path, 0) > 0:
            self.losses[path] -= 1
            future.set_exception(type("KilledWorker", (Exception,), {})("lost"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_every_dataset_has_a_row_and_one_that_cannot_be_read_costs_only_itself(folder: Path) -> None:
    steps: list[tuple[int, int, str]] = []
    fleet = run(folder, on_progress=lambda *step: steps.append(step))
    assert [row.path for row in fleet.rows] == ["a", "b", "deep/er/c"]
    assert [row.serial for row in fleet.rows] == ["S0", "S1", "S2"]
    assert all("not tried" in row.words and not row.verdict for row in fleet.rows)
    (failure,) = fleet.failures
    assert failure.path == "broken"
    assert "poses.csv" in failure.reason
    assert "\n" not in failure.reason
    assert [step[:2] for step in steps] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert "Without a result:" in fleet.summary()


@pytest.mark.parametrize("file", ["dataset.toml", "robot.toml"])
def test_a_dataset_that_would_fill_the_memory_costs_only_itself(folder: Path, file: str) -> None:
    bomb = write_cell(folder / "bomb", 9) / file
    bomb.write_text(bomb.read_text() + "a" + ".a" * 20_000 + " = 1\n")  # 40 kB, of which a parser makes 1.5 GB
    fleet = run(folder)
    assert [row.path for row in fleet.rows] == ["a", "b", "deep/er/c"]
    assert [failure.path for failure in fleet.failures] == ["bomb", "broken"]
    assert "a key of more than 20 parts" in fleet.failures[0].reason


def test_a_later_run_takes_over_what_has_not_changed(folder: Path) -> None:
    first = run(folder)
    (folder / "a" / "points.csv").write_text((folder / "a" / "points.csv").read_text() + "\n")
    (folder / "broken" / "poses.csv").write_bytes((folder / "b" / "poses.csv").read_bytes())
    kept = next(p for p in (folder.parent / "fleet.results").glob("*.json") if '"deep/er/c"' in p.read_text())
    kept.write_text(kept.read_text()[:200])  # half a file, as of a disk that was full
    again = run(folder)
    assert again.taken_over == 1  # b; a has another file, c's result is damaged
    assert again.rows[0] == first.rows[0]
    assert len(again.rows) == 4
    assert run(folder).taken_over == 4


def test_an_interrupted_run_keeps_what_it_has(folder: Path) -> None:
    def stop(done: int, total: int, path: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(folder, on_progress=stop)
    assert run(folder).taken_over == 2


def test_a_lost_answer_is_asked_for_once_more_after_all_others(folder: Path) -> None:
    workers = Lossy({"a": 1, "b": 2})
    fleet = run(folder, Workers(workers.submit))
    assert [row.path for row in fleet.rows] == ["a", "deep/er/c"]
    assert [f.path for f in fleet.failures] == ["b", "broken"]
    assert "died" in fleet.failures[0].reason
    assert workers.asked == ["a", "b", "broken", "deep/er/c", "a", "b", "broken"]


def test_an_exception_costs_only_its_dataset(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = judging.load_dataset

    def odd(path: Path) -> object:
        if path.name == "b":
            raise ValueError("two\nlines")
        return load(path)

    monkeypatch.setattr(judging, "load_dataset", odd)
    fleet = run(folder)
    assert [row.path for row in fleet.rows] == ["a", "deep/er/c"]
    assert fleet.failures[0].reason == "ValueError: two lines"


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_same_table_whatever_the_order(folder: Path, suffix: str) -> None:
    """Threads that end in any order; each writes what it found of its dataset alone."""
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    one = run(folder)
    with ThreadPoolExecutor(3) as executor:
        other = run_fleet(discover(folder), folder.parent / "other.results", Workers(executor.submit, 3))
    assert table_bytes(one.rows, suffix) == table_bytes(other.rows, suffix)
    assert one.failures == other.failures


# ---- on processes, and on Dask ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three datasets with enough poses for a diagnosis."""
    folder = tmp_path_factory.mktemp("real") / "fleet"
    for seed in range(3):
        write_cell(folder / f"c{seed}", seed, ENOUGH, serial=f"S{seed}")
    return folder


@pytest.fixture(scope="module")
def processes() -> Iterator[Workers]:
    with local_workers(2, 600.0) as workers:
        yield workers


@pytest.mark.thorough
@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing_and_the_table_is_the_same_to_the_bit(
    real_folder: Path, processes: Workers
) -> None:
    alone = run(real_folder)
    killed = threading.Event()

    def kill(done: int, total: int, path: str) -> None:
        if not killed.is_set():
            killed.set()
            multiprocessing.active_children()[0].kill()

    results = real_folder.parent / "processes.results"
    fleet = run_fleet(discover(real_folder), results, processes, on_progress=kill)
    assert killed.is_set()
    assert fleet.failures == ()
    assert table_bytes(fleet.rows, ".csv") == table_bytes(alone.rows, ".csv")
    assert run_fleet(discover(real_folder), results, processes).taken_over == 3


@pytest.mark.slow
def test_a_process_that_dies_or_takes_too_long_costs_its_task_alone() -> None:
    with local_workers(2, 2.0) as workers:
        late, dead, well = (workers.submit(*call) for call in ((time.sleep, 60), (os._exit, 3), (pow, 2, 3)))
        assert well.result() == 8
        assert "took longer" in _settled(late)
        assert "died" in _settled(dead)
        assert workers.submit(os.getpid).result() != os.getpid()
        for child in multiprocessing.active_children():  # none of which is at a task
            child.kill()
        lost = workers.submit(pow, 2, 3)
        assert lost.exception(30.0) is not None or lost.result() == 8
        assert workers.submit(pow, 2, 4).result() == 16
        workers.submit(time.sleep, 600)  # the end waits for nothing


@pytest.fixture
def dask() -> Iterator[Any]:
    """A cluster that runs already."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as made:
        yield made


@pytest.mark.thorough
def test_a_cluster_that_runs_already_is_taken_by_its_address(
    folder: Path, dask: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = dask.scheduler_address
    with cluster_workers(address, folder, 60.0) as workers:
        assert workers.count == 2
        assert [row.path for row in run(folder, workers).rows] == ["a", "b", "deep/er/c"]
    monkeypatch.setattr(fleet_workers, "versions", lambda: {"program": "another"})
    with pytest.raises(CalibError, match="another version"), cluster_workers(address, folder, 60.0):
        pass
    monkeypatch.undo()
    with pytest.raises(CalibError, match="does not see"), cluster_workers(address, folder / "nowhere", 60.0):
        pass
    monkeypatch.setattr(fleet_workers, "CONNECT_S", 0.2)
    with pytest.raises(CalibError, match="no Dask scheduler answers"), cluster_workers("127.0.0.1:9", folder, 60.0):
        pass
