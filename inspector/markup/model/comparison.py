"""What the tab Compare says of the model's versions and of the jig over the scan, as HTML."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.calibration.evaluation import Figures
from calib.calibration.model_versions import Version
from calib.calibration.noise_level import noise_level
from calib.present import numbers
from calib.present.names import ROLES
from inspector.markup.parts import colour_scale, elements
from inspector.markup.parts.palette import FACE_COLOURS, LEFT_OUT, MODEL_COLOURS, ROLE_COLOURS
from inspector.session.view import BY_ERROR, View

ERROR_OF_NONE = "This pose is left out of fits and tests, so it has no error."
COLUMNS = ("model", "training", "max", "test", "max")


def figures_html(view: View) -> str:
    """The key figures of each version, and what noise alone would leave."""
    rows = [
        (
            elements.named_swatch(MODEL_COLOURS[version.name], version.name),
            *_of(version.evaluation.train),
            *_of(version.evaluation.test),
        )
        for version in view.versions
    ]
    level = noise_level(view.versions[-1].calibration)
    floor = level.floor_mm
    noise = "not declared" if floor is None else numbers.column_mm(floor)
    tested = view.versions[-1].evaluation.test is not None
    return (
        elements.heading("3D errors, mm: RMSE and largest")
        + elements.table(
            COLUMNS, [*rows, (level.name, noise, "–", noise if floor is not None and tested else "–", "–")]
        )
        + elements.note("Training poses are fitted; test poses are only predicted.")
    )


def _of(figures: Figures | None) -> tuple[str, str]:
    if figures is None:
        return "–", "–"
    return numbers.column_mm(figures.rmse_mm), numbers.column_mm(figures.max_mm)


def exaggeration(view: View) -> str:
    """How many times longer than they are residuals are drawn; "" where none are."""
    if not any(version.name in view.compared for version in view.versions):
        return ""
    return elements.note(
        f"Arrows and predicted points are drawn {view.arrows:g} times farther from the measured points than they are; "
        "the arm is not exaggerated."
    )


def points_legend(view: View) -> str:
    """What the colours of the measured points mean."""
    if view.colouring != BY_ERROR or view.version is None:
        return roles_legend(view)
    level = noise_level(view.version.calibration)
    floor = level.floor_mm
    return colour_scale.bar(
        f"Measured points: 3D error of {view.version.name}", 0.0, error_limit_mm(view),
        colour_scale.ERROR,
        mark=None if floor is None else (floor, f"{level.name}, {numbers.length(floor)}"),
    )  # fmt: skip


def distance_bar(distances_mm: Array) -> str:
    """The scale of the colours of a scan's points (N,) on the jig."""
    limit = distance_limit_mm(distances_mm)
    return colour_scale.bar("Distance to the nearest chosen face", -limit, limit, colour_scale.SIGNED)


def pose_html(view: View) -> str:
    """The selected pose's error in each version."""
    rows = [row for version in view.versions if (row := _pose_row(view, version)) is not None]
    if not rows:
        why = ERROR_OF_NONE if view.pose_id in view.session.uncounted else "No measured point to compare with."
        return elements.heading(f"Pose {view.pose_id}") + elements.note(why)
    title = elements.heading(f"Pose {view.pose_id}: predicted − measured, mm")
    return (
        title
        + elements.table(("model", "x", "y", "z", "length"), rows)
        + elements.note("In the scanner's frame, mean over the pose's points.")
    )


def _pose_row(view: View, version: Version) -> tuple[object, ...] | None:
    error = version.pose_error_vectors_mm()[view.pose]
    if not np.isfinite(error).all():
        return None
    return (
        elements.named_swatch(MODEL_COLOURS[version.name], version.name),
        *(f"{e:+.4f}" for e in error),
        numbers.column_mm(float(np.linalg.norm(error))),
    )


def distance_html(view: View, distances_mm: Array | None) -> str:
    """How far the scan lies from the three faces that were chosen in it, with the scale of its colours."""
    if view.session.dataset.scan_folder is None:
        return ""
    title = elements.heading(f"Jig over scan {view.pose_id}")
    if distances_mm is None:
        return title + elements.note("No corner was found in this scan, so there is no place for the jig's model.")
    known = distances_mm[np.isfinite(distances_mm)]
    if not len(known):
        return title + elements.note("No point of this scan lies on the jig's faces.")
    facts = [
        ("points on the jig", f"{len(known):,} of {len(distances_mm):,}"),
        ("rms distance", numbers.length(float(np.sqrt(np.mean(known**2))))),
        ("19 in 20 within", f"±{numbers.length(float(np.percentile(np.abs(known), 95)))}"),
    ]
    return (
        title
        + distance_bar(distances_mm)
        + elements.facts(facts)
        + elements.legend((FACE_COLOURS[i], f"model's face {i + 1}") for i in range(3))
        + elements.note(
            "Positive is outside the jig, towards the scanner. Look for patches of one colour: a bent face."
        )
    )


def roles_legend(view: View) -> str:
    """Which colour is which role that these poses have, and which are left out, where some are."""
    present = set(map(str, view.session.dataset.poses.role))
    out = [(LEFT_OUT, "left out")] if view.session.uncounted else []
    return elements.legend([*((ROLE_COLOURS[r], w) for r, w in ROLES.items() if r in present), *out])


def error_limit_mm(view: View) -> float:
    """The end of the scale of errors: of the chosen version's pose that is off the most."""
    if view.version is None:
        return 1.0
    return colour_scale.round_limit(float(np.nanmax(view.version.pose_errors_mm(), initial=0.0)))


def distance_limit_mm(distances_mm: Array) -> float:
    """The end of the scale of distances: 98 in 100 of them lie within."""
    known = np.abs(distances_mm[np.isfinite(distances_mm)])
    return colour_scale.round_limit(float(np.percentile(known, 98))) if len(known) else 1.0
