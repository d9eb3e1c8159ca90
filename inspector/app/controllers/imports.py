"""Imports of uploaded files: recognition, plan, correction, writing. Runs on the worker's thread, except requests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import viser

from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import require_free
from calib.dataset_import.columns import Meaning
from calib.dataset_import.import_dataset import copy_dataset, write_plan
from calib.dataset_import.plan import ImportPlan, ImportSources, PlannedColumn
from calib.dataset_import.typed_values import typed_length_mm, typed_point_mm, typed_size
from calib.dataset_import.user_files import UserFiles
from calib.errors import CalibError
from calib.robot_formats.robot_file import ReadOptions
from calib.robot_formats.tables import CONVENTIONS
from calib.served_process import within_limits
from inspector.panels.your_data import (
    CHOOSE,
    EDGE,
    MASS,
    SAME,
    SIGMA,
    TOOL,
    Offer,
    OwnDataButton,
    YourDataWindow,
    all_meanings,
    explain,
)
from inspector.server.arrived_files import add_file, looked_through, robots_of
from inspector.server.background import Background
from inspector.server.uploads import Upload, Uploads, answer, plain_name
from inspector.server.viser_server import InspectorServer, guard_gui
from inspector.server.worker import LongWork, Worker
from inspector.session.dropped import dataset_needed, dataset_of_session, is_session_file, read_session
from inspector.session.session_file import Saved


@dataclass
class _Import:
    """State of one page's import."""

    client: int
    window: YourDataWindow
    folder: Path
    files: UserFiles | None = None
    plan: ImportPlan | None = None
    ready: Dataset | None = None  # a dataset's folder among the files, where it can be opened
    session: Saved | None = None  # a session on that dataset
    session_words: str = ""
    wrong: tuple[str, ...] = ()  # typed values that cannot be read
    choice: ImportSources = field(default_factory=ImportSources)
    suggested: str = ""
    tips: tuple[str, ...] = ()
    plans: int = 0  # begun so far


