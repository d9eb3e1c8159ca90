"""What the tab Compare says of the model's versions and of the jig over the scan, as HTML."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.calibration.evaluation import Figures
from calib.calibration.model_versions import Version
from calib.calibration.noise_check import noise_floor_mm
from inspector.markup import colour_scale as colour_map
from inspector.markup import elements as tables
from inspector.markup import numbers as words
from inspector.markup.palette import FACE_COLOURS, MODEL_COLOURS, ROLE_COLOURS, ROLE_WORDS
from inspector.session.view import BY_ERROR, View

COLUMNS = ("model", "training", "max", "test", "max")


def figures_html(view: View) -> str:
    """The key figures of each version, and what noise alone would leave."""
    rows = [
        (
            tables.named_swatch(MODEL_COLOURS[version.name], version.name),
            *_of(version.evaluation.train),
            *_of(version.evaluation.test),
        )
        for version in view.versions
    ]
    floor = noise_floor_mm(view.versions[-1].calibration)
    noise = "not declared" if floor is None else words.millimetres(floor)
    tested = view.versions[-1].evaluation.test is not None
    return (
        tables.heading("3D errors, mm: RMSE and largest")
        + tables.table(
            COLUMNS, [*rows, ("noise alone", noise, "–", noise if floor is not None and tested else "–", "–")]
        )
        + tables.note("Training poses are fitted; test poses are only predicted.")
    )


def _of(figures: Figures | None) -> tuple[str, str]:
    if figures is None:
        return "–", "–"
    return words.millimetres(figures.rmse_mm), words.millimetres(figures.max_mm)


def arrows_and_points_legend(view: View) -> str:
    """How much is exaggerated, and what the points' colours mean."""
    return exaggeration(view) + points_legend(view)


def exaggeration(view: View) -> str:
    """How many times longer than they are residuals are drawn."""
    return tables.note(
        f"Arrows and predicted points are drawn {view.arrows:g} times farther from the measured points than they are; "
        "the arm is not exaggerated."
    )


def points_legend(view: View) -> str:
    """What the colours of the measured points mean."""
    if view.colouring != BY_ERROR or view.version is None:
        return roles_legend()
    floor = noise_floor_mm(view.version.calibration)
    return colour_map.bar(
        f"Measured points: 3D error of {view.version.name}", 0.0, error_limit_mm(view), colour_map.ERROR,
        mark=None if floor is None else (floor, f"noise alone, {words.length(floor)}"),
    )  # fmt: skip


def distance_bar(distances_mm: NDArray) -> str:
    """The scale of the colours of a scan's points (N,) on the jig."""
    limit = distance_limit_mm(distances_mm)
    return colour_map.bar("Distance to the nearest chosen face", -limit, limit, colour_map.SIGNED)


def pose_html(view: View) -> str:
    """The selected pose's error in each version."""
    rows = [row for version in view.versions if (row := _pose_row(view, version)) is not None]
    if not rows:
        return tables.heading(f"Pose {view.pose_id}") + tables.note("No measured point to compare with.")
    title = tables.heading(f"Pose {view.pose_id}: predicted − measured, mm")
    return (
        title
        + tables.table(("model", "x", "y", "z", "length"), rows)
        + tables.note("In the scanner's frame, mean over the pose's points.")
    )


def _pose_row(view: View, version: Version) -> tuple[object, ...] | None:
    error = version.pose_error_vectors_mm()[view.pose]
    if not np.isfinite(error).all():
        return None
    return (
        tables.named_swatch(MODEL_COLOURS[version.name], version.name),
        *(f"{e:+.4f}" for e in error),
        words.millimetres(float(np.linalg.norm(error))),
    )


def distance_html(view: View, distances_mm: NDArray | None) -> str:
    """How far the scan lies from the three faces that were chosen in it, with the scale of its colours."""
    if view.session.dataset.scan_folder is None:
        return ""
    title = tables.heading(f"Jig over scan {view.pose_id}")
    if distances_mm is None:
        return title + tables.note(
            "No corner was found in this scan, so there is no place for the jig's model."
        )
    known = distances_mm[np.isfinite(distances_mm)]
    if not len(known):
        return title + tables.note("No point of this scan lies on the jig's faces.")
    facts = [
        ("points on the jig", f"{len(known):,} of {len(distances_mm):,}"),
        ("rms distance", words.length(float(np.sqrt(np.mean(known**2))))),
        ("19 in 20 within", f"±{words.length(float(np.percentile(np.abs(known), 95)))}"),
    ]
    return (
        title
        + distance_bar(distances_mm)
        + tables.facts(facts)
        + tables.legend((FACE_COLOURS[i], f"model's face {i + 1}") for i in range(3))
        + tables.note(
            "Positive is outside the jig, towards the scanner. Look for patches of one colour: a bent face."
        )
    )


def roles_legend() -> str:
    """Which colour is which role."""
    return tables.legend((ROLE_COLOURS[r], w) for r, w in ROLE_WORDS.items())


def error_limit_mm(view: View) -> float:
    """The end of the scale of errors: of the chosen version's pose that is off the most."""
    if view.version is None:
        return 1.0
    return colour_map.round_limit(float(np.nanmax(view.version.pose_errors_mm(), initial=0.0)))


def distance_limit_mm(distances_mm: NDArray) -> float:
    """The end of the scale of distances: 98 in 100 of them lie within."""
    known = np.abs(distances_mm[np.isfinite(distances_mm)])
    return colour_map.round_limit(float(np.percentile(known, 98))) if len(known) else 1.0
