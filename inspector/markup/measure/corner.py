"""HTML of the tab Corner on one corner: position, covariance, faces and angles."""

from __future__ import annotations

import numpy as np

from calib.present.fit.corners import doubt_blocks, place_table, search_blocks
from calib.rendering import html, numbers
from calib.rendering.blocks import Block, Coloured, Paragraph, Table, Verdict
from calib.rendering.colours import BAD, DOUBT
from calib.targets.search import ScanSearch
from inspector.markup.parts.palette import FACE_COLOURS
from inspector.session.view import View, corner_of


def ellipsoid_words(factor: float) -> str:
    """Explanation of the drawn ellipsoid."""
    return f"ellipsoid: 1σ × {factor:g}"


def corner_html(view: View) -> str:
    """HTML of the whole tab Corner for one pose."""
    return html.panel([Paragraph(f"Pose {view.pose_id}", heading=True), *_corner_blocks(view)])


def _corner_blocks(view: View) -> list[Block]:
    found, search = corner_of(view, view.pose), view.search
    if found is None:
        if search is not None and search.failure:
            return [Verdict(f"{'Not found' if isinstance(search, ScanSearch) else 'No corner'}: {search.failure}", BAD)]
        waiting = view.session.dataset.scan_path(view.pose) is not None
        return [_note("This scan has not been searched yet." if waiting else "Nothing was measured here.")]
    xyz, covariance = found
    corner = None if search is None else search.corner
    drawn = (
        f"Drawn {view.factor:g} times larger than one standard deviation (Display → Ellipsoids ×)."
        if covariance is not None
        else "Its uncertainty is not known: no covariance in points.csv, no point_sigma_mm in dataset.toml."
    )
    what = "point" if view.session.dataset.scan_folder is None else "corner"
    return [
        *([] if corner is None else doubt_blocks(corner)),
        place_table(xyz, covariance),
        _note(drawn),
        *([] if search is None or corner is None else search_blocks(search, FACE_COLOURS)),
        *(_targets(search, view) if isinstance(search, ScanSearch) else []),
        _note(f"Click a {what} in the scene to select its pose."),
    ]


def _note(words: str) -> Paragraph:
    return Paragraph(words, soft=True)


def _targets(search: ScanSearch, view: View) -> list[Block]:
    """HTML on all targets of a scan: places, findings, or reasons why they were not found."""
    rows: list[tuple[object, ...]] = []
    sizes: list[str] = []
    alerts: list[Block] = []
    unnamed = any(not place.name and len(found.names) > 1 for found in search.found for place in found.places)
    named = _names_by_all_poses(view) if unnamed else {}
    for found in search.found:
        names = ", ".join(found.names)
        if found.failure:
            alerts.append(Verdict(f"{names}: {found.failure}", BAD))
        for place in found.places:
            name = named.get(tuple(place.xyz_mm), place.name or names)
            colour = FACE_COLOURS[len(rows) % len(FACE_COLOURS)]  # of its points in the scene
            at = " ".join(numbers.coordinate(value) for value in place.xyz_mm)
            sigma, rms = numbers.column_mm(place.sigma_mm()), numbers.column_mm(place.rms_mm)
            rows.append((Coloured(name, colour), at, sigma, f"{place.points:,}", rms))
            if place.radius_mm is not None:
                sizes.append(f"{name} ø {2 * place.radius_mm:.3f} mm")
            alerts += [Verdict(f"{name}: {doubt}", DOUBT) for doubt in place.doubts]
    table = Table(("target", "x y z, mm", "sigma 3D, mm", "points", "rms, mm"), rows)
    return [
        Paragraph("Targets", heading=True),
        *([table] if rows else []),
        *([_note("; ".join(sizes))] if sizes else []),
        *alerts,
    ]


def _names_by_all_poses(view: View) -> dict[tuple[float, ...], str]:
    """Names of the selected pose's points by place; equal targets are identified from all poses together."""
    points = view.session.measured.points
    if points is None:
        return {}
    rows = np.flatnonzero(points.pose == view.pose)
    return {tuple(points.xyz_mm[row]): str(points.target[row]) for row in rows}