class Imports:
    """The imports of all pages, each in its own window."""

    def __init__(
        self,
        server: InspectorServer,
        folder: Path | None,
        button: OwnDataButton,
        worker: Worker,
        *,
        on_made: Callable[[Path, Saved | None], None],
        on_session: Callable[[Saved], bool],
    ) -> None:
        """`folder`: where datasets are written, None for nowhere.

        on_made: called with each new dataset, and with the session that came with it.
        on_session: called with a session that came alone; whether its dataset is there, and is opened with it.
        """
        self._server, self._worker, self._on_made, self._on_session = server, worker, on_made, on_session
        self._folder = folder or Path()
        self._open: dict[int, _Import] = {}
        self._background = Background("import")
        self.uploads = Uploads(self._folder, lambda client, message: answer(server, client, message), self._refused)
        if button.how is not None:
            button.how.on_click(self._explain)

    def close(self) -> None:
        """End the thread and remove files that were not imported."""
        self._background.close()
        self.uploads.close()

    # ---- what pages ask for: from any thread ----

    def arrived(self, upload: Upload) -> None:
        """Take a file that a page uploaded."""
        self._worker.submit(("arrived", upload.path), lambda: self._take(upload))

    def _refused(self, client: int, why: str) -> None:
        self._tell(client, "That file was not taken", why)

    def _explain(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        """Show how to start the server so that pages can import data."""
        if event.client is None:
            return
        guard_gui(event.client.gui)
        explain(event.client.gui)

    def choose(self, client: int) -> None:
        """Plan again with the options chosen in the window."""
        self._worker.submit(("import", client), lambda: self._chosen(client))

    def column(self, client: int, column: str, words: str) -> None:
        """Assign another meaning to a column."""
        self._worker.submit(("import column", client, column), lambda: self._corrected(client, column, words))

    def finish(self, client: int) -> None:
        """Write the planned dataset and open it."""
        self._worker.submit(("import finish", client), lambda: self._finish(client))

    def cancel(self, client: int) -> None:
        """Cancel the page's import and remove its files."""
        self._worker.submit(("import cancel", client), lambda: self._end(client))

    # ---- on the worker's thread ----

    def _tell(self, client: int, title: str, body: str) -> None:
        page = self._server.get_clients().get(client)
        if page is not None:
            page.add_notification(title, body, color="red", auto_close_seconds=15.0)

    def _take(self, upload: Upload) -> LongWork:
        """Handle an uploaded file: open the page's window, or add the file to the import that is open."""
        page = self._server.get_clients().get(upload.client)
        for gone in [client for client in self._open if client not in self._server.get_clients()]:
            self._end(gone)
        if page is None:
            self.uploads.release(upload.client)
            return
        at = self._open.get(upload.client)
        if at is None and is_session_file(upload.path):
            self._take_session(upload)
            return
        if at is None:
            guard_gui(page.gui)
            with page.atomic():  # all at once, so that the window opens as it will stay
                window = YourDataWindow(page.gui, upload.client, self)
            at = _Import(upload.client, window, self.uploads.of(upload.client) / "files")
            self._open[upload.client] = at
        at.suggested = at.suggested or Path(upload.name).stem
        folder = at.folder
        try:
            yield from self._background.run(lambda: self._add(upload, folder))
            yield from self._plan(at)
        except CalibError as error:
            words = str(error).replace(f"{upload.path.parent}/", "").replace(f"{folder}/", "")
            if at.files is None:
                self._end(upload.client)
                self._tell(upload.client, "That did not work", words)
            else:
                at.window.say(words)

    def _take_session(self, upload: Upload) -> None:
        """Open a session that came without its dataset, or tell the page which dataset it needs."""
        try:
            saved = read_session(upload.path, upload.name)
        except CalibError as error:
            self._tell(upload.client, "That did not work", str(error))
            return
        finally:
            self.uploads.release(upload.client)
        if not self._on_session(saved):
            self._tell(upload.client, "The session's dataset is missing", dataset_needed(saved))

    def _add(self, upload: Upload, folder: Path) -> None:
        with self.uploads.writing(upload.client) as room_bytes:
            add_file(upload.path, upload.name, folder, room_bytes)

    def _plan(self, at: _Import) -> LongWork:
        """Recognise the uploaded files, plan the dataset, and show the plan."""
        at.plans += 1
        number, choice, folder, wrong = at.plans, at.choice, at.folder, at.wrong

        made = yield from self._background.run(
            lambda: within_limits("these files", looked_through, folder, choice),
            lambda: self._open.get(at.client) is at,
        )
        # One that was begun later, and knows more, may have ended before this one.
        if made is None or self._open.get(at.client) is not at or at.plans != number:
            return
        at.files, at.plan, at.tips, at.ready = made.files, made.plan, made.tips, made.ready
        if at.plan is not None and wrong:
            at.plan = replace(at.plan, faults=(*wrong, *at.plan.faults), content=None, preview=None)
        if at.plan is None or not at.plan.bad_rows:  # a tick is for the rows that were there as it was set
            at.choice = replace(at.choice, skip_bad_rows=False)
        at.session, at.session_words = _session_among(folder, at.ready)
        at.window.show(self._offer(at, made.faults))

    def _offer(self, at: _Import, faults: tuple[str, ...]) -> Offer:
        files, choice = at.files, at.choice
        assert files is not None
        robot = choice.robot or next(map(str, files.robots), None)
        named = robots_of(files)
        chosen = next((words for words, name in named.items() if name == robot), CHOOSE)
        suffix = "" if robot is None else Path(robot).suffix.lower()
        joints = choice.joints or files.joints
        points = choice.points or (files.points if choice.joints is None else None)
        name = str(at.window.name.value) or self._free_name(at.suggested)
        return Offer(
            files, at.plan, faults, at.ready, at.session_words, (CHOOSE, *named), chosen,
            at.tips, choice.reading.tip or (at.tips or ("–",))[0], suffix == ".csv", suffix == ".conf",
            "–" if joints is None else joints.name, SAME if points is None else points.name, name,
        )  # fmt: skip

    def _free_name(self, wanted: str) -> str:
        name = plain_name(wanted).lower().replace(" ", "_")
        taken = {path.name for path in self._folder.iterdir()} if self._folder.is_dir() else set()
        names = (name if k == 1 else f"{name}_{k}" for k in range(1, 10_000))
        return next(free for free in names if free not in taken)

    def _chosen(self, client: int) -> LongWork:
        at = self._open.get(client)
        if at is None or at.files is None:
            return
        window, by_name = at.window, {path.name: path for path in at.files.tables}
        robot = robots_of(at.files).get(str(window.robot.value))
        before = at.choice.robot or next(map(str, at.files.robots), None)
        tip = str(window.tip.value) if robot == before else None
        convention = str(window.convention.value)
        suffix = "" if robot is None else Path(robot).suffix.lower()
        reading = ReadOptions(
            tip=tip if tip in at.tips and len(at.tips) > 1 else None,
            convention=convention if suffix == ".csv" and convention in CONVENTIONS else None,
            model=str(window.model.value).strip() or None if suffix == ".conf" else None,
        )
        joints = by_name.get(str(window.joints.value))
        points = by_name.get(str(window.points.value))
        typed: dict[str, Any] = {}
        wrong = []
        for label, (name, read) in _TYPED.items():
            text = str(window.told[label].value).strip()
            try:
                typed[name] = read(text) if text else None
            except ValueError as error:
                typed[name] = None
                wrong.append(f"{label}: {error}")
        at.wrong = tuple(wrong)
        at.choice = replace(
            at.choice, robot=robot, reading=reading, joints=joints, points=points or joints,
            skip_bad_rows=bool(window.skip.value), **typed,
        )  # fmt: skip
        yield from self._plan(at)

    def _corrected(self, client: int, column: str, words: str) -> LongWork:
        at = self._open.get(client)
        if at is None or at.plan is None or at.plan.robot is None:
            return
        meanings = all_meanings(at.plan.robot.robot.n_joints)
        if words not in meanings:
            return
        mapping = corrected_mapping(at.plan.columns, at.choice.mapping, column, meanings[words])
        at.choice = replace(at.choice, mapping=mapping)
        yield from self._plan(at)

    def _finish(self, client: int) -> LongWork:
        at = self._open.get(client)
        if at is None or at.files is None:
            return
        files, plan, name = at.files, at.plan, plain_name(str(at.window.name.value))
        out, made = self._folder / name, self.uploads.of(client) / "made" / name  # what is killed goes with the uploads
        at.window.busy()
        try:
            if out.exists():
                raise CalibError(f"{name}: there is a dataset of this name already; give another one")
            yield from self._background.run(lambda: self.uploads.refuse_copy(client))
            if plan is None:
                yield from self._background.run(lambda: within_limits(name, copy_dataset, files.datasets[0], made))
            else:
                yield from self._background.run(lambda: within_limits(name, write_plan, plan, made))
            require_free(out)
            made.rename(out)
        except CalibError as error:
            at.window.say(str(error).replace(f"{at.folder}/", "").replace(f"{made.parent}/", ""))
            at.window.open.disabled = False
            return
        saved = at.session
        self._end(client)
        self._on_made(out, saved)

    def _end(self, client: int) -> None:
        at = self._open.pop(client, None)
        if at is not None:
            at.window.close()
            self.uploads.release(client)


def corrected_mapping(
    columns: Sequence[PlannedColumn], told: Mapping[str, Meaning], column: str, meant: Meaning | None
) -> dict[str, Meaning]:
    """Meanings by column where a user has chosen one: all others stay as they were shown.

    What has the chosen meaning in a table of that column gives it up. None: the column is taken as its name says.
    """
    tables = {each.table for each in columns if each.name == column}
    rivals = {
        each.name
        for each in columns
        if meant is not None and each.meaning is not None
        if each.table in tables and each.meaning.name == meant.name
    }
    shown = {each.name: each.meaning for each in columns if each.meaning is not None}
    mapping = {name: meaning for name, meaning in {**shown, **told}.items() if name not in (column, *rivals)}
    return mapping if meant is None else {**mapping, column: meant}


def _session_among(folder: Path, ready: Dataset | None) -> tuple[Saved | None, str]:
    """Session among the files of an import, if it is one on the dataset that is ready, and words on the file."""
    path = next((path for path in sorted(folder.rglob("*.json")) if is_session_file(path)), None)
    if path is None:
        return None, ""
    try:
        saved = read_session(path, path.name)
    except CalibError as error:
        return None, str(error)
    if ready is None or ready.folder is None or dataset_of_session(saved, [ready.folder]) is None:
        return None, f"{dataset_needed(saved)}."
    return saved, f"{path.name} is a session on this dataset, and is opened with it."


_TYPED: dict[str, tuple[str, Callable[[str], object]]] = {
    SIGMA: ("point_sigma_mm", typed_length_mm),
    TOOL: ("tool_mm", typed_point_mm),
    MASS: ("tool_mass_kg", typed_size),
    EDGE: ("edge_mm", typed_size),
}
"""Fields of the window that are typed: what of the choice each is, and how it is read."""
