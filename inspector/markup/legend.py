"""Legend of the colours in the 3D view, and the ends of its colour scales."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.calibration.model_versions import Version
from calib.calibration.noise_level import noise_level
from calib.dataset.dataset import Dataset
from calib.present.names import ROLES, instrument
from calib.rendering import numbers
from inspector.markup.parts import colour_scale, elements
from inspector.markup.parts.palette import (
    FACE_COLOURS,
    FILTER_COLOURS,
    HIGHLIGHT,
    LEFT_OUT,
    MODEL_BEFORE,
    MODEL_COLOURS,
    REJECTED,
    ROLE_COLOURS,
)
from inspector.session.view import WORST, View, corner_of

EMPTY = "Nothing is on show: choose a view above, or tick a layer below."

SCANS_IN_ROOM = (
    " Other scans are placed in the room by the model on show: where it is right, their jigs lie on one another."
)


def legend_html(view: View, visible: set[str], distances_mm: Array | None, arrows: str = "") -> str:
    """HTML legend of the visible, non-empty layers.

    distances_mm  # (N,) from the scan to the jig
    arrows: words on how long the residuals are.
    """
    if not visible:
        return elements.note(EMPTY)
    search, corner = view.search, view.search.corner if view.search is not None else None
    parts = []
    if "corners" in visible and any(corner_of(view, i) for i in range(len(view.session.dataset.poses))):
        parts.append(roles_legend(view))
        if "corner" not in visible and corner_of(view, view.pose) is not None:
            parts.append(elements.legend([(HIGHLIGHT, f"selected pose, {view.pose_id}")]))
    elif "overview" in visible:
        parts.append(roles_legend(view))
    if corner is not None and visible & {"faces", "jig"}:
        parts.append(elements.legend((colour, f"face {i + 1}") for i, colour in enumerate(FACE_COLOURS)))
    if search is not None and search.groups and visible & {"groups", "sets"}:
        parts.append(elements.legend([(REJECTED, "plane group not chosen")]))
    if search is not None and len(search.sets) and "rejected" in visible:
        numbered = ((colour, i + 1) for i, colour in enumerate(FILTER_COLOURS))
        parts.append(elements.legend(numbered, before="sets rejected by filter"))
    if "distance" in visible and distances_mm is not None and np.isfinite(distances_mm).any():
        parts.append(distance_bar(distances_mm))
    if "corner" in visible and corner_of(view, view.pose) is not None:
        what = "point" if view.session.dataset.scan_folder is None else "corner"
        parts.append(elements.legend([(HIGHLIGHT, f"this {what}, 1σ × {view.factor:g}")]))
    version = view.version
    if version is not None and visible & {"residuals", "predicted"}:
        parts.append(errors_legend(version, view))
        worst = f"arrows × {view.arrows:g}, {arrows}: the {WORST} worst and those selected, to"
        parts.append(elements.legend([(MODEL_COLOURS[version.name], version.name)], before=worst))
        if "before" in visible and view.version_before is not None:
            parts.append(elements.legend([(MODEL_BEFORE, "the model a step before")]))
    if view.session.dataset.robot.carries_scanner and visible & {"corners", "arm", "overview"}:
        parts.append(elements.note(on_flange(view.session.dataset)))
    return "".join(parts)


def on_flange(dataset: Dataset) -> str:
    """Sentences on what is drawn where the arm carries the instrument."""
    named = next((kind.target for kind in dataset.kinds_of_attachments if kind.target), "")
    what = named or ("a jig" if dataset.shows_faces else "a target")
    scans = SCANS_IN_ROOM if dataset.scan_folder is not None else ""
    return (
        f"The arm carries the {instrument(dataset)}, and all is drawn as that sees it: each point is {what} in the "
        f"room, seen at one pose, and the base moves from pose to pose.{scans}"
    )


def errors_legend(version: Version, view: View) -> str:
    """HTML colour scale of a version's errors, with the error by noise alone."""
    level = noise_level(version.calibration)
    floor = level.floor_mm
    mark = None if floor is None else (floor, f"{level.name}, {numbers.length(floor)}")
    return colour_scale.bar(f"3D error: {version.name}", 0.0, error_limit_mm(view), colour_scale.ERROR, mark=mark)


def distance_bar(distances_mm: Array) -> str:
    """HTML colour scale of a scan's distances (N,) to the jig."""
    limit = distance_limit_mm(distances_mm)
    return colour_scale.bar("Distance to the nearest chosen face", -limit, limit, colour_scale.SIGNED)


def roles_legend(view: View) -> str:
    """HTML legend of the roles' colours and, where poses are left out, of the colour of left-out poses."""
    present = set(map(str, view.session.dataset.poses.role))
    out = [(LEFT_OUT, "left out")] if view.session.uncounted else []
    return elements.legend([*((ROLE_COLOURS[r], w) for r, w in ROLES.items() if r in present), *out])


def error_limit_mm(view: View) -> float:
    """Upper end of the colour scale of all versions' errors, mm: below it are nine in ten of the nominal robot's."""
    errors_mm = view.versions[0].pose_errors_mm() if view.versions else np.zeros(0)
    known = errors_mm[np.isfinite(errors_mm)]
    return colour_scale.round_limit(float(np.percentile(known, 90))) if len(known) else 1.0


def distance_limit_mm(distances_mm: Array) -> float:
    """Upper end of the distance colour scale, mm: the 98th percentile."""
    known = np.abs(distances_mm[np.isfinite(distances_mm)])
    return colour_scale.round_limit(float(np.percentile(known, 98))) if len(known) else 1.0
