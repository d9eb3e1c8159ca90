"""Window of an import, one per page: the user corrects what was recognised, names the dataset and opens it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import viser

from calib.dataset.dataset import Dataset
from calib.dataset.input_names import quantity_of
from calib.dataset_import.columns import Meaning, meaning_of
from calib.dataset_import.plan import LEFT_OUT, ImportPlan, PlannedColumn
from calib.dataset_import.questions import Question
from calib.dataset_import.user_files import UNUSED, UserFile, UserFiles
from calib.present.fit.dataset import first_rows, preview
from calib.rendering import numbers
from calib.rendering.blocks import Paragraph, Section, Table, Verdict
from calib.rendering.colours import DOUBT
from calib.rendering.html import panel
from inspector.markup.parts import elements
from inspector.markup.parts.palette import FAILED
from inspector.panels.base import SECONDARY, on_page, put

OWN_DATA = "Open your own data …"
OWN_HINT = "or drop it: robot's file, tables, scans, a zip, a session"
OPEN = "Import and open"
CANCEL = "Cancel"
CHOOSE = "choose …"
SAME = "in the table of joints"
SIGMA, TOOL, MASS, EDGE = "Sigma, mm", "Tool, mm", "Tool, kg", "Jig's edge, mm"
CORRECT = "Correct what a column is taken for"
OTHER_WAY = "other way round"
NOTED = "#56B4E9"
FIELDS = {"--sigma": SIGMA, "--tool": TOOL, "--tool-mass": MASS, "--edge": EDGE, "--map": CORRECT}
"""Field of the window that answers a question, by the option of the command."""
HINTS = {
    SIGMA: "standard deviation of a measured point, each axis, such as 0.05",
    TOOL: "x, y, z of the measured point from the flange (a URDF's last link, else [flange] or the last joint)",
    MASS: "of what the arm carries at the flange",
    EDGE: "from the corner along each of its three edges",
}
NOTE = "More files? Drop them on the page; one of the same name replaces the one before."
HOW = (
    "This server was started without a place for your data. End it (Ctrl-C) and start it with a folder to write "
    "datasets to, which it then lists, too:"
)
COMMANDS = "inspector serve PATH --data my_data\ninspector import my_data/my_cell --from my.zip"
_MOST_FILES, _MOST_UNUSED, _MOST_LINES = 12, 6, 30  # named each
_SHOWN_NOTES = ("is read so", "misses the points", "its table is", "the measured point is at")
# As wide as the table needs; viser makes its windows 440 pixels wide.
WIDE = (
    "<style>.mantine-Modal-content:has(.inspector-import){flex:0 0 min(54rem,94vw)}"
    ".mantine-Modal-inner:has(.inspector-import){padding-inline:2vw}</style>"
    "<div class='inspector-import' tabindex='-1' data-autofocus style='outline:none'></div>"  # else a list opens itself
)
_OTHERS = ("pose", "target", "setup", "role", "payload_kg", "temperature_c", "time_s", "scan")
KEPT, DROPPED = "kept as it is", "left out"


class OwnDataButton:
    """Upload button at the top of the left panel; where the server accepts no data, it explains how to enable that."""

    def __init__(self, gui: viser.GuiApi, *, takes_data: bool) -> None:
        """Add the button, and a line on what it takes."""
        self.upload: viser.GuiUploadButtonHandle | None = None
        self.how: viser.GuiButtonHandle | None = None
        if takes_data:
            self.upload = gui.add_upload_button(OWN_DATA, icon=viser.Icon.UPLOAD)
            gui.add_html(elements.note(OWN_HINT))
        else:
            self.how = gui.add_button(OWN_DATA, icon=viser.Icon.UPLOAD, color=SECONDARY, hint=OWN_HINT)


class ImportActions(Protocol):
    """Requests that the window may send; each call returns at once."""

    def choose(self, client: int) -> None: ...
    def column(self, client: int, column: str, words: str) -> None: ...
    def finish(self, client: int) -> None: ...
    def cancel(self, client: int) -> None: ...


@dataclass(frozen=True)
class Offer:
    """Options and current choices in the window."""

    files: UserFiles
    plan: ImportPlan | None  # None: a ready dataset, which needs no plan
    faults: tuple[str, ...]  # of a ready dataset
    ready: Dataset | None  # the dataset of a plan of None
    session: str  # words on a session file among the files, "" for none
    robots: tuple[str, ...]
    robot: str
    tips: tuple[str, ...]  # of a URDF with several
    tip: str
    is_table: bool  # of theta, d, a, alpha
    needs_model: bool  # a UR controller's file
    joints: str
    points: str
    name: str

    @property
    def is_ready(self) -> bool:
        """Whether the planned dataset can be imported."""
        return not self.faults and (self.plan is None or self.plan.content is not None)


class YourDataWindow:
    """Widgets of one page's import."""

    def __init__(self, gui: viser.GuiApi, client: int, actions: ImportActions) -> None:
        self._gui, self._client, self._actions = gui, client, actions
        self._modal = gui.add_modal("Your own data")
        with self._modal:
            self._files = gui.add_html(WIDE + elements.note("Reading …"))
            self._said = gui.add_html("")
            self.skip = gui.add_checkbox(
                "", False, visible=False, hint="the notes of the dataset will say which rows, and what was found there"
            )
            self.robot = gui.add_dropdown("Robot", (CHOOSE,))
            self.tip = gui.add_dropdown("Ends at", ("–",), visible=False, hint="the link where the arm ends")
            self.convention = gui.add_dropdown(
                "Table is", ("the points tell", "standard", "modified"), visible=False,
                hint="the convention of Denavit and Hartenberg; modified is Craig's",
            )  # fmt: skip
            self.model = gui.add_text("Model", "", visible=False, hint="which arm it is, such as ur10e")
            self.joints = gui.add_dropdown("Joint values", ("–",), visible=False)
            self.points = gui.add_dropdown("Points", ("–",), visible=False)
            self._columns = gui.add_html("")
            self._folder = gui.add_folder(CORRECT, expand_by_default=False, visible=False)
            self._preview = gui.add_html("")
            self._asked = gui.add_html("")
            self.told = {label: gui.add_text(label, "", visible=False, hint=hint) for label, hint in HINTS.items()}
            self.name = gui.add_text("Name", "", hint="under which the dataset is listed at the top left")
            self.open = gui.add_button(OPEN, disabled=True, icon=viser.Icon.FOLDER_OPEN)
            self.cancel = gui.add_button(CANCEL, color=SECONDARY)
        self._choices: dict[str, viser.GuiDropdownHandle[str]] = {}  # by column
        self._connect()

    def _connect(self) -> None:
        actions, client = self._actions, self._client

        def choose(_: object) -> None:
            actions.choose(client)

        for widget in (
            self.skip, self.robot, self.tip, self.convention, self.model, self.joints, self.points,
        ):  # fmt: skip
            on_page(widget, choose)
        for field in self.told.values():
            on_page(field, choose)
        self.open.on_click(lambda _: actions.finish(client))
        self.cancel.on_click(lambda _: actions.cancel(client))

    def show(self, offer: Offer) -> None:
        """Show what was recognised."""
        plan = offer.plan
        self._files.content = WIDE + files_html(offer.files) + elements.note(NOTE)
        for widget in (self.robot, self._columns, self._folder):
            widget.visible = plan is not None
        _offer(self.robot, offer.robots, offer.robot)
        _offer(self.tip, offer.tips or ("–",), offer.tip)
        self.tip.visible = len(offer.tips) > 1
        self.convention.visible, self.model.visible = offer.is_table, offer.needs_model
        tables = tuple(path.name for path in offer.files.tables)
        _offer(self.joints, tables or ("–",), offer.joints)
        _offer(self.points, (SAME, *tables), offer.points)
        self.joints.visible = self.points.visible = plan is not None and _is_open(offer)
        asked: Mapping[str, Question] = {
            FIELDS[re.split("[ =]", one.option)[0]]: one for one in (() if plan is None else plan.asked)
        }
        rows = [(field, one.what, one.guess) for field, one in asked.items()]
        table = Table(("Field", "asks for", "taken if empty"), rows, left=(0, 1, 2))
        self._asked.content = panel([Section("What no file tells", [table])])
        edge_mm = None if plan is None or plan.content is None else plan.content.edge_mm
        if EDGE in asked and edge_mm is not None:
            put(self.told[EDGE], f"{edge_mm:g}")
        usual = (SIGMA, TOOL) if plan is not None and plan.robot is not None and plan.preview is None else ()
        for label, field in self.told.items():
            field.visible = label in (*asked, *usual) or bool(str(field.value).strip())
        outcome = offer.ready if plan is None else plan.preview
        comes_out = [] if outcome is None else [Section(f"What comes out: {preview(outcome)}", [first_rows(outcome)])]
        self._preview.content = panel(comes_out)
        told = Verdict(offer.session, NOTED)
        if plan is None:
            self._said.content = panel([*(Verdict(fault, FAILED) for fault in offer.faults), told])
        else:
            self._columns.content = panel([columns_table(plan.columns)])
            self._said.content = panel([*plan_blocks(plan), told])
            self._correct(plan)
        self._offer_to_skip(plan)
        if self.name.value != offer.name:
            put(self.name, offer.name)
        self.open.disabled = not offer.is_ready
        self.open.label = OPEN

    def _offer_to_skip(self, plan: ImportPlan | None) -> None:
        """Show the tick that leaves bad rows out, where there are some and not too many."""
        self.skip.visible = plan is not None and (plan.can_leave_out or plan.are_left_out)
        if plan is not None and self.skip.visible:
            self.skip.label = f"Leave out {numbers.count(len(plan.bad_rows), 'bad row')}"
        elif self.skip.value:
            put(self.skip, False)

    def _correct(self, plan: ImportPlan) -> None:
        """Show a dropdown for the meaning of each column."""
        joints = 0 if plan.robot is None else plan.robot.robot.n_joints
        labels = [f"{column.name}\0{column.table}" for column in plan.columns]
        for label in [known for known in self._choices if known not in labels]:
            self._choices.pop(label).remove()
        with self._folder:
            for label, column in zip(labels, plan.columns, strict=True):
                options, value = tuple(all_meanings(joints, column)), column_words(column)
                if label not in self._choices:
                    self._choices[label] = self._gui.add_dropdown(
                        column.name, options, initial_value=value, hint=f"{column.table.name}: {column.name}"
                    )
                    on_page(self._choices[label], partial(self._actions.column, self._client, column.name))
                _offer(self._choices[label], options, value)
        self._folder.visible = bool(labels)

    def say(self, words: str) -> None:
        """Show a message on an error or on the current task; the user may try again."""
        self._said.content = elements.alert(words)

    def busy(self) -> None:
        """Show that the import is running."""
        self.open.disabled, self.open.label = True, "Importing …"

    def close(self) -> None:
        """Close the window."""
        if not self._modal.closed:
            self._modal.close()


