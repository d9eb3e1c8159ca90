"""Corners on any executor: the same to the bit, a few scans at a time, and nothing left running after an early end."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import find_corners
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Scanner
from calib.errors import CornerError, DatasetError
from calib.jig import Jig
from calib.parallel import map_as_completed
from calib.scans.scan import write_scan
from inspector.cli.progress import processes
from tests.support.scan_scene import make_scene

SPAWN = multiprocessing.get_context("spawn")
COUNT = 5


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Stand-in with the attributes that find_corners reads of a dataset; the last scan is missing, one before cut."""
    folder = tmp_path_factory.mktemp("scans")
    names = [f"p{seed}.ply" for seed in range(COUNT)]
    for seed, name in enumerate(names[:-2]):
        write_scan(folder / name, make_scene(np.random.default_rng(seed), 5_000, field_mm=110).scan)
    (folder / names[-2]).write_bytes((folder / names[0]).read_bytes()[:5000])
    return SimpleNamespace(
        name="d",
        poses=SimpleNamespace(ids=tuple(name.removesuffix(".ply") for name in names)),
        jig=Jig(),
        scanner=Scanner(scan_sigma_mm=0.02),
        left_out=(),
        scan_path=lambda i: folder / names[i],
    )


@pytest.fixture(scope="module")
def alone(dataset: Any) -> dict[str, CornerSearch]:
    found = find_corners(dataset)
    assert [search.corner is not None for search in found.values()] == [True] * (COUNT - 2) + [False] * 2
    return found


def test_a_scan_that_cannot_be_read_is_told_beside_the_others(alone: dict[str, CornerSearch]) -> None:
    assert [search.unreadable for search in alone.values()] == [False] * (COUNT - 2) + [True] * 2
    assert "truncated" in alone["p3"].failure


def test_a_dataset_without_scans_is_told(dataset: Any) -> None:
    without = SimpleNamespace(**{**vars(dataset), "scan_path": lambda i: None})
    with pytest.raises(DatasetError, match="no scans"):
        find_corners(without)  # type: ignore[arg-type]


def bits(search: CornerSearch) -> tuple[Any, ...]:
    """Everything in a search, for a comparison to the last bit, except the time."""
    arrays = [search.voxel_points_mm, search.voxel_normals, search.sets.rejected_by]
    if search.corner is not None:
        arrays += [search.corner.xyz_mm, search.corner.covariance_mm2]
        arrays += [face.inliers for face in search.corner.faces] + [f.normal for f in search.corner.faces]
    return search.failure, search.chosen, len(search.groups), *(a.tobytes() for a in arrays)


@contextmanager
def dask() -> Iterator[Executor]:
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client, client.get_executor() as executor:
        yield executor


EXECUTORS = {
    "threads": lambda: ThreadPoolExecutor(3),
    "processes": lambda: ProcessPoolExecutor(2, mp_context=SPAWN),
    "dask": dask,
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[] if kind == "threads" else pytest.mark.thorough) for kind in EXECUTORS]
)
def test_the_same_to_the_bit_on_any_executor(dataset: Any, alone: dict[str, CornerSearch], kind: str) -> None:
    steps: list[tuple[int, int, str]] = []
    with EXECUTORS[kind]() as executor:
        found = find_corners(dataset, executor=executor, in_flight=3, on_progress=lambda *step: steps.append(step))
    assert list(found) == list(alone)
    for pose_id, search in found.items():
        assert bits(search) == bits(alone[pose_id])
    assert [step[:2] for step in steps] == [(i + 1, COUNT) for i in range(COUNT)]
    assert {step[2] for step in steps} == set(alone)


@pytest.mark.slow
def test_what_is_only_looked_at_may_stay_away(dataset: Any, alone: dict[str, CornerSearch]) -> None:
    with ProcessPoolExecutor(1, mp_context=SPAWN) as executor:
        brief = find_corners(dataset, executor=executor, intermediate=False)
    for pose_id, search in alone.items():
        assert brief[pose_id].filter_counts() == search.filter_counts()
        said = [s.summary() for s in (brief[pose_id], search)]
        assert said[0] == said[1]
        if search.corner is not None:
            assert brief[pose_id].corner.xyz_mm.tobytes() == search.corner.xyz_mm.tobytes()  # type: ignore[union-attr]
            assert len(pickle.dumps(brief[pose_id])) < 0.2 * len(pickle.dumps(search))


def _die(path: Path, **_: Any) -> None:
    os._exit(3)


@pytest.mark.slow
def test_a_process_that_dies_is_told(dataset: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.corners.batch.search_file", _die)
    with ProcessPoolExecutor(1, mp_context=SPAWN) as executor, pytest.raises(CornerError, match="fewer proc"):
        find_corners(dataset, executor=executor)


class Counting(Executor):
    """Executor of threads that counts jobs submitted, and neither finished nor cancelled."""

    def __init__(self, workers: int) -> None:
        self.threads = ThreadPoolExecutor(workers)
        self.futures: list[Future[Any]] = []
        self.most = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.futures.append(self.threads.submit(fn, *args, **kwargs))
        self.most = max(self.most, sum(not future.done() for future in self.futures))
        return self.futures[-1]


@pytest.mark.slow
@settings(deadline=None, max_examples=40)
@given(count=st.integers(0, 30), in_flight=st.integers(1, 9), workers=st.integers(1, 4), seed=st.integers(0, 99))
def test_each_item_once_and_no_more_at_a_time_than_allowed(count: int, in_flight: int, workers: int, seed: int) -> None:
    naps = np.random.default_rng(seed).uniform(0, 2e-3, count)

    def square(i: int) -> int:
        time.sleep(naps[i])
        return i * i

    executor = Counting(workers)
    with executor.threads:
        found = list(map_as_completed(square, range(count), executor, in_flight))
    assert sorted(found) == [(i, i * i) for i in range(count)]
    assert executor.most <= in_flight
    assert list(map_as_completed(square, range(count), None, in_flight)) == [(i, i * i) for i in range(count)]


@pytest.mark.parametrize("how", ["the caller stops", "an item raises"])
def test_an_early_end_cancels_what_waits(how: str) -> None:
    started: list[int] = []
    is_over = threading.Event()

    def work(i: int) -> int:
        started.append(i)
        if how == "an item raises" and i == 1:
            raise ValueError(i)
        if i > 0:
            assert is_over.wait(60.0)  # the one thread is held until all that waits is cancelled
        return i

    executor = Counting(1)
    with executor.threads:
        running = map_as_completed(work, range(1000), executor, 50)
        try:
            if how == "an item raises":
                with pytest.raises(ValueError, match="1"):
                    list(running)
            else:
                assert next(running) == (0, 0)
                running.close()  # type: ignore[attr-defined]
        finally:
            is_over.set()
    assert len(started) <= 3
    assert sum(future.cancelled() for future in executor.futures) == len(executor.futures) - len(started)
    assert 50 <= len(executor.futures) <= 51


def test_processes_leave_an_interrupt_to_the_one_that_started_them() -> None:
    before = signal.getsignal(signal.SIGINT)
    with processes(10, 2) as executor:
        assert signal.getsignal(signal.SIGINT) is before
        heard = [executor.submit(signal.getsignal, signal.SIGINT) for _ in range(4)]
        assert {one.result() for one in heard} == {signal.SIG_IGN}
