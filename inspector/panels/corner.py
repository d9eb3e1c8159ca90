"""Tab Corner: where the three faces meet, and how well that is known."""

from __future__ import annotations

import numpy as np
import viser

from calib.intersection import Corner
from inspector import tables
from inspector.palette import FACE_COLOURS
from inspector.panels import words
from inspector.panels.base import Actions, View, corner_of
from inspector.panels.review import roles_legend

NOTE = (
    "The corner is where the three faces meet. Its uncertainty is drawn as an ellipsoid, enlarged so that it can be "
    "seen. Look for a long ellipsoid (a face seen edge-on) and for a face with few points or a large rms."
)


class CornerPanel:
    """The selected corner in numbers."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(tables.note(NOTE))
        both = gui.add_button_group("In 3D", ("Show the corner", "Show all"))
        both.on_click(
            lambda e: actions.look("Corner" if e.target.value == "Show the corner" else "All corners")
        )
        self._content = gui.add_html("")

    def update(self, view: View) -> None:
        """The selected pose's corner."""
        self._content.content = corner_html(view)


def ellipsoid_words(factor: float) -> str:
    """What the drawn ellipsoid is."""
    return f"ellipsoid: 1σ × {factor:g}"


def corner_html(view: View) -> str:
    """The whole tab for one pose."""
    title = tables.heading(f"Pose {view.pose_id}")
    found, search = corner_of(view, view.pose), view.search
    if found is None:
        if search is not None and search.failure:
            return title + tables.alert(f"No corner: {search.failure}")
        waiting = view.session.dataset.scan_path(view.pose) is not None
        return title + tables.note(
            "This scan has not been searched yet." if waiting else "Nothing was measured here."
        )
    xyz, covariance = found
    rows: list[tuple[object, ...]] = []
    for axis, name in enumerate("xyz"):
        sigma = "–" if covariance is None else words.length(float(np.sqrt(covariance[axis, axis])))
        rows.append((name, f"{xyz[axis]:.4f}", sigma))
    if covariance is not None:
        rows.append(("all three", "", words.length(float(np.sqrt(np.trace(covariance))))))
    parts = [
        title,
        tables.table(("scanner frame", "position, mm", "sigma"), rows),
        tables.note(
            f"Drawn {view.factor:g} times larger than one standard deviation (Display → Ellipsoids ×)."
            if covariance is not None
            else "Its uncertainty is not known: no covariance in points.csv, no point_sigma_mm in dataset.toml."
        ),
    ]
    if search is not None and search.corner is not None:
        parts += quality_html(search.corner)
        parts.append(tables.facts([("search took", f"{search.seconds:.2f} s")]))
    parts += [
        tables.heading("All corners in the scene"),
        roles_legend(),
        tables.note("Click a corner to select its pose."),
    ]
    return "".join(parts)


def quality_html(corner: Corner) -> list[str]:
    """Each face with how well it is seen, the angles between them, and what deserves a look."""
    quality = corner.quality
    faces = []
    for i, face in enumerate(corner.faces):
        seen = quality.faces[i]
        faces.append(
            (
                tables.named_swatch(FACE_COLOURS[i], f"face {i + 1}"),
                f"{face.points:,}",
                words.length(face.rms_mm),
                f"{seen.incidence_deg:.0f}°",
                f"{100 * seen.coverage:.0f} %",
            )
        )
    parts = [tables.table(("face", "points", "rms", "seen at", "covered"), faces)]
    angles = [
        (f"faces {pair}", f"{angle:.3f}°", f"{error:+z.3f}°", f"{sigma:.3f}°")
        for pair, angle, error, sigma in zip(
            ("1–2", "2–3", "3–1"),
            quality.angles_deg,
            quality.angle_errors_deg,
            quality.angle_sigmas_deg,
            strict=True,
        )
    ]
    parts.append(tables.table(("angle between", "measured", "off the jig's", "sigma"), angles))
    doubts = quality.doubts()
    parts += [tables.alert(doubt, colour="#E69F00") for doubt in doubts]
    return parts if doubts else [*parts, tables.note("Nothing about this corner deserves a second look.")]