def _is_open(offer: Offer) -> bool:
    """Whether there are more tables than one of joints and one of points, so that the user has to choose."""
    files = offer.files
    return len(files.tables) > 2 or (len(files.tables) == 2 and files.points is None)


def explain(gui: viser.GuiApi) -> None:
    """Open a window that explains how to start a server that accepts data."""
    modal = gui.add_modal("Your own data")
    with modal:
        gui.add_html(elements.note(HOW) + f"<pre>{COMMANDS}</pre>")
        close = gui.add_button("Close", color=SECONDARY)
    close.on_click(lambda _: modal.close())


def all_meanings(joints: int, column: PlannedColumn | None = None) -> dict[str, Meaning | None]:
    """Meanings that can be assigned to a column, by their label; its present meaning is among them.

    None: it is taken for what its name says, else kept as a further input.
    """
    meanings = [Meaning("pose"), None, Meaning("ignore")]
    meanings += [Meaning(axis, unit) for axis in "xyz" for unit in ("mm", "m", "in")]
    for k in range(1, joints + 1):
        meanings += [Meaning(f"q{k}", unit, sign) for unit in ("deg", "rad") for sign in (1.0, -1.0)]
    meanings += [Meaning(name) for name in (*_OTHERS[1:], *(f"approach{k}" for k in range(1, joints + 1)))]
    if column is not None and column.meaning is not None:
        meanings.append(column.meaning)
    return {meaning_words(meaning): meaning for meaning in meanings}


