"""Downloads: files made in the background and sent only to the page of the request."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import viser

from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.errors import CalibError, DatasetError
from calib.models.exported_table import ExportedTable, exported_table
from calib.plugins import load
from calib.rendering import html
from calib.rendering.blocks import Block
from calib.robot_formats.calibrated_file import kept_template
from calib.served_process import within_limits
from inspector.app.page.page_state import PageState
from inspector.export import csv_files as exports
from inspector.markup.parts import elements
from inspector.markup.parts.palette import BAD
from inspector.panels.downloads import (
    CONTRIBUTED,
    CORRECTED,
    ITEMS,
    MODEL,
    OWN_FILE,
    POINTS,
    REDUNDANCY,
    REPORT,
    RESIDUALS,
    SESSION,
    TABLE,
    DownloadsPanel,
)
from inspector.server.background import Background
from inspector.server.uploads import Upload, Uploads
from inspector.server.viser_server import InspectorServer
from inspector.server.worker import LongWork, Worker
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from inspector.session.session_file import Shown, session_text
from inspector.session.view import View


@dataclass(frozen=True)
class Asked:
    """Request for a file: the session, view and options at the time of the button's press."""

    view: View
    view_name: str
    root: Path

    @property
    def session(self) -> Session:
        return self.view.session

    @property
    def calibration(self) -> Calibration:
        if self.session.calibration is None:
            raise CalibError(f"dataset {self.session.dataset.name}: it is not calibrated yet")
        return self.session.calibration


class Downloads:
    """Controller that makes the files of the session on show."""

    def __init__(
        self,
        server: InspectorServer,
        state: PageState,
        view_name: Callable[[], str],
        worker: Worker,
        panel: DownloadsPanel,
        root: Path,
        uploads: Uploads,
    ) -> None:
        self._server, self._state, self._view_name, self._worker = server, state, view_name, worker
        self._panel, self._root, self._uploads = panel, root, uploads
        self._files = Background("files")

    def close(self) -> None:
        """End the thread."""
        self._files.close()

    def take(self, what: str, client: viser.ClientHandle) -> None:
        """Make one of `panels.downloads.ITEMS` for a page; only the last of several presses counts."""
        if what in ITEMS:
            self._worker.submit(("take", what, client.client_id), lambda: self._take(what, client))

    def correct(self, upload: Upload) -> None:
        """Correct a file of targets that a page brought, and send it back."""
        self._worker.submit(("correct", upload.client), lambda: self._correct(upload))

    def _correct(self, upload: Upload) -> LongWork:
        asked = Asked(self._state.now, self._view_name(), self._root)
        self._panel.tell_corrected(elements.note(f"Correcting {upload.name} …"))
        try:
            with self._uploads.writing(upload.client):
                made = yield from self._files.run(lambda: corrected(upload, asked))
        except CalibError as error:
            self._panel.tell_corrected(elements.alert(str(error).replace(f"{upload.path.parent}/", ""), colour=BAD))
            return
        finally:
            upload.path.unlink(missing_ok=True)
        assert made is not None
        content, blocks = made
        self._panel.tell_corrected(html.panel(blocks))
        client = self._server.get_clients().get(upload.client)
        if client is not None:
            client.send_file_download(f"corrected_{upload.name}", content, save_immediately=True)

    def _take(self, what: str, client: viser.ClientHandle) -> LongWork:
        asked = Asked(self._state.now, self._view_name(), self._root)
        self._panel.say(f"Making: {what} …")
        try:
            made = yield from self._files.run(lambda: _made(what, asked))
        finally:
            self._panel.say("")
        assert made is not None
        name, content = made
        client.send_file_download(exports.file_name(asked.session.dataset.name, name), content, save_immediately=True)


def corrected(upload: Upload, asked: Asked) -> tuple[bytes, list[Block]]:
    """An uploaded file of targets corrected by the model on show, and what is told of it. Raises CalibError."""
    kind = CORRECTED.get(Path(upload.name).suffix.lower())
    if kind is None:
        raise CalibError(f"{upload.name}: is no file of targets; known are {', '.join(sorted(CORRECTED))}")
    implausible = implausibility_reason(asked.calibration)
    if implausible:
        raise CalibError(f"{upload.name}: not corrected, as the model is not fit for it: {implausible}")
    robot = asked.session.dataset.robot
    with tempfile.TemporaryDirectory(dir=upload.path.parent) as folder:
        path = Path(upload.path).rename(Path(folder) / upload.name)
        try:
            targets = within_limits(upload.name, load(kind.read), path, robot)
        except CalibError as error:
            raise CalibError(str(error).replace(f"{folder}/", "")) from None
    made: tuple[bytes, list[Block]] = load(kind.correct)(targets, robot, asked.calibration.fitted_model)
    return made


def _made(what: str, asked: Asked) -> tuple[str, bytes]:
    """Name and bytes of a file; what a plug-in brings is made by its own function."""
    if what in CONTRIBUTED:
        made: tuple[str, bytes] = load(CONTRIBUTED[what].make)(asked)
        return made
    if what == OWN_FILE:
        return _own_file(asked)
    name, text = TEXTS[what]
    return name, text(asked).encode()


def _report(asked: Asked) -> str:
    from inspector.report.report import report_html

    session = asked.session
    assert asked.calibration is not None
    if session.screening is None:
        session = sessions.with_screening(session)
    return report_html(session, now=datetime.now())


def _table(asked: Asked) -> ExportedTable:
    asked.calibration.require_improvement()
    table = exported_table(asked.calibration, asked.session.links_alone)
    table.require_improvement()
    return table


def _own_file(asked: Asked) -> tuple[str, bytes]:
    template = kept_template(asked.session.dataset.folder)
    if template is None:
        raise CalibError(f"dataset {asked.session.dataset.name}: no URDF or YAML of the robot was kept at the import")
    table = _table(asked)
    return f"calibrated{template.suffix}", within_limits(template.name, table.in_template, template).content


def _model(asked: Asked) -> str:
    asked.calibration.require_improvement()
    return asked.calibration.fitted_model.to_json()


def _session(asked: Asked) -> str:
    view = asked.view
    arrows = view.arrows if view.arrows_chosen else None
    shown = Shown(view.pose_id, asked.view_name, arrows=arrows, factor=view.factor)
    return session_text(asked.session, beside=asked.root, shown=shown)


def _points(asked: Asked) -> str:
    measured = asked.session.measured
    if measured.points is None or not len(measured.points):
        raise DatasetError(f"dataset {measured.name}: no corner is found yet")
    return exports.corners_csv(measured)


def _redundancy(asked: Asked) -> str:
    known = asked.session.redundancy or measuring.with_redundancy(asked.session).redundancy
    assert known is not None
    return exports.redundancy_csv(known)


TEXTS: dict[str, tuple[str, Callable[[Asked], str]]] = {
    REPORT: ("report.html", _report),
    TABLE: ("robot.toml", lambda asked: _table(asked).to_toml()),
    MODEL: ("model.json", _model),
    SESSION: ("session.json", _session),
    RESIDUALS: ("residuals.csv", lambda asked: exports.residuals_csv(asked.calibration)),
    POINTS: ("points.csv", _points),
    REDUNDANCY: ("redundancy.csv", _redundancy),
}
"""Name of each file of text, and how it is made."""
