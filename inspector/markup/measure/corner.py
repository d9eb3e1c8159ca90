"""What the tab Corner says of one corner, as HTML: position, covariance, faces and angles."""

from __future__ import annotations

import numpy as np

from calib.corners.intersection import Corner
from calib.present import numbers
from calib.targets.search import ScanSearch
from inspector.markup.parts import elements
from inspector.markup.parts.palette import DOUBT, FACE_COLOURS
from inspector.session.view import View, corner_of

LEGEND = (
    "Seen at: the angle between the line of sight and the face's normal, 0° is head-on, 90° edge-on. Covered: "
    "the share of the face that has points."
)
PLAIN = 1.05  # a sigma is not worth a word where a smooth error makes it larger by less


def ellipsoid_words(factor: float) -> str:
    """What the drawn ellipsoid is."""
    return f"ellipsoid: 1σ × {factor:g}"


def corner_html(view: View) -> str:
    """The whole tab for one pose."""
    title = elements.heading(f"Pose {view.pose_id}")
    found, search = corner_of(view, view.pose), view.search
    if found is None:
        if search is not None and search.failure:
            words = "Not found" if isinstance(search, ScanSearch) else "No corner"
            return title + elements.alert(f"{words}: {search.failure}")
        waiting = view.session.dataset.scan_path(view.pose) is not None
        return title + elements.note(
            "This scan has not been searched yet." if waiting else "Nothing was measured here."
        )
    xyz, covariance = found
    rows: list[tuple[object, ...]] = []
    for axis, name in enumerate("xyz"):
        sigma = "–" if covariance is None else numbers.length(float(np.sqrt(covariance[axis, axis])))
        rows.append((name, f"{xyz[axis]:.4f}", sigma))
    if covariance is not None:
        rows.append(("all three (3D)", "", numbers.length(float(np.sqrt(np.trace(covariance))))))
    corner = None if search is None else search.corner
    parts = [
        title,
        *([] if corner is None else doubts_html(corner)),
        elements.table(("scanner frame", "position, mm", "sigma"), rows),
        elements.note(
            f"Drawn {view.factor:g} times larger than one standard deviation (Display → Ellipsoids ×)."
            if covariance is not None
            else "Its uncertainty is not known: no covariance in points.csv, no point_sigma_mm in dataset.toml."
        ),
    ]
    if search is not None and corner is not None:
        took = f"{search.seconds:.2f} s, {numbers.count(search.search_passes, 'look')}"
        parts += [*quality_html(corner), elements.facts([*quality_facts(corner), ("search took", took)])]
    if isinstance(search, ScanSearch):
        parts.append(targets_html(search, view))
    what = "point" if view.session.dataset.scan_folder is None else "corner"
    return "".join([*parts, elements.note(f"Click a {what} in the scene to select its pose.")])


def targets_html(search: ScanSearch, view: View) -> str:
    """All targets of a scan: where they are, what was found of them besides, or why they were not found."""
    rows: list[tuple[object, ...]] = []
    sizes, said = [], []
    unnamed = any(not place.name and len(found.names) > 1 for found in search.found for place in found.places)
    named = _names_by_all_poses(view) if unnamed else {}
    for found in search.found:
        names = ", ".join(found.names)
        if found.failure:
            said.append(elements.alert(f"{names}: {found.failure}"))
        for place in found.places:
            name = named.get(tuple(place.xyz_mm), place.name or names)
            colour = FACE_COLOURS[len(rows) % len(FACE_COLOURS)]  # of its points in the scene
            at = " ".join(f"{value:.2f}" for value in place.xyz_mm)
            sigma, rms = numbers.length(place.sigma_mm()), numbers.length(place.rms_mm)
            rows.append((elements.named_swatch(colour, name), at, sigma, f"{place.points:,}", rms))
            if place.radius_mm is not None:
                sizes.append(f"{name} ø {2 * place.radius_mm:.3f} mm")
            said += [elements.alert(f"{name}: {doubt}", colour=DOUBT) for doubt in place.doubts]
    table = elements.table(("target", "x y z, mm", "sigma, 3D", "points", "rms"), rows) if rows else ""
    across = elements.note("; ".join(sizes)) if sizes else ""
    return elements.heading("Targets") + table + across + "".join(said)


def _names_by_all_poses(view: View) -> dict[tuple[float, ...], str]:
    """The names of the selected pose's points by their places: equal targets are told apart by all poses together."""
    points = view.session.measured.points
    if points is None:
        return {}
    rows = np.flatnonzero(points.pose == view.pose)
    return {tuple(points.xyz_mm[row]): str(points.target[row]) for row in rows}


def doubts_html(corner: Corner) -> list[str]:
    """What deserves a look, with what would help."""
    doubts = corner.quality.doubts()
    if not doubts:
        return [elements.note("Nothing about this corner deserves a second look.")]
    return [elements.alert(doubt, colour=DOUBT) for doubt in doubts]


def quality_html(corner: Corner) -> list[str]:
    """Each face with how well it is seen, and the angles between them."""
    quality = corner.quality
    faces = []
    for i, face in enumerate(corner.faces):
        seen = quality.faces[i]
        faces.append(
            (
                elements.named_swatch(FACE_COLOURS[i], f"face {i + 1}"),
                f"{face.points:,}",
                numbers.length(face.rms_mm),
                f"{seen.incidence_deg:.0f}°",
                f"{100 * seen.coverage:.0f} %",
            )
        )
    parts = [elements.table(("face", "points", "rms", "seen at", "covered"), faces)]
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
    parts.append(elements.table(("angle between", "measured", "off the jig's", "sigma"), angles))
    return [*parts, elements.note(LEGEND)]


def quality_facts(corner: Corner) -> list[tuple[str, object]]:
    """What the apex's uncertainty comes from, and which points were left out of the faces."""
    quality = corner.quality
    return [
        ("left out along every edge", f"{quality.margin_mm:.2f} mm"),
        ("apex, against the planes at their middles", f"{quality.amplification:.1f} times less certain"),
        (
            "error that neighbours share",
            f"{numbers.length(quality.smooth_error_mm)} over {quality.smooth_length_mm:.0f} mm: "
            f"sigma × {quality.smooth_factor:.2f}"
            if quality.smooth_factor > PLAIN
            else "next to none",
        ),
        ("angles between the faces", "held to the jig's, which are certified" if quality.rigid else "free"),
    ]