def _offer(widget: viser.GuiDropdownHandle[str], options: Sequence[str], value: str) -> None:
    """Update options and value of a list, where they differ."""
    if tuple(widget.options) != tuple(options):
        widget.options = tuple(options)
    if widget.value != value and value in options:
        put(widget, value)


# ---- what is shown --------------------------------------------------------------------------------------------------


def files_html(found: UserFiles) -> str:
    """HTML on the kind recognised for each file; unusable files last, in one line."""
    used = [file for file in found.files if file.kind not in (UNUSED, "scan")]
    scans = [file for file in found.files if file.kind == "scan"]
    unused = [f"{_name(file, found.folder)} ({file.why})" for file in found.files if file.kind == UNUSED]
    rows = [(_name(file, found.folder), file.kind, file.why) for file in used[:_MOST_FILES]]
    if len(used) > _MOST_FILES:
        rows.append((f"{len(used) - _MOST_FILES} more", "", ""))
    if scans:
        rows.append((f"{len(scans)} files as {_name(scans[0], found.folder)}", "scans", "a point cloud a pose"))
    not_used = f"Not used: {numbers.in_short(unused, _MOST_UNUSED)}." if unused else ""
    return panel([Table(("File", "is", "seen by"), rows, left=(0, 1, 2)), Paragraph(not_used, soft=True)])


