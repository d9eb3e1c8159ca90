"""The corners of many scans: `calib.find_corners`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path

from calib.corners.batch import CornerBatch, corners_of
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.progress import OnProgress, counted


def find_corners(
    dataset: Dataset | str | Path,
    *,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
    in_flight: int = 64,
    intermediate: bool = True,
    search: Callable[[Path], CornerSearch] | None = None,
) -> CornerBatch:
    """Corners of all poses' scans by pose id, in the dataset's order, without poses that are left out.

    Each job loads its own scan, so no more scans are in memory than jobs run at a time, and uses one BLAS thread
    wherever it runs, so the result is the same to the bit. A scan that cannot be read becomes a failed search with
    `unreadable` set. Where all scans are searched for one jig, the angles between its faces are estimated once from all
    of them (`calib.corners.jig_angles`).

    Args:
        dataset: a dataset with scans, or its folder.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called with (done, total, pose_id) after each scan.
        executor: runs the jobs: threads, processes, Dask's `Client.get_executor()`, any `concurrent.futures.Executor`.
        in_flight: jobs that are with the executor at a time; twice its workers or more.
        intermediate: keep the arrays that are only displayed, some 2 MB for a scan of 200,000 points.
        search: job done with a scan's file, where it is to look for other targets.

    Raises:
        DatasetError: the dataset has no scans.
        CornerError: a process of the executor died.

    >>> import calib
    >>> dataset = calib.load_dataset("sample_data/rb5_jang")
    >>> calib.find_corners(dataset.leave_out(dataset.poses.ids[2:]))
    CornerBatch(rb5_jang: 2 of 2 corners found)
    """
    with counted("corners", "scan", asked=progress, then=on_progress) as tell:
        return corners_of(
            as_dataset(dataset),
            on_progress=tell,
            executor=executor,
            in_flight=in_flight,
            intermediate=intermediate,
            search=search,
        )
