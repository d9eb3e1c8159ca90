"""Worker processes of a fleet run: on this machine, or on a Dask cluster that is running already.

Dask is imported where a cluster is named. Whoever reaches a cluster's scheduler can have its workers run code: with TLS
(`tls://head:8786`) it asks for the certificates that Dask's own settings name, without it has no password.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from calib.errors import CalibError
from calib.extras.fleet.judge import versions
from calib.extras.fleet.processes import Processes
from calib.extras.fleet.run import Workers

CONNECT_S = 10.0  # longest time that a scheduler may take to answer
_PURE = False  # a pure task would not run again: Dask answers a second try with the failure of the first


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """Executor of `count` processes on this machine, which no other user can reach."""
    with Processes(count) as executor:
        yield Workers(executor, count, own_processes=True)


@contextmanager
def cluster_workers(address: str, folder: Path) -> Iterator[Workers]:
    """Executor of the workers of a Dask cluster that is running already.

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
    """Versions of a worker's programs, and whether the worker can read the folder; runs on the worker."""
    return {"versions": versions(), "folder": Path(folder).is_dir()}


def _distributed() -> ModuleType:
    try:
        import distributed
    except ImportError:
        raise CalibError(
            "--scheduler needs Dask: pip install 'robot-calibration-inspector[fleet]' (./run fleet does it)"
        ) from None
    return distributed
