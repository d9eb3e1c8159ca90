"""HTML of the tab Planes on one scan: sample sets, plane groups, faces."""

from __future__ import annotations

from calib.corners.search import CornerSearch
from calib.rendering import numbers
from calib.targets.search import ScanSearch
from inspector.markup.parts import elements
from inspector.markup.parts.palette import FACE_COLOURS, FILTER_COLOURS, REJECTED, group_colour
from inspector.session.view import View

WHY_NOT = (
    "Not chosen: it makes no right angles with two other groups near each other, or its points do not fill the "
    "outline of a face of the jig, or spill over it (a wall, the flange, the arm)."
)
WHY_NONE = "None was chosen: no three groups are mutually perpendicular and fill the outline of the jig."
NOT_SEARCHED = "No planes were looked for in this scan, for the reason above."
NO_PLANES = "No planes are looked for in this scan: its targets are no jig with three faces. See the tab Corner."
SHOWN_GROUPS = 15
_USUAL_PASSES = 2  # a coarse one, a fine one


def planes_html(view: View) -> str:
    """HTML of the whole tab Planes for one pose."""
    search = view.search
    title = elements.heading(f"Pose {view.pose_id}")
    if search is None:
        if view.session.dataset.scan_path(view.pose) is None:
            return title + elements.note("The points were measured (points.csv): there are no planes to look at.")
        return title + elements.note("This scan has not been searched yet.")
    failure = elements.alert(f"No corner: {search.failure}") if search.failure else ""
    if isinstance(search, ScanSearch) and not len(search.sets):
        return title + failure + elements.note(NO_PLANES)
    if not len(search.sets):
        return title + failure + elements.note(NOT_SEARCHED)
    return title + failure + filter_table(search) + face_table(search) + group_table(search, view.grey_rejected)


def filter_table(search: CornerSearch) -> str:
    """HTML table of the number of sample sets that each filter rejected."""
    counts = search.filter_counts()
    drawn = max(counts["drawn"], 1)
    names: tuple[tuple[str, object], ...] = (
        ("drawn", "drawn"),
        ("filter1", _rejected(1, "too close or too far apart")),
        ("filter2", _rejected(2, "point normals disagree")),
        ("filter3", _rejected(3, "triangles off the normals")),
        ("passed", "passed"),
    )
    rows = [(label, f"{counts[key]:,}", f"{100 * counts[key] / drawn:.1f} %") for key, label in names]
    return elements.heading("Sample sets") + elements.table(("", "sets", "share"), rows) + passes_note(search)


def _rejected(number: int, why: str) -> elements.Html:
    return elements.named_swatch(FILTER_COLOURS[number - 1], f"rejected by filter {number}: {why}")


def passes_note(search: CornerSearch) -> str:
    """HTML note where a scan needed more search passes than usual, as its quality is at the limit."""
    if search.search_passes <= _USUAL_PASSES:
        return ""
    if search.corner is None:
        said = "of which these are the one that got farthest, each with other neighbours and more sample sets."
        return elements.note(f"The scan was looked at {search.search_passes} times, {said}")
    return elements.note(
        f"The jig was found at look {search.search_passes} only, with other neighbours and more sample sets than at "
        "first: it is small, narrow or sparsely seen here. A finer or nearer scan would make it plain."
    )


def face_table(search: CornerSearch) -> str:
    """HTML table of the three faces after refinement on all their points."""
    if search.corner is None:
        return ""
    rows = []
    for number, face in enumerate(search.corner.faces):
        of = f"group {face.group + 1}" if face.group >= 0 else "voted for (no group)"
        rows.append(
            (
                elements.named_swatch(FACE_COLOURS[number], f"face {number + 1}"),
                of,
                f"{face.points:,}",
                numbers.length(face.rms_mm),
                _vector(face.normal),
            )
        )
    return elements.heading("Faces of the jig") + elements.table(
        ("face", "from", "points", "rms", "normal"), rows, left=2
    )


def group_state(search: CornerSearch, group: int) -> str:
    """State of a plane group: the face that it became, "chosen", or "not chosen"."""
    if search.corner is not None:
        for number, face in enumerate(search.corner.faces):
            if face.group == group:
                return f"face {number + 1}"
    if group in search.chosen:
        return "chosen"
    return "not chosen"


def group_colours(search: CornerSearch, grey: bool) -> list[str]:
    """Colours of the plane groups: a face's colour where the group is a face, else its own colour or grey."""
    colours = [REJECTED if grey else group_colour(i) for i in range(len(search.groups))]
    for i in search.chosen:
        colours[i] = group_colour(i)
    if search.corner is not None:
        for number, face in enumerate(search.corner.faces):
            if face.group >= 0:
                colours[face.group] = FACE_COLOURS[number]
    return colours


def group_table(search: CornerSearch, grey: bool) -> str:
    """HTML table of the plane groups, those with most sets first."""
    colours = group_colours(search, grey)
    rows = []
    for i, group in enumerate(search.groups[:SHOWN_GROUPS]):
        rows.append(
            (
                elements.named_swatch(colours[i], i + 1),
                group_state(search, i),
                f"{len(group.sets):,}",
                _vector(group.normal),
                numbers.signed(group.offset_mm, ".1f"),
            )
        )
    rest = len(search.groups) - len(rows)
    more = elements.note(f"and {numbers.count(rest, 'smaller group')}") if rest > 0 else ""
    return (
        elements.heading(f"Plane groups ({len(search.groups)})")
        + elements.table(("group", "became", "sets", "normal", "offset, mm"), rows, left=2)
        + more
        + elements.note(WHY_NOT if search.chosen else WHY_NONE)
    )


def _vector(v: object) -> str:
    x, y, z = (float(c) for c in v)  # type: ignore[attr-defined]
    return " ".join(numbers.signed(value, "+z.2f") for value in (x, y, z))  # z: no minus before zero
