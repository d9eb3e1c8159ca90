"""The web app: one page on a dataset, or on a folder of datasets.

Widgets ask (`App`'s methods, on any of viser's threads), the worker's one thread does (`stage.Stage`). A request names
what it is about, so of twenty slider messages the last one counts and a button never runs beside itself.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import viser

from calib.dataset.files.folder import find_datasets, load_dataset
from calib.errors import CalibError
from inspector.app.downloads import Taking
from inspector.app.stage import Stage
from inspector.app.tabs import add_tabs
from inspector.panels.compare import ComparePanel
from inspector.panels.corner import CornerPanel
from inspector.panels.downloads import TakeAwayPanel
from inspector.panels.fit import FitPanel
from inspector.panels.missing_effects import LearnPanel
from inspector.panels.planes import PlanesPanel
from inspector.panels.redundancy import RedundancyPanel
from inspector.panels.residuals import FailurePanel
from inspector.panels.review import ReviewPanel
from inspector.panels.scans import ScansPanel
from inspector.scene.scene_view import LAYERS
from inspector.server.viser_server import LOOPBACK, InspectorServer, start_server, tell, url_of
from inspector.server.worker import LongWork, Worker
from inspector.session.session_file import Opening, Shown
from inspector.session.user_effects import OwnEffects, Watch
from inspector.session.view import LOOKS, RESIDUALS

log = logging.getLogger(__name__)


class App:
    """The page with its thread; `serving` makes one."""

    def __init__(
        self,
        server: InspectorServer,
        folders: Sequence[Path],
        effects_file: Path | None = None,
        saved: Opening | None = None,
        root: Path = Path(),
    ) -> None:
        self.server = server
        named = dict(zip(names_of(folders), folders, strict=True))
        self._known = tuple(named)
        self._asking = threading.Lock()
        self._wanted = 0  # the pose asked for last
        self._moves = 0  # changes of the model to go back (below 0) or forward
        self.stage = self._build(named)
        self.stage.model.own = OwnEffects(effects_file)
        self.worker = Worker(self._failed)
        self._watch = Watch(self.stage.model.own, self.effects)
        self.taking = Taking(self.stage, self.worker, self._take_away, root)
        start = self._known[0]
        if saved is not None:
            start = next(name for name, folder in named.items() if folder == saved.folder)
            self.stage.model.saved[start] = saved.session
        self.open(start)

    def _build(self, folders: dict[str, Path]) -> Stage:
        gui = self.server.gui
        left = gui.add_panel()
        with left.add_tab("Review", icon=viser.Icon.LIST_SEARCH):
            review = ReviewPanel(gui, self, tuple(folders))
        tab = add_tabs(gui, scans_first=has_scans(next(iter(folders.values()))))
        with tab["Scans"]:
            scans = ScansPanel(gui, self)
        with tab["Planes"]:
            planes = PlanesPanel(gui, self)
        with tab["Corner"]:
            corner = CornerPanel(gui, self)
        with tab["Compare"]:
            compare = ComparePanel(gui, self)
        with tab["Redundancy"]:
            redundancy = RedundancyPanel(gui, self)
        with tab["Fit"]:
            fit = FitPanel(gui, self)
        with tab["What is missing"]:
            learn = LearnPanel(gui, self)
        with tab["Where it fails"]:
            failure = FailurePanel(gui, self)
        with tab["Take away"]:
            self._take_away = TakeAwayPanel(gui, self)
        left.dock_left()
        left.set_width(290)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(440)
        return Stage(
            self.server, folders, review=review, scans=scans, planes=planes, corner=corner, redundancy=redundancy,
            fit=fit, learn=learn, failure=failure, compare=compare, on_click=self.select, on_open=self._opened,
        )  # fmt: skip

    def close(self) -> None:
        """End the work and the server."""
        self._watch.stop()
        self.worker.stop()
        self.taking.close()
        self.stage.model.close()
        self.server.stop()

    def _failed(self, key: Hashable, error: Exception) -> None:
        """Tell the user of a job that failed: in every page now, and in the left panel for those who come later."""
        if isinstance(error, CalibError):
            text = str(error)
        else:
            log.error("%s failed", key, exc_info=error)
            text = f"Something went wrong inside the program ({type(error).__name__}: {error}); the terminal says more."
        self.stage.review.show_problem(text)
        tell(self.server, "That did not work", text)

    # ---- what widgets ask for ---------------------------------------------------------------------------------------

    def open(self, name: str) -> None:
        """Show another dataset."""
        if name in self._known:
            self.worker.submit("open", lambda: self.stage.open(name))

    def _opened(self) -> None:
        with self._asking:
            self._wanted = 0  # another dataset starts at its first pose
        saved = self.stage.model.saved.get(self.stage.name)
        if saved is not None:
            self._look_again(saved.shown)

    def _look_again(self, shown: Shown) -> None:
        """What a saved session had on show."""
        if shown.pose is not None:
            self.select_id(shown.pose)
        if shown.look is not None:
            self.look(shown.look)
        if shown.dark is not None:
            self.dark(shown.dark)

    def take(self, what: str, client: viser.ClientHandle) -> None:
        """Make a file and send it to the page that asks."""
        self.taking.take(what, client)

    def select(self, pose: int) -> None:
        """Select a pose by its index."""
        self._want(lambda _: pose)

    def select_id(self, pose_id: str) -> None:
        """Select a pose by its id."""
        view = self.stage.view
        if view is not None and pose_id in view.session.dataset.poses.ids:
            self.select(view.session.dataset.poses.index(pose_id))

    def step(self, by: int) -> None:
        """Go on to the next poses or back; ten presses are ten poses."""
        self._want(lambda current: current + by)

    def _want(self, pose: Callable[[int], int]) -> None:
        view = self.stage.view
        if view is None:
            return
        with self._asking:
            self._wanted = min(max(pose(self._wanted), 0), len(view.session.dataset.poses) - 1)
        self.worker.submit("select", lambda: self.stage.select(self._wanted))

    def look(self, what: str) -> None:
        """Show the layers of a view and put the camera there."""
        if what in LOOKS:
            self.worker.submit("look", lambda: self.stage.look(what))

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        if name in LAYERS:
            self.worker.submit(("layer", name), lambda: self.stage.layer(name, visible))

    def dark(self, dark: bool) -> None:
        """Page and figures dark or light."""
        self.worker.submit("dark", lambda: self.stage.dark(dark))

    def factor(self, factor: float) -> None:
        """How much larger the uncertainty is drawn."""
        self.worker.submit("factor", lambda: self.stage.change(factor=factor))

    def arrows(self, factor: float) -> None:
        """How much longer residuals are drawn."""
        self.worker.submit("arrows", lambda: self.stage.change_arrows(factor))

    def version(self, name: str) -> None:
        """Show the arm and the errors of a version of the model."""
        self.worker.submit("version", lambda: self.stage.comparing.choose(name))

    def prediction(self, name: str, shown: bool) -> None:
        """Show or hide what a version of the model predicts."""
        self.worker.submit(("prediction", name), lambda: self.stage.comparing.show(name, shown))

    def colouring(self, by: str) -> None:
        """Colour the measured points by their pose's role or by their error."""
        self.worker.submit("colouring", lambda: self.stage.comparing.colour_by(by))

    def failure(self) -> None:
        """Show what is left over against what is chosen now."""
        self.worker.submit("failure", lambda: self.stage.failure.update(self.stage.now))

    def grey_rejected(self, grey: bool) -> None:
        """Grey for the plane groups that were not chosen, or each in its own colour."""
        self.worker.submit("grey", lambda: self.stage.change(grey_rejected=grey))

    def point_size(self, size_mm: float) -> None:
        """Diameter of the points."""
        self.worker.submit("point size", lambda: self.stage.scene.point_size(size_mm))

    def search(self, go_on: bool) -> None:
        """Stop searching the scans, or go on."""
        if go_on:
            self.worker.submit("open", self.stage.process)
        elif self.worker.cancel("open"):
            self.worker.submit("stopped", self.stage.stopped)

    def redundancy(self, residual: str) -> None:
        """Analyse the parameters for distances or positions."""
        if residual in RESIDUALS:
            self.worker.submit("redundancy", lambda: self.stage.analyse(residual))

    def correlation(self) -> None:
        """Show the part of the correlation matrix that is chosen now."""
        self.worker.submit("correlation", self.stage.show_correlation)

    def calibrate(self, residual: str) -> None:
        """Fit the robot's parameters to distances or positions."""
        if residual in RESIDUALS:
            self.worker.submit("calibrate", lambda: self.stage.model.calibrate(residual))

    def find(self, start: bool) -> None:
        """Look for what is missing, to the end; or stop looking."""
        if start:
            self.worker.submit("find", lambda: self.stage.model.find())
        else:
            self.worker.cancel("find")

    def effects(self) -> None:
        """Rank again, with the user's own effects as their file has them now."""
        if self.stage.view is not None:
            self.worker.submit("effects", lambda: self.stage.model.rank())

    def candidate(self) -> None:
        """Show what is known of the candidate that is chosen now."""
        self.worker.submit("candidate", lambda: self.stage.model.compare())

    def add_effect(self, name: str) -> None:
        """Add an effect to the model; a second press for the same effect adds nothing."""
        self.worker.submit(("add", name), lambda: self.stage.model.add(name))

    def remove_effect(self, name: str) -> None:
        """Take an effect out of the model."""
        self.worker.submit(("remove", name), lambda: self.stage.model.remove(name))

    def move(self, by: int) -> None:
        """Undo changes of the model, or redo them; three presses are three changes."""
        with self._asking:
            self._moves += by
        self.worker.submit("move", self._move)

    def _move(self) -> LongWork:
        with self._asking:
            by, self._moves = self._moves, 0
        return self.stage.model.move(by)


