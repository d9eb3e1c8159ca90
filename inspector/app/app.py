"""The web app: a page on a dataset, or on a folder of datasets.

Widgets ask (`App`'s methods, on any of viser's threads); the controllers and the stage do it, on the worker's one
thread. A request names what it is about, so of twenty slider messages the last one counts and a button never runs
beside itself.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Container, Hashable, Sequence
from pathlib import Path
from typing import Concatenate, ParamSpec

import viser

from calib.array_types import Array, BoolArray
from calib.errors import CalibError
from calib.plugins import load
from inspector.app.controllers.dataset_controller import DatasetController
from inspector.app.controllers.downloads import Downloads
from inspector.app.controllers.imports import Imports
from inspector.app.controllers.model_controller import ModelController
from inspector.app.controllers.plan_controller import PlanController
from inspector.app.controllers.side_by_side_controller import SideBySideController
from inspector.app.controllers.stage import SceneController
from inspector.app.page.dataset_list import have_scans, listed_folders, names_of
from inspector.app.page.page_state import PageState
from inspector.app.page.tab_controller import Page, TabController
from inspector.app.page.tabs import CONTRIBUTED, VIEW_OF_TAB, add_panels
from inspector.panels.input_checks import whole_number
from inspector.scene.scene_view import LAYERS
from inspector.server.uploads import take_uploads
from inspector.server.viser_server import InspectorServer, tell
from inspector.server.worker import LongWork, Worker
from inspector.session.dropped import dataset_of_session
from inspector.session.reopening import Opening
from inspector.session.scan_cache import ScanCache
from inspector.session.session_file import Saved, Shown
from inspector.session.user_effects import UserEffects
from inspector.session.view import RESIDUALS, SIDES, VIEWS
from inspector.session.watch import Watch

log = logging.getLogger(__name__)
P = ParamSpec("P")


def _asks(
    key: str,
    job: Callable[[App], Callable[P, LongWork | None]],
    *,
    known: Container[object] | None = None,
    each: bool = False,
    if_open: bool = False,
) -> Callable[Concatenate[App, P], None]:
    """Method that asks the worker for a job; of several requests the last counts, with `each` the last on one thing.

    known: what the first value has to be one of, else the request is ignored, as is one with `if_open` while no dataset
    is open
    """

    def ask(app: App, /, *args: P.args, **kwargs: P.kwargs) -> None:
        if (known is None or args[0] in known) and not (if_open and app.state.view is None):
            app.worker.submit((key, args[0]) if each else key, lambda: job(app)(*args, **kwargs))

    return ask


class App:
    """The page and its worker thread; instances are made by `serving`."""

    stage: SceneController
    model: ModelController
    dataset: DatasetController
    side_by_side: SideBySideController
    planning: PlanController

    def __init__(
        self,
        server: InspectorServer,
        folders: Sequence[Path],
        effects_file: Path | None = None,
        saved: Opening | None = None,
        root: Path = Path(),
        data: Path | None = None,
    ) -> None:
        """`data`: folder for datasets that pages import; None where pages cannot import."""
        self._asking = threading.Lock()
        self._moves = 0  # changes of the model to go back (below 0) or forward
        self.server = server
        named = dict(zip(names_of(folders), folders, strict=True))
        self._folders = named
        self._wanted = 0  # the pose asked for last
        self._to_judge: set[str] = set()  # datasets just imported: the page leads to their verdict
        self._root, self._data = root, data
        self._described: tuple[str, dict[Path, int]] = ("", {})
        start = next(iter(named))
        if saved is not None:
            start = next(name for name, folder in named.items() if folder == saved.folder)
        user_effects, scans = UserEffects(effects_file), ScanCache()
        (scans_first,) = have_scans(folders[:1])
        panels = add_panels(server.gui, self, tuple(named), scans_first=scans_first, takes_data=data is not None)
        self.panels, self.state = panels, PageState(panels.headline.update)
        self.stage = SceneController(
            server, self.state, scans, panels, on_click=self.select, on_joint=self.select_joint
        )
        self.stage.scene.on_box(self.box)
        self.model = ModelController(
            self.state, panels, user_effects, {} if saved is None else {start: saved.session},
            redraw=self._draw_model, recount=self._recount, draw_as=self.stage.draw_as,
        )  # fmt: skip
        self.dataset = DatasetController(named, self.state, scans, panels, self.stage, self.model, on_open=self._opened)
        self.side_by_side = SideBySideController(named, self.state, panels.side_by_side)
        self.planning = PlanController(self.state, self.stage.scene, panels.plan)
        self.worker = Worker(self._failed)
        page = Page(named, self.state, self.worker)
        self.contributed: dict[str, TabController] = {
            tab.name: load(tab.controller)(page, panels.contributed[tab.name]) for tab in CONTRIBUTED if tab.controller
        }
        self._watches = [
            Watch(lambda: user_effects.version, self.effects),
            Watch(self._files, lambda: self.worker.submit("files", self._follow_files)),
        ]
        self.imports = Imports(
            server, data, panels.own_data, self.worker, on_made=self._imported, on_session=self._open_session
        )
        self.downloads = Downloads(
            server, self.state, lambda: self.stage.view_name, self.worker, panels.downloads, root, self.imports.uploads
        )
        if panels.own_data.upload is not None:
            panels.downloads.targets.visible = True
            own, targets = panels.own_data.upload, panels.downloads.targets
            arriving = ((own, self.imports.arrived), (targets, self.downloads.correct))
            take_uploads(server, arriving, self.imports.uploads)
        asked: dict[str, Callable[[str], None]] = {
            "pose": self.select_id,
            "tabs": self.tabs,
            "look": self.look_from,
            "find": lambda _: self.find(True),
            "joint": lambda number: self.select_joint(whole_number(number)),
            "effect": self.select_effect,
            "planned": lambda number: self.select_planned(whole_number(number)),
            "settle": lambda _: self.settle(),
            "step": lambda number: self.show_step(whole_number(number)),
        }
        for name, answer in asked.items():
            server.requests.on(name, answer)
        server.on_client_connect(self._count_pages)
        server.on_client_disconnect(self._count_pages)
        self.open(start)

    def _count_pages(self, _: viser.ClientHandle) -> None:
        """Tell the user when several pages are open, since one server shows the same in all pages."""
        self.worker.submit("pages", lambda: self.panels.review.show_pages(len(self.server.get_clients())))

    def close(self) -> None:
        """End the work, the threads and the server."""
        for watch in self._watches:
            watch.stop()
        self.imports.close()
        self.worker.stop()
        self.downloads.close()
        self.model.close()
        self.dataset.close()
        self.side_by_side.close()
        self.planning.close()
        for controller in self.contributed.values():
            controller.close()
        self.server.stop()

    def _failed(self, key: Hashable, error: Exception) -> None:
        """Report a failed job: as a notification in every open page, and in the left panel for pages opened later."""
        if isinstance(error, CalibError):
            text = str(error)
        else:
            log.error("%s failed", key, exc_info=error)
            text = f"Something went wrong inside the program ({type(error).__name__}: {error}); the terminal says more."
        self.panels.review.show_problem(text)
        tell(self.server, "That did not work", text)

    # ---- what widgets ask for: the page, the pose, the view ---------------------------------------------------------

    def open(self, name: str) -> None:
        """Open another dataset of the list."""
        if name in self._folders:
            self.worker.submit("open", lambda: self.dataset.open(name))

    def open_again(self) -> None:
        """Read the dataset on show again from its folder."""
        self.worker.submit("open", lambda: self.dataset.open(self.state.name, again=True))

    def _files(self) -> tuple[dict[Path, Path], tuple[str, dict[Path, int]]]:
        """Folders of datasets that can be listed, and the dataset on show with the times of what describes it."""
        name = self.state.name
        described = [self._folders[name] / file for file in ("dataset.toml", "robot.toml")] if name else []
        times = {path: path.stat().st_mtime_ns for path in described if path.is_file()}
        return listed_folders(self._root, self._data), (name, times)

    def _follow_files(self) -> None:
        """List datasets that are new, and read the one on show again where what describes it has changed."""
        folders, (name, times) = self._files()
        known = {folder.resolve() for folder in self._folders.values()}
        for folder in (folder for place, folder in folders.items() if place not in known):
            self._folders[folder.name if folder.name not in self._folders else str(folder)] = folder
        self.panels.review.list_datasets(tuple(self._folders))
        before, self._described = self._described, (name, times)
        changed = [path.name for path, time in times.items() if before[0] == name and before[1].get(path) != time]
        if changed:
            tell(self.server, f"{changed[0]} has changed", f"{name} is read again, and its scans are searched again.")
            self.open_again()

    def _imported(self, folder: Path, saved: Saved | None) -> None:
        """Add a dataset that was just written to the list, and open it, with the session that came with it."""
        name = folder.name if folder.name not in self._folders else str(folder)
        self._folders[name] = folder
        self.panels.review.list_datasets(tuple(self._folders))
        if saved is not None:
            self.model.saved[name] = saved
        else:
            self._to_judge.add(name)
        self.open(name)

    def _open_session(self, saved: Saved) -> bool:
        """Open a dropped session; False where its dataset is not listed."""
        folder = dataset_of_session(saved, self._folders.values())
        name = next((name for name, listed in self._folders.items() if listed == folder), None)
        if name is None:
            return False
        self.model.saved[name] = saved
        self.open(name)
        return True

    def _opened(self) -> None:
        self._described = self._files()[1]
        with self._asking:
            self._wanted = 0  # another dataset starts at its first pose
        for controller in self.contributed.values():
            controller.opened()
        self.panels.headline.doing(leads=self.state.name in self._to_judge)
        self._follow_model()
        saved = self.model.saved.get(self.state.name)
        if saved is not None:
            self._show_again(saved.shown)

    def _draw_model(self, first: bool) -> None:
        if first and self.state.name in self._to_judge:
            self._to_judge.remove(self.state.name)
            self.find(True)
        self.stage.draw_model(first)
        self._follow_model()

    def _follow_model(self) -> None:
        """Update what is computed from the model on show, once it is drawn."""
        self.beside()
        self.show_plan()
        for controller in self.contributed.values():
            controller.model_shown()

    def _show_again(self, shown: Shown) -> None:
        """Restore the selections of a saved session."""
        if shown.pose is not None:
            self.select_id(shown.pose)
        if shown.view is not None:
            self.show_view(shown.view)

    def _recount(self, changed: frozenset[str]) -> None:
        """Redraw the marks of left-out poses, and analyse redundancy at the other poses."""
        self.stage.draw_left_out(changed)
        if self.state.session.redundancy is None:
            self.dataset.analyse_as_chosen()

    def take(self, what: str, client: viser.ClientHandle) -> None:
        """Make a file and send it to the page of the request."""
        self.downloads.take(what, client)

    def select(self, pose: int) -> None:
        """Select a pose by its index."""
        self._want(lambda _: pose)

    def select_id(self, pose_id: str) -> None:
        """Select a pose by its id."""
        view = self.state.view
        if view is not None and pose_id in view.session.dataset.poses.ids:
            self.select(view.session.dataset.poses.index(pose_id))

    select_joint = _asks("joint", lambda app: app.stage.joint)
    """Select a joint by its number, counted from 1; the selected one again, or None, deselects."""

    def box(self, is_in_box: Callable[[Array], BoolArray] | None) -> None:
        """Select the poses in a box that was drawn over the 3D view; None clears the box."""
        if self.state.view is not None:
            self.worker.submit("box", lambda: self.stage.box(is_in_box))

    between = _asks("between", lambda app: app.stage.between)
    """Draw the arrows between those of the model a step before (0) and those of the model on show (1)."""

    def show_step(self, number: int | None) -> None:
        """Show the model after a step, 0 for the nominal robot."""
        if number is not None:
            self.worker.submit("version", lambda: self.stage.step(number))

    def step(self, by: int) -> None:
        """Select a later pose, or an earlier one for a negative number; repeated presses add up."""
        self._want(lambda current: current + by)

    def _want(self, pose: Callable[[int], int]) -> None:
        view = self.state.view
        if view is None:
            return
        with self._asking:
            self._wanted = min(max(pose(self._wanted), 0), len(view.session.dataset.poses) - 1)
        self.worker.submit("select", lambda: self.dataset.select(self._wanted))

    show_view = _asks("view", lambda app: app.stage.choose_view, known=VIEWS)
    """Show the layers of a view and move the camera to its position."""

    def tabs(self, names: str) -> None:
        """Show the view that belongs to the opened tabs, given as "Review/Learn/What is missing"."""
        opened = names.split("/")
        name = next((VIEW_OF_TAB[tab] for tab in reversed(opened) if tab in VIEW_OF_TAB), None)
        if name is not None:
            self.worker.submit("view", lambda: self.stage.follow(name))
        if self.state.view is not None:
            self.worker.submit("plan opened", lambda: self.planning.opened("Plan" in opened))

    keep_view = _asks("keep view", lambda app: app.stage.keep_view)
    """Choose whether the 3D view stays unchanged when another tab is opened."""

    look_from = _asks("look", lambda app: app.stage.look_from, known=SIDES)
    """Move the camera to the front, the side, the top, or back to its first position."""

    layer = _asks("layer", lambda app: app.stage.layer, known=LAYERS, each=True)
    """Show or hide one layer of the 3D view."""

    def factor(self, factor: float) -> None:
        """Set the enlargement of drawn uncertainty ellipsoids."""
        self.worker.submit("factor", lambda: self.stage.change(factor=factor))

    arrows = _asks("arrows", lambda app: app.stage.change_arrows)
    """Set the enlargement of drawn residuals; None chooses the factor by their size."""

    version = _asks("version", lambda app: app.stage.version)
    """Show the arm and the errors of a version of the model."""

    def search(self, go_on: bool) -> None:
        """Continue or stop the search of the scans."""
        if go_on:
            self.worker.submit("open", self.dataset.process)
        elif self.worker.cancel("open"):
            self.worker.submit("stopped", self.dataset.stopped)

    # ---- what widgets ask for: fits, effects, plans, other datasets --------------------------------------------------

    def failure(self) -> None:
        """Plot the residual against the chosen input."""
        self.worker.submit("failure", lambda: self.panels.residuals.update(self.state.now))

    beside = _asks("beside", lambda app: app.side_by_side.show, if_open=True)
    """Compare the calibration on show with the chosen dataset or version."""

    plan = _asks("plan", lambda app: app.planning.make, if_open=True)
    """Plan poses as chosen in the tab Plan."""

    settle = _asks("plan", lambda app: app.planning.settle, if_open=True)
    """Plan poses that discriminate between the effects that the diagnosis left open."""

    show_plan = _asks("show plan", lambda app: app.planning.show, if_open=True)
    """Show the purposes that can be planned for, and the model's plan."""

    select_planned = _asks("planned", lambda app: app.planning.select)
    """Select a pose of the plan by its index."""

    def take_plan(self, what: str, client: viser.ClientHandle) -> None:
        """Send a file of the plan to the page of the request."""
        self.worker.submit(("take plan", what, client.client_id), lambda: self.planning.take(what, client))

    redundancy = _asks("redundancy", lambda app: app.dataset.analyse, known=RESIDUALS)
    """Analyse the redundancy of the parameters for a kind of residual."""

    calibrate = _asks("calibrate", lambda app: app.model.calibrate, known=RESIDUALS)
    """Fit the robot's parameters with a kind of residual."""

    def find(self, start: bool) -> None:
        """Run the whole diagnosis, or stop it."""
        if start:
            self.worker.submit("find", lambda: self.model.find())
        else:
            self.worker.cancel("find")

    effects = _asks("effects", lambda app: app.model.rank, if_open=True)
    """Rank the effects again, with the user's own effects read anew from their file."""

    candidate = _asks("candidate", lambda app: app.model.choose)
    """Show the details of the chosen candidate effect."""

    select_effect = _asks("candidate", lambda app: app.model.choose, if_open=True)
    """Select an effect named in a sentence."""

    follow = _asks("follow", lambda app: app.model.follow)
    """Make the change of the model that the diagnosis advises."""

    add_effect = _asks("add", lambda app: app.model.add, each=True)
    """Add an effect to the model; one that is in the model already is ignored."""

    remove_effect = _asks("remove", lambda app: app.model.remove, each=True)
    """Remove an effect from the model."""

    def leave_out(self, pose_id: str, out: bool) -> None:
        """Leave a pose out of all fits and tests, or use it again."""
        view = self.state.view
        if view is not None and pose_id in view.session.dataset.poses.ids:
            self.worker.submit(("leave out", pose_id), lambda: self.model.leave_out(pose_id, out))

    def leave_out_poses(self, pose_ids: Sequence[str]) -> None:
        """Leave several poses out of all fits and tests, as one change."""
        self.worker.submit(("leave out", tuple(pose_ids)), lambda: self.model.leave_out_poses(pose_ids))

    def new_setup(self, pose_id: str) -> None:
        """Give the instrument another place from a pose on."""
        view = self.state.view
        if view is not None and pose_id in view.session.dataset.poses.ids:
            self.worker.submit(("new setup", pose_id), lambda: self.model.new_setup(pose_id))

    def move(self, by: int) -> None:
        """Undo (for a negative number) or redo changes of the model; repeated presses add up."""
        with self._asking:
            self._moves += by
        self.worker.submit("move", self._move)

    def _move(self) -> LongWork:
        with self._asking:
            by, self._moves = self._moves, 0
        return self.model.move(by)
