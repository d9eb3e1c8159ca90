"""Server of the app on a dataset folder or a folder of datasets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.dataset.files.folder import find_datasets
from calib.errors import CalibError
from calib.served_process import warm_up
from inspector.app.app import App
from inspector.app.page.dataset_list import have_scans, listed_folders
from inspector.server.arrived_files import looked_through
from inspector.server.viser_server import LOOPBACK, start_server
from inspector.session.dropped import read_session
from inspector.session.measuring import open_session
from inspector.session.reopening import Opening


@contextmanager
def serving(
    path: Path,
    *,
    host: str = LOOPBACK,
    port: int = 8080,
    effects_file: Path | None = None,
    saved: Opening | None = None,
    data: Path | None = None,
) -> Iterator[App]:
    """Context manager that serves the app on a dataset folder or a folder of datasets.

    `data`: a folder, made when it is needed, to which pages may import datasets; those in it are listed, too.

    Raises:
        DatasetError: no dataset at `path`.
        CalibError: no effects file there; one with an error in it is told on the page, which takes a better one later.
        ServerError: the address cannot be served on.
    """
    warm_up(*(reader.__module__ for reader in (have_scans, open_session, looked_through, read_session)))
    # Those with scans first: a page that opens on one shows the whole way, from scan to model.
    if data is not None and data.exists() and not data.is_dir():
        raise CalibError(f"--data {data}: is no folder; name one for the datasets that pages import")
    find_datasets(path)
    found = listed_folders(path, data)
    scanned = dict(zip(found, have_scans(found), strict=True))
    folders = [found[place] for place in sorted(found, key=lambda place: not scanned[place])]
    if effects_file is not None and not effects_file.is_file():
        raise CalibError(f"{effects_file}: no such effects file")
    server = start_server(host, port, label="Calibration inspector")
    app = App(server, folders, effects_file, saved, path, data)
    try:
        yield app
    finally:
        app.close()
