"""The left panel: dataset, pose, progress of the search, and layers of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import viser

from calib.html_text import escape
from calib.present import names
from calib.present.diagnosis.candidates import explained_at
from calib.present.names import ROLES, instrument
from calib.rendering import numbers
from calib.rendering.blocks import (
    LONG_NAME,
    Coloured,
    Facts,
    Paragraph,
    Verdict,
    Words,
    joined,
    joint,
    listed,
    pose,
    spans,
)
from calib.rendering.html import panel
from calib.targets.search import ScanSearch
from inspector.markup.parts import elements
from inspector.markup.parts.palette import DOUBT, FAILED, LEFT_OUT, role_colour
from inspector.panels.base import SECONDARY, Actions, ChangedValues, on_page, put, relist
from inspector.panels.input_checks import one_of
from inspector.session.view import FACTORS, POINT_VIEWS, SIDES, VIEW_LAYERS, VIEWS, View, corner_of

LAYER_WORDS = {
    "Scan layers": {
        "scan": "This scan",
        "faces": "Jig's faces",
        "distance": "Distances",
        "jig": "Jig's model",
        "sets": "Sets passed",
        "rejected": "Sets rejected",
        "groups": "Plane groups",
        "overview": "All scans",
    },
    "Model layers": {
        "corner": "This corner",
        "corners": "All corners",
        "predicted": "Predicted",
        "residuals": "Residuals",
        "before": "Model before",
        "arm": "Arm",
        "scanner": "Scanner",
        "plan": "Planned poses",
        "floor": "Floor, 100 mm grid",
        "scale": "Scale",
    },
}
# Of data that were not scanned: a tracker measures points, not corners of a jig.
AS_POINTS = {"All corners": "All points", "Corner": "Point"}
VIEW_OF = {label: view for view, label in AS_POINTS.items()}
LAYERS_AS_POINTS = {"corner": "This point", "corners": "All points"}
SEARCH_AGAIN = "Search again"
NOTHING_OPEN = "No dataset is open: choose another one, or correct this one and start the program again."
KEYS = (
    "Shift and drag: select points by a box. Keys: N next, P previous, 1–7 views, F front, S side, T top, R reset, "
    "D dark or light"
)
DARK_OR_LIGHT = "Dark or light"  # a button and a command that the page itself obeys (server/client/theme.js)
PAGES = "{} pages are open: they share what is shown."
BOXED_NAMED = 5  # poses in a box that are named one by one
PREVIOUS, NEXT = "◀ Previous", "Next ▶"
LEAVE_BOX, CLEAR_BOX = "Leave out", "Clear"
LEAVE_OUT, TAKE_IN = "Leave this pose out", "Take this pose in again"


class ReviewPanel:
    """Widgets that choose the dataset, the pose and the layers for the whole page."""

    def __init__(self, gui: viser.GuiApi, actions: Actions, datasets: tuple[str, ...]) -> None:
        self._actions = actions
        self._changed = ChangedValues()
        self.dataset = gui.add_dropdown("Dataset", datasets, disabled=len(datasets) < 2)
        self._pages = gui.add_html("")
        self._problem = gui.add_html("")  # here it is seen, whatever the height of the screen
        self._about = gui.add_html("")
        self.progress_text = gui.add_html(elements.note("Reading the dataset …"))
        self.progress = gui.add_progress_bar(0, animated=True)
        self.search = gui.add_button("Stop the search", visible=False, color=SECONDARY)
        self.pose = gui.add_dropdown("Pose", ("–",))
        self.walk = gui.add_button_group("", (PREVIOUS, NEXT), hint="keys: P and N")
        self._status = gui.add_html("")
        self.leave_out = gui.add_button(
            LEAVE_OUT, color=SECONDARY, visible=False, hint="fits the model again; Undo takes it back"
        )
        self._boxed = gui.add_html("")
        self._in_box: tuple[str, ...] = ()  # ids
        self.box = gui.add_button_group("These poses", (LEAVE_BOX, CLEAR_BOX), visible=False)
        self._shown_pose = ""  # id
        self.view = gui.add_button_group("3D view", VIEWS, hint="keys: 1 to 7")
        self.keep = gui.add_checkbox(
            "Keep this view", False, hint="the 3D view stays as it is when another tab is opened"
        )
        self._legend = gui.add_html("")
        self.layers: dict[str, viser.GuiCheckboxHandle] = {}
        self._folders: dict[str, viser.GuiFolderHandle] = {}
        for folder, layers in LAYER_WORDS.items():
            # Folded, so that the panel fits a screen 720 pixels high; the views above switch them, too.
            self._folders[folder] = gui.add_folder(folder, expand_by_default=False)
            with self._folders[folder]:
                for name, label in layers.items():
                    self.layers[name] = gui.add_checkbox(label, name in VIEW_LAYERS[VIEWS[0]])
        with gui.add_folder("Display", expand_by_default=False):
            gui.add_button(DARK_OR_LIGHT, color="gray", hint="key: D; for this page alone, and kept by the browser")
            self.factor = gui.add_dropdown(
                "Ellipsoids ×", tuple(str(f) for f in FACTORS), initial_value="1000",
                hint="how many times larger than one standard deviation the uncertainty is drawn",
            )  # fmt: skip
        gui.add_html(elements.STYLE + elements.note(KEYS))
        self._gui = gui
        self._commands: list[viser.CommandHandle] = []  # of the views that the dataset has
        self._connect(gui)

    def _connect(self, gui: viser.GuiApi) -> None:
        a = self._actions
        on_page(self.dataset, lambda value: a.open(str(value)))
        on_page(self.pose, lambda value: self._chosen(str(value)))
        self.walk.on_click(lambda e: a.step(1 if e.target.value == NEXT else -1))
        self.view.on_click(lambda e: a.show_view(one_of(VIEW_OF.get(e.target.value, e.target.value), VIEWS, VIEWS[0])))
        self.leave_out.on_click(lambda _: a.leave_out(self._shown_pose, self.leave_out.label == LEAVE_OUT))
        self.box.on_click(lambda e: self._box_pressed(str(e.target.value)))
        on_page(self.keep, lambda value: a.keep_view(bool(value)))
        self.search.on_click(lambda _: self._search_pressed())
        on_page(self.factor, lambda value: a.factor(float(one_of(value, [str(f) for f in FACTORS], "1000"))))
        for name, box in self.layers.items():
            on_page(box, lambda value, name=name: a.layer(name, bool(value)))  # type: ignore[misc]
        gui.add_command("Next pose", hotkey="N", icon=viser.Icon.ARROW_RIGHT).on_trigger(lambda _: a.step(1))
        gui.add_command("Previous pose", hotkey="P", icon=viser.Icon.ARROW_LEFT).on_trigger(lambda _: a.step(-1))
        for side in SIDES:
            gui.add_command(f"Look from: {side}", hotkey=side[0], icon=viser.Icon.CAMERA).on_trigger(  # type: ignore[arg-type]
                lambda _, side=side: a.look_from(side)  # type: ignore[misc]
            )
        gui.add_command(DARK_OR_LIGHT, hotkey="D", icon=viser.Icon.MOON)

    def _search_pressed(self) -> None:
        if self.search.label == SEARCH_AGAIN:
            self._actions.open_again()
        else:
            self._actions.search(self.search.label != "Stop the search")

    def _box_pressed(self, button: str) -> None:
        if button == LEAVE_BOX:
            self._actions.leave_out_poses(self._in_box)
        self._actions.box(None)

    def _chosen(self, label: str) -> None:
        options = list(self.pose.options)
        if label in options:
            self._actions.select(options.index(label))

    # ---- showing ----------------------------------------------------------------------------------------------------

    def set_poses(self, view: View) -> None:
        """List the poses of a dataset that was just opened, and the views that have something to show."""
        has_scans = view.session.dataset.scan_folder is not None
        self._folders["Scan layers"].visible = has_scans
        views = VIEWS if has_scans else POINT_VIEWS
        self.view.options = tuple(views if has_scans else (AS_POINTS.get(name, name) for name in views))
        self._list_commands(views)
        for layer, of_points in LAYERS_AS_POINTS.items():
            self.layers[layer].label = LAYER_WORDS["Model layers"][layer] if has_scans else of_points
        self.layers["scanner"].label = instrument(view.session.dataset).capitalize()
        self.list_poses(view)

    def _list_commands(self, views: Sequence[str]) -> None:
        """Have a command for each of the views, and none for another."""
        for command in self._commands:
            command.remove()
        self._commands = []
        for name, label in zip(views, self.view.options, strict=True):
            key: Any = str(VIEWS.index(name) + 1)
            command = self._gui.add_command(f"Look at: {label}", hotkey=key, icon=viser.Icon.EYE)
            command.on_trigger(lambda _, name=name: self._actions.show_view(name))  # type: ignore[misc]
            self._commands.append(command)

    def list_poses(self, view: View) -> None:
        """List each pose with its role, and whether it is left out."""
        poses, out = view.session.dataset.poses, view.session.uncounted
        options = tuple(
            f"{i} · {names.role(str(r))}{' · left out' if i in out else ''}"
            for i, r in zip(poses.ids, poses.role, strict=True)
        )
        relist(self.pose, options)

    def update(self, view: View) -> None:
        """Refresh everything that depends on the selected pose or on search results."""
        dataset = view.session.dataset
        poses = dataset.poses
        roles, setups = [str(r) for r in poses.role], len(set(poses.setup))
        facts: list[tuple[str, object]] = [
            # The list above has room for a short name only.
            *([("dataset", dataset.name)] if len(dataset.name) > LONG_NAME else []),
            ("robot", dataset.robot.name),
            ("poses", " · ".join(f"{roles.count(r)} {w}" for r, w in ROLES.items() if r in roles)),
            *([("left out of these", len(view.session.uncounted))] if view.session.uncounted else []),
            *([(f"placements of the {instrument(dataset)}", setups)] if setups > 1 else []),
        ]
        warnings = [Verdict(words, DOUBT) for words in dataset.warnings]
        notes = [Paragraph(words, soft=True) for words in dataset.notes]
        self._about.content = (
            panel([Facts(facts), *warnings, *notes])
            + f'<span data-dataset="{escape(dataset.name)}"></span>'  # files of figures are called by it
            + ('<span data-measured="points"></span>' if dataset.scan_folder is None else "")  # page.css hides tabs
        )
        self._changed.put(self.pose, self.pose.options[view.pose])
        self._status.content = self._pose_status(view) + elements.joint_style(view.joint)
        self._shown_pose = view.pose_id
        self.leave_out.label = TAKE_IN if view.pose_id in view.session.uncounted else LEAVE_OUT
        self.leave_out.visible = True

    def _pose_status(self, view: View) -> str:
        role = str(view.session.dataset.poses.role[view.pose])
        place = f"{view.pose + 1} of {len(view.session.dataset.poses)}, {names.role(role)}"
        out = view.pose_id in view.session.uncounted
        colour = LEFT_OUT if out else role_colour(role)
        rows: list[tuple[str, object]] = [("pose", Coloured(place, colour))]
        if out:
            rows.append(("left out", "no fit and no figure takes it"))
        setup = str(view.session.dataset.poses.setup[view.pose])
        if setup:
            rows.append((f"placement of the {instrument(view.session.dataset)}", setup))
        if view.joint is not None:
            rows.append(("joint", joint(view.joint + 1, f"{view.joint + 1}, Esc lets it go")))
        found, search = corner_of(view, view.pose), view.search
        scanned = view.session.dataset.scan_folder is not None
        what, failure = "corner" if scanned else "point", ""
        if search is not None and search.failure:
            failure = f"No corner: {search.failure}"
        elif found is None:
            rows.append((what, "waiting for the search" if scanned else "not measured"))
        elif search is None or search.corner is None:
            rows.append((what, search.state() if isinstance(search, ScanSearch) else "measured (points.csv)"))
        else:
            doubts = len(search.corner.quality.doubts())
            said = f"found, {numbers.count(doubts, 'doubt')}: see the tab Corner"
            rows.append((what, Coloured(said, DOUBT) if doubts else "found"))
        return panel([Facts(rows), Verdict(failure, FAILED)])

    def show_box(self, view: View) -> None:
        """Show which poses lie in the box drawn over the 3D view, and which effects would explain them."""
        ids = self._in_box = tuple(view.session.dataset.poses.ids[pose] for pose in view.boxed)
        self.box.visible = bool(ids)
        if not ids:
            self._boxed.content = ""
            return
        table = [] if view.session.screening is None else explained_at(view.session.screening, ids)
        named = listed(numbers.first_of([pose(i) for i in ids], BOXED_NAMED))
        words = spans(f"{numbers.count(len(ids), 'pose')} in the box: ", named, ".")
        self._boxed.content = panel([Paragraph(words), *table])

    def list_datasets(self, names: tuple[str, ...]) -> None:
        """List the datasets that can be chosen."""
        self.dataset.options, self.dataset.disabled = names, len(names) < 2

    def show_nothing(self) -> None:
        """Show that no dataset could be opened, with the reason above."""
        self.progress_text.content = elements.note(NOTHING_OPEN)
        self.progress.visible = self.search.visible = False

    def show_progress(
        self,
        done: int,
        total: int,
        failed: Sequence[str] = (),
        doubtful: Sequence[str] = (),
        *,
        running: bool,
        seconds: float | None = None,
        why: str = "",
    ) -> None:
        """Show the search's progress, the poses with a missing or doubtful corner, and why all failed if they did."""
        if total == 0:
            self.progress_text.content = ""
            self.progress.visible = self.search.visible = False
            return
        failures: list[Words] = [spans(f", {len(failed)} failed (", few(failed), ")")] if failed else []
        failures += [spans(f", {len(doubtful)} with doubts (", few(doubtful), ")")] if doubtful else []
        if running:
            text = f"Searching corners: {done} of {total} scans"
        elif done < total:
            text = f"Stopped: {done} of {total} scans searched"
        else:
            took = f" in {seconds:.0f} s" if seconds is not None else ""
            text = f"{done - len(failed)} of {total} corners found{took}"
        said = spans(text, *failures, f": {why}" if why and done == total and not running else "")
        colour = FAILED if failed else DOUBT if doubtful else ""
        self.progress_text.content = (
            elements.alert(said, colour=colour) if colour and not running else elements.note(said)
        )
        put(self.progress, 100.0 * done / total)
        self.progress.animated = running
        self.progress.visible = done < total
        self.search.label = "Stop the search" if running else "Go on searching" if done < total else SEARCH_AGAIN
        self.search.visible = done < total or bool(failed)

    def show_layers(self, visible: set[str]) -> None:
        """Tick the visible layers."""
        for name, box in self.layers.items():
            put(box, name in visible)

    def show_legend(self, html: str) -> None:
        """Show the meaning of the colours in the 3D view."""
        self._legend.content = f'<div data-over-view="legend">{html}</div>'

    def show_pages(self, pages: int) -> None:
        """Show how many browsers are connected, where there are several."""
        self._pages.content = elements.note(PAGES.format(pages)) if pages > 1 else ""

    def show_problem(self, text: str) -> None:
        """Show the last error, which stays after its notification has disappeared."""
        self._problem.content = elements.alert(text)


def few(names: Sequence[str], most: int = 3) -> Words:
    """First of many pose ids, shortened, each a reference: "p1, p2, p3 …"."""
    short = [name if len(name) <= LONG_NAME else f"{name[: LONG_NAME - 1]}…" for name in names[:most]]
    shown = [pose(name, text) for name, text in zip(names, short, strict=False)]
    return spans(joined(shown, ", "), " …" if len(names) > most else "")
