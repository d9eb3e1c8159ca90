"""Tab Planes: sample sets, results of the filters, plane groups, and the three chosen as faces."""

from __future__ import annotations

import viser

from calib.array_types import Array
from calib.corners.search import CornerSearch
from calib.rendering import numbers
from calib.rendering.blocks import Block, Coloured, Paragraph, Section, Table, Verdict
from calib.rendering.html import panel
from calib.targets.search import ScanSearch
from inspector.markup.parts import elements
from inspector.markup.parts.palette import FACE_COLOURS, FAILED, FILTER_COLOURS
from inspector.panels.base import Actions
from inspector.scene.draw_scan import group_colours
from inspector.session.view import View

NOTE = (
    "Each sample set is four points that may lie on one plane. Sets that pass all three filters join into plane "
    "groups; three groups, mutually perpendicular, become the jig's faces. Look for a face that is cut short, two "
    "groups on one face, or a face that sits on the flange."
)
WHY_NOT = (
    "Not chosen: it makes no right angles with two other groups near each other, or its points do not fill the "
    "outline of a face of the jig, or spill over it (a wall, the flange, the arm)."
)
WHY_NONE = "None was chosen: no three groups are mutually perpendicular and fill the outline of the jig."
NOT_SEARCHED = "No planes were looked for in this scan, for the reason above."
NO_PLANES = "No planes are looked for in this scan: its targets are no jig with three faces. See the tab Corner."
HOW = "How they were found"
SHOWN_GROUPS = 15
_USUAL_PASSES = 2  # a coarse one, a fine one
_FILTERS = (
    "too close or too far apart",
    "point normals disagree",
    "triangles off the normals",
)  # why a set is rejected


class PlanesPanel:
    """Counts of sample sets and plane groups of the selected pose."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._show = gui.add_button_group("In 3D", ("Show the planes",))
        self._show.on_click(lambda _: actions.show_view("Planes"))
        self._content = gui.add_html("")
        self._folder = gui.add_folder(HOW, expand_by_default=False)
        with self._folder:
            self._note, self._how = gui.add_html(elements.note(NOTE)), gui.add_html("")

    def update(self, view: View) -> None:
        """Show the selected pose's search."""
        self._show.visible = view.session.dataset.scan_folder is not None
        self._content.content, self._how.content = planes_html(view), how_html(view)
        self._folder.visible = bool(self._how.content)


def planes_html(view: View) -> str:
    """HTML of what came of one pose's planes: the faces that were found, or why there are none."""
    return panel([Paragraph(f"Pose {view.pose_id}", heading=True), *_blocks(view)])


def how_html(view: View) -> str:
    """HTML of how one pose's planes were found: sample sets and plane groups; "" where none were looked for."""
    search = view.search
    if search is None or not len(search.sets):
        return ""
    groups = Section(f"Plane groups ({len(search.groups)})", _group_blocks(search))
    return panel([Section("Sample sets", [_filter_table(search)]), groups])


def _blocks(view: View) -> list[Block | Section]:
    search = view.search
    if search is None:
        waiting = view.session.dataset.scan_path(view.pose) is not None
        measured = "The points were measured (points.csv): there are no planes to look at."
        return [_note("This scan has not been searched yet." if waiting else measured)]
    failure = Verdict(f"No corner: {search.failure}" if search.failure else "", FAILED)
    if not len(search.sets):
        return [failure, _note(NO_PLANES if isinstance(search, ScanSearch) else NOT_SEARCHED)]
    return [failure, Section("Faces of the jig", [_face_table(search), _note(_passes(search))])]


def _note(words: str) -> Paragraph:
    return Paragraph(words, soft=True)


def _filter_table(search: CornerSearch) -> Table:
    """Table of the number of sample sets that each filter rejected."""
    counts = search.filter_counts()
    drawn = max(counts["drawn"], 1)
    filters = (
        (f"filter{k + 1}", Coloured(f"rejected by filter {k + 1}: {why}", FILTER_COLOURS[k]))
        for k, why in enumerate(_FILTERS)
    )
    rows = [
        (label, f"{counts[key]:,}", f"{100 * counts[key] / drawn:.1f} %")
        for key, label in (("drawn", "drawn"), *filters, ("passed", "passed"))
    ]
    return Table(("", "sets", "share"), rows)


def _passes(search: CornerSearch) -> str:
    """Sentence where a scan needed more search passes than usual, as its quality is at the limit."""
    if search.search_passes <= _USUAL_PASSES:
        return ""
    if search.corner is None:
        said = "of which these are the one that got farthest, each with other neighbours and more sample sets."
        return f"The scan was looked at {search.search_passes} times, {said}"
    return (
        f"The jig was found at look {search.search_passes} only, with other neighbours and more sample sets than at "
        "first: it is small, narrow or sparsely seen here. A finer or nearer scan would make it plain."
    )


def _face_table(search: CornerSearch) -> Table:
    """Table of the three faces after refinement on all their points."""
    rows = [
        (
            Coloured(f"face {k + 1}", FACE_COLOURS[k]),
            f"group {face.group + 1}" if face.group >= 0 else "voted for (no group)",
            f"{face.points:,}",
            numbers.length(face.rms_mm),
            _vector(face.normal),
        )
        for k, face in enumerate(search.corner.faces if search.corner else ())
    ]
    return Table(("face", "from", "points", "rms", "normal"), rows, left=(0, 1))


def _group_blocks(search: CornerSearch) -> list[Block]:
    """Table of the plane groups, those with most sets first, and why groups were not chosen."""
    colours = group_colours(search)
    faces = {} if search.corner is None else {face.group: k + 1 for k, face in enumerate(search.corner.faces)}
    rows = [
        (
            Coloured(str(i + 1), colours[i]),
            f"face {faces[i]}" if i in faces else "chosen" if i in search.chosen else "not chosen",
            f"{len(group.sets):,}",
            _vector(group.normal),
            numbers.signed(group.offset_mm, ".1f"),
        )
        for i, group in enumerate(search.groups[:SHOWN_GROUPS])
    ]
    rest = len(search.groups) - len(rows)
    return [
        Table(("group", "became", "sets", "normal", "offset, mm"), rows, left=(0, 1)),
        _note(f"and {numbers.count(rest, 'smaller group')}" if rest > 0 else ""),
        _note(WHY_NOT if search.chosen else WHY_NONE),
    ]


def _vector(values: Array) -> str:
    return " ".join(numbers.signed(value, "+z.2f") for value in values)  # z: no minus before zero
