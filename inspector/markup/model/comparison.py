"""HTML of the tab Compare on the model's versions and on the jig's model over the scan."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.calibration.model_versions import Version
from calib.calibration.noise_level import noise_level
from calib.present.fit.errors import errors_by_version, pose_error_by_version
from calib.present.names import ROLES
from calib.rendering import html, numbers
from calib.rendering.blocks import Block, Facts, Paragraph, Section
from calib.statistics import rms
from inspector.markup.parts import colour_scale, elements
from inspector.markup.parts.palette import FACE_COLOURS, LEFT_OUT, MODEL_COLOURS, ROLE_COLOURS
from inspector.session.view import BY_ERROR, View

ERROR_OF_NONE = "This pose is left out of fits and tests, so it has no error."


def figures_html(view: View) -> str:
    """HTML of each version's key figures, with the error by noise alone."""
    table = errors_by_version(view.versions, MODEL_COLOURS)
    note = "Training poses are fitted; test poses are only predicted."
    return _section("3D errors, mm: RMSE and largest", note, table)


def exaggeration(view: View) -> str:
    """Phrase on the enlargement of drawn residuals; "" where none are drawn."""
    if not any(version.name in view.compared for version in view.versions):
        return ""
    return elements.note(
        f"Arrows and predicted points are drawn {view.arrows:g} times farther from the measured points than they are; "
        "the arm is not exaggerated."
    )


def points_legend(view: View) -> str:
    """HTML legend of the measured points' colours."""
    if view.colouring != BY_ERROR or view.version is None:
        return roles_legend(view)
    return errors_legend(view.version, view)


def errors_legend(version: Version, view: View) -> str:
    """HTML colour scale of a version's errors, with the error by noise alone."""
    level = noise_level(version.calibration)
    floor = level.floor_mm
    mark = None if floor is None else (floor, f"{level.name}, {numbers.length(floor)}")
    return colour_scale.bar(f"3D error of {version.name}", 0.0, error_limit_mm(view), colour_scale.ERROR, mark=mark)


def distance_bar(distances_mm: Array) -> str:
    """HTML colour scale of a scan's distances (N,) to the jig."""
    limit = distance_limit_mm(distances_mm)
    return colour_scale.bar("Distance to the nearest chosen face", -limit, limit, colour_scale.SIGNED)


def pose_html(view: View) -> str:
    """The selected pose's error in each version."""
    table = pose_error_by_version(view.versions, view.pose, MODEL_COLOURS)
    if not table.rows:
        why = ERROR_OF_NONE if view.pose_id in view.session.uncounted else "No measured point to compare with."
        return _section(f"Pose {view.pose_id}", why)
    note = "In the instrument's frame, mean over the pose's points."
    return _section(f"Pose {view.pose_id}: predicted − measured, mm", note, table)


def distance_html(view: View, distances_mm: Array | None) -> str:
    """HTML on the scan's distances to the three faces found in it, with their colour scale."""
    if view.session.dataset.scan_folder is None:
        return ""
    title = f"Jig over scan {view.pose_id}"
    if distances_mm is None:
        return _section(title, "No corner was found in this scan, so there is no place for the jig's model.")
    known = distances_mm[np.isfinite(distances_mm)]
    if not len(known):
        return _section(title, "No point of this scan lies on the jig's faces.")
    facts = Facts(
        [
            ("points on the jig", f"{len(known):,} of {len(distances_mm):,}"),
            ("rms distance", numbers.length(rms(known))),
            ("19 in 20 within", f"±{numbers.length(float(np.percentile(np.abs(known), 95)))}"),
        ]
    )
    told = "Positive is outside the jig, towards the scanner. Look for patches of one colour: a bent face."
    faces = elements.legend((FACE_COLOURS[i], f"model's face {i + 1}") for i in range(3))
    return _section(title, told, facts) + distance_bar(distances_mm) + faces


def _section(title: str, note: str, *blocks: Block) -> str:
    return html.panel([Section(title, [*blocks, Paragraph(note, soft=True)])])


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
