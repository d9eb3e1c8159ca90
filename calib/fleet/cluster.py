"""Dask workers for a fleet: processes of this machine, or a cluster that runs already. Dask is imported when asked."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from calib.errors import CalibError
from calib.fleet.judge import versions
from calib.fleet.run import Workers

LOOPBACK = "127.0.0.1"
CONNECT_S = 10.0  # that a scheduler may take to answer
_SETTINGS = {
    # A worker that dies takes its task along once; `run` tries it again after all others.
    "distributed.scheduler.allowed-failures": 0,
    # A task that waits at a busy worker would die with it.
    "distributed.scheduler.worker-saturation": 1.0,
    # No task is looked at afterwards, so its history need not grow.
    "distributed.admin.low-level-log-length": 100,
    # Nobody looks at a page of Dask's: its server would listen, on a port that a second run wants too.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}

_PURE = False  # of a submission: Dask would answer a second try with the failure of the first


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """As many processes of this machine, one thread each, which listen to this machine alone.

    Raises CalibError where Dask is not installed.
    """
    distributed = _distributed()
    import dask

    with tempfile.TemporaryDirectory(prefix="fleet-") as space, dask.config.set(_SETTINGS):
        cluster = distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            local_directory=space,
            silence_logs=logging.CRITICAL,
            preload=["calib.fleet.worker_start"],
        )
        with cluster, distributed.Client(cluster) as client:
            yield Workers(client.get_executor(pure=_PURE), count, own_processes=True)


@contextmanager
def cluster_workers(address: str, folder: Path) -> Iterator[Workers]:
    """The workers of a cluster that runs already.

    Raises CalibError where there is none at the address, where it has no workers, and where one of them has another
    version of this program or does not see the folder.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        said = " ".join(str(error).split())
        raise CalibError(f"--scheduler {address}: no Dask scheduler answers there ({said})") from None
    with client:
        threads = client.nthreads()
        if not threads:
            raise CalibError(f"--scheduler {address}: the cluster has no workers; start some")
        place = str(folder.resolve())
        for worker, seen in client.run(seen_by_worker, place, on_error="return").items():
            if isinstance(seen, BaseException):
                raise CalibError(
                    f"--scheduler {address}: worker {worker} cannot run this program ({type(seen).__name__}: {seen}); "
                    "install the same version there"
                )
            if seen["versions"] != versions():
                raise CalibError(
                    f"--scheduler {address}: worker {worker} has another version of this program, Python, numpy, scipy "
                    "or pandas; install the same there, or the figures would differ"
                )
            if not seen["folder"]:
                raise CalibError(f"--scheduler {address}: worker {worker} does not see {place}; share it")
        yield Workers(client.get_executor(pure=_PURE), sum(threads.values()))


def seen_by_worker(folder: str) -> dict[str, object]:
    """Asked of each worker: its versions, and whether the folder is there."""
    return {"versions": versions(), "folder": Path(folder).is_dir()}


def _distributed() -> ModuleType:
    try:
        import distributed
    except ImportError:
        raise CalibError(
            "fleet needs Dask: pip install 'robot-calibration-inspector[fleet]' (./run fleet does it)"
        ) from None
    return distributed