def _name(file: UserFile, folder: Path) -> str:
    return str(file.path.relative_to(folder)) if file.path.is_relative_to(folder) else file.path.name


def meaning_words(meaning: Meaning | None) -> str:
    """Phrase for a meaning, such as "joint 3, deg, other way round"."""
    if meaning is None or meaning.name == "ignore":
        return KEPT if meaning is None else DROPPED
    if quantity_of(meaning.name) != "q":
        return f"{meaning.name}, {meaning.unit}" if meaning.unit else meaning.name
    words = [f"joint {meaning.name[1:]}"]
    words += [meaning.unit] if meaning.unit else []
    words += [OTHER_WAY] if meaning.sign < 0 else []
    words += [f"{meaning.offset:+g}"] if meaning.offset else []
    words += [f"{'less' if sign < 0 else 'and'} joint {name[1:]}" for name, sign in meaning.others]
    return ", ".join(words)


def column_words(column: PlannedColumn) -> str:
    """Phrase for what becomes of a column."""
    return DROPPED if column.why == LEFT_OUT else meaning_words(column.meaning)


def columns_table(columns: Sequence[PlannedColumn]) -> Table:
    """Table of the columns: first value, meaning, and reason."""
    several = len({column.table for column in columns}) > 1
    rows = [
        (
            *([column.table.name] if several else []),
            column.name,
            column.examples[0][:24] if column.examples else "",
            column_words(column),
            column.why,
        )
        for column in columns
    ]
    headers = (*(["Table"] if several else []), "Column", "First value", "Taken for", "Why")
    return Table(headers, rows, left=range(len(headers)), height="13.5rem")


def plan_blocks(plan: ImportPlan) -> list[Paragraph | Verdict]:
    """Blocks on the plan beyond the columns: faults first, then doubts, then notes."""
    many = len(plan.faults)
    count = "" if not many else "This keeps it" if many == 1 else f"These {many} faults keep it"
    left_out = () if plan.content is None else plan.content.notes
    told = [line for line in plan.notes if any(words in line for words in _SHOWN_NOTES)]
    return [
        Paragraph(f"{count} from being imported" if count else "", heading=True),
        *(Verdict(_here(line), FAILED) for line in plan.faults[:_MOST_LINES]),
        Paragraph(f"... and {many - _MOST_LINES} more." if many > _MOST_LINES else "", soft=True),
        *(Verdict(_here(line), DOUBT) for line in plan.doubts[:_MOST_LINES]),
        *(Verdict(line, DOUBT) for line in left_out),
        *(Verdict(_here(line), NOTED) for line in told),
    ]


def _here(line: str) -> str:
    """Line on options of the command, reworded for the page, which has lists and fields instead of options."""
    for said, instead in _ON_PAGE:
        line = re.sub(said, instead, line)
    return line


def _choice(told: re.Match[str]) -> str:
    """A column's meaning as it is chosen on the page, from an option of the command."""
    meaning = meaning_of(told["meaning"])
    words = told["meaning"] if meaning is None or "*" in told["meaning"] else meaning_words(meaning)
    return f"“{words}” for {told['column']} below"


_ON_PAGE: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    ("--map says it otherwise|tell with --map$", f"to change it, open “{CORRECT}”"),
    ("' --map", "', --map"),
    ("(?:tell it|tell|say so) (?:with|by) (?=--map)", "choose "),
    (r"--map '?(?P<column>[^'=]+)=(?P<meaning>[^'\s;,)]+)'?", _choice),
    ("--map", f"“{CORRECT}”"),
    (r"--points FILE(\.csv)?", "a table of points, dropped here"),
    ("--scans FOLDER", "scans, dropped here"),
    ("give --convention", "choose it under “Table is”"),
    ("(--images or --marker-poses)", r"the command “import” with \1"),
)
"""Words on the command's options, and those of the page."""