def has_scans(folder: Path) -> bool:
    """Whether a dataset has scans to look at; a folder that cannot be read tells its reason when it is opened."""
    try:
        return load_dataset(folder).scan_folder is not None
    except CalibError:
        return True


def names_of(folders: Sequence[Path]) -> list[str]:
    """A name for each dataset folder, its own where that tells them apart."""
    names = [folder.resolve().name for folder in folders]
    return [
        str(folder) if names.count(name) > 1 else name for folder, name in zip(folders, names, strict=True)
    ]


@contextmanager
def serving(
    path: Path,
    *,
    host: str = LOOPBACK,
    port: int = 8080,
    effects_file: Path | None = None,
    saved: Opening | None = None,
) -> Iterator[App]:
    """The app on a dataset folder or a folder of datasets, while inside.

    Raises:
        DatasetError: no dataset at `path`.
        CalibError: no effects file there; one with an error in it is told on the page, which takes a better one later.
        ServerError: the address cannot be served on.
    """
    # Those with scans first: a page that opens on one shows the whole way, from scan to model.
    folders = sorted(find_datasets(path), key=lambda folder: not has_scans(folder))
    if effects_file is not None and not effects_file.is_file():
        raise CalibError(f"{effects_file}: no such effects file")
    server = start_server(host, port, label="Calibration inspector")
    app = App(server, folders, effects_file, saved, path)
    try:
        yield app
    finally:
        app.close()


def serve(
    path: Path,
    *,
    host: str = LOOPBACK,
    port: int = 8080,
    effects_file: Path | None = None,
    saved: Opening | None = None,
) -> None:
    """Serve until interrupted (Ctrl-C); says on stdout where the page is.

    Raises: as `serving`.
    """
    with serving(path, host=host, port=port, effects_file=effects_file, saved=saved) as app:
        sys.stdout.write(f"Open {url_of(app.server)} in a browser. Ctrl-C ends.\n")
        sys.stdout.flush()
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            sys.stdout.write("\n")
