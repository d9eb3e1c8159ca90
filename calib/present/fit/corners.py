"""Presentation of corners and other targets found in scans: places, sigmas, visibility of the faces, failures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.corners.batch import CornerBatch
from calib.corners.face_bows import FaceBows
from calib.corners.intersection import Corner
from calib.corners.jig_angles import JigAngles
from calib.corners.quality import CornerQuality
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset, FaceLabelling
from calib.measurement.face_labels import FaceLabels
from calib.measurement.measured_points import counted_reasons, failed_searches, label_faces
from calib.present.results import document, keys_of, own_fields, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Coloured,
    Facts,
    KeyFigures,
    Paragraph,
    Presentation,
    Section,
    Span,
    Table,
    Verdict,
    Words,
    pose,
)
from calib.rendering.colours import BAD, DOUBT
from calib.targets.assignment import Assignment, assign_targets
from calib.targets.search import ScanSearch

_SEEN_AT = (
    "Seen at: the angle between the line of sight and the face's normal, 0° is head-on, 90° edge-on. Covered: the "
    "share of the face that has points."
)
_NO_DOUBT = "Nothing about this corner deserves a second look."
_PLAIN = 1.05  # a smooth error that makes the sigma larger by less than this factor is not worth a word
_ANGLES_HELD = {
    "jig": "held at the jig's",
    "scans": "held at those that all scans have in common",
    "": "held only as far as the scans agree with the jig's",
}
_LABELLED_BY = {
    "robot": "the nominal robot",
    "angles": "the jig's unequal angles",
    "continuity": "small turns from pose to pose",
}


# ---- many scans -----------------------------------------------------------------------------------------------------


@presentation.register
def _batch(batch: CornerBatch) -> Presentation:
    blocks = batch_blocks(batch, assign_targets(batch.dataset, batch), None)
    return Presentation(f"Corners of {batch.dataset.name}", blocks)


def batch_blocks(searches: CornerBatch, named: Assignment, labels: FaceLabels | None) -> list[Block]:
    """Blocks on a search of scans: corners and targets, failures with reasons, counts, and the jig's face labels."""
    failed = failed_searches(searches)
    return [
        corner_table(searches),
        target_table(named),
        *failures(searches, named),
        Paragraph(f"No corner: {counted_reasons(failed)}." if len(failed) > 1 else ""),
        batch_head(searches.dataset, searches, named),
        Paragraph(_bows_sentence(searches.face_bows)),
        Paragraph(_angles_sentence(searches.jig_angles)),
        Paragraph("" if labels is None else f"{numbers.capitalised(face_labelling(labels.labelling))}."),
    ]


def _bows_sentence(bows: FaceBows | None) -> str:
    """Sentence on the bows of the jig's faces that all scans tell together; "" where the faces are flat."""
    if bows is None:
        return ""
    sags = ", ".join(f"{sag:+.3f}" for sag in bows.sag_mm)
    text = (
        f"{numbers.count(bows.scans, 'scan')} show the jig's faces bowed: their middles rise by {sags} mm (sigma "
        f"{max(bows.sigma_mm):.2g} mm) over the planes through their corners, and sink where that is negative; each "
        "corner is where the bowed faces meet"
    )
    if bows.outlying:
        text += f"; left as they are, since their faces look different: {', '.join(bows.outlying)}"
    return f"{text}."


def _angles_sentence(angles: JigAngles | None) -> str:
    """Sentence on the angles between the jig's faces that all scans tell together; "" for less than two scans."""
    if angles is None or angles.scans < 2:
        return ""
    meet = ", ".join(f"{angle:.4g}°" if angles.held == "jig" else f"{angle:.4f}°" for angle in angles.angles_deg or ())
    scans = numbers.count(angles.scans, "scan")
    if angles.held == "jig":
        text = f"{scans} agree with the jig's angles ({meet}), which are held in every corner"
    elif angles.held == "scans" and angles.sigmas_deg is not None:
        text = (
            f"{scans} have the jig's faces meet at {meet} (sigma {max(angles.sigmas_deg):.2g}°), not at the angles of "
            "dataset.toml; these are held in every corner: give them as face_angles_deg"
        )
    else:
        text = (
            f"{scans} leave open whether the jig has the angles of dataset.toml (probability "
            f"{numbers.share(angles.probability)}): each corner's sigma counts what they leave open"
        )
    if angles.outlying:
        text += f"; not counted, since their angles are far from all others': {', '.join(angles.outlying)}"
    return f"{text}."


def face_labelling(found: FaceLabelling) -> str:
    """Clause on how the jig's faces were labelled, with the least margin and the poses without labels."""
    words = f"faces named by {_LABELLED_BY[found.by]} at {numbers.count(found.poses, 'pose')}"
    if found.least_margin is not None:
        unit, of_needed = ("°", "°") if found.unit == "deg" else (f" {found.unit}", "")
        words += f", margin {found.least_margin:.4g}{unit} or more (needed: {found.needed_margin:g}{of_needed})"
    if meet := ", ".join(f"{angle:.4f}°" for angle in found.found_angles_deg or ()):
        words += f"; they meet at {meet}, which differs from dataset.toml"
    if found.first_refused is not None:
        pose_id, reason = found.first_refused
        words += f"; {found.refused} refused, {pose_id}: {reason}"
    return words


def batch_head(dataset: Dataset, searches: Mapping[str, CornerSearch], named: Assignment) -> KeyFigures:
    """Block with the number of corners found (or of each target), and their median sigma."""
    corners = [search.corner for search in searches.values() if search.corner is not None]
    pairs: list[tuple[str, object]] = []
    if named.points or named.refused:
        for name in dict.fromkeys(name for target in dataset.all_targets for name in target.names):
            count = sum(name in of_pose for of_pose in named.points.values())
            pairs.append((name, f"found at {count} of {len(dataset.poses)} poses"))
        sigmas_mm = [place.sigma_mm() for of_pose in named.points.values() for place in of_pose.values()]
    else:
        pairs.append(("corners", f"found in {len(corners)} of {numbers.count(len(searches), 'scan')}"))
        sigmas_mm = [corner.sigma_mm() for corner in corners]
    if sigmas_mm:
        pairs.append(("median sigma, 3D", numbers.length(float(np.median(sigmas_mm)))))
    seconds = sum(search.seconds for search in searches.values())
    return KeyFigures([*pairs, ("search", f"{seconds:.1f} s in all")])


def failures(searches: Mapping[str, CornerSearch], named: Assignment) -> list[Block]:
    """Blocks with the scans without a corner, and the targets not found where others were, each with the reason."""
    failed = [(pose(pose_id), why) for pose_id, why in failed_searches(searches).items()]
    refused = [
        (pose(pose_id), name, why)
        for pose_id, reasons in named.refused.items()
        if pose_id in named.points
        for name, why in reasons.items()
    ]
    return [
        Table(("scan without a corner", "why"), failed, left=(0, 1)),
        Table(("scan", "target not found", "why"), refused, left=(0, 1, 2)),
    ]


def corner_table(searches: Mapping[str, CornerSearch]) -> Table:
    """Table with a row for each corner found."""
    found = {pose_id: s.corner for pose_id, s in searches.items() if s.corner is not None}
    dropped = {pose_id: s.count.dropped for pose_id, s in searches.items() if s.count is not None and s.count.dropped}
    rows = [
        (
            pose(pose_id),
            *map(numbers.coordinate, corner.xyz_mm),
            numbers.column_mm(corner.sigma_mm()),
            ", ".join(str(face.points) for face in corner.faces),
            *([f"{dropped[pose_id]:,}" if pose_id in dropped else numbers.MISSING] if dropped else []),
            "; ".join(corner.quality.doubts()) or numbers.MISSING,
        )
        for pose_id, corner in found.items()
    ]
    without = ["points without a value, left out"] if dropped else []
    columns = ("scan", "x, mm", "y, mm", "z, mm", "sigma, mm", "points on the faces", *without, "look at")
    return Table(columns, rows, left=(0, 5, len(columns) - 1))


def target_table(named: Assignment) -> Table:
    """Table with a row for each target of each scan, where other targets than one jig are searched for."""
    rows = [
        (
            pose(pose_id),
            name,
            *map(numbers.coordinate, place.xyz_mm),
            *map(numbers.column_mm, (place.sigma_mm(), place.rms_mm)),
            f"{place.points:,}",
            "; ".join(place.doubts) or numbers.MISSING,
        )
        for pose_id, of_pose in named.points.items()
        for name, place in of_pose.items()
    ]
    columns = ("scan", "target", "x, mm", "y, mm", "z, mm", "sigma, mm", "rms, mm", "points", "look at")
    return Table(columns, rows, left=(0, 1, 8))


def scan_sentences(searches: Mapping[str, CornerSearch]) -> list[Sequence[Span]]:
    """Sentences with the reasons why scans have no corner, and with warnings on corners that were found."""
    doubtful = {
        pose_id: doubts
        for pose_id, search in searches.items()
        if search.corner is not None and (doubts := search.corner.quality.doubts())
    }
    return [
        *((pose(i), f" has no corner and is left out: {reason}.") for i, reason in failed_searches(searches).items()),
        *(("The corner of ", pose(i), f" is doubtful: {'; '.join(doubts)}.") for i, doubts in doubtful.items()),
    ]


# ---- one scan -------------------------------------------------------------------------------------------------------


@presentation.register
def _search(search: CornerSearch) -> Presentation:
    corner = search.corner
    if corner is None:
        return Presentation(search.scan, [Verdict(f"{search.scan}: no corner: {search.failure}", BAD)])
    found = (
        f"{search.scan}: corner ({', '.join(map(numbers.coordinate, corner.xyz_mm))}) mm, sigma "
        f"{numbers.length(corner.sigma_mm())}, faces of "
        f"{', '.join(str(face.points) for face in corner.faces)} points"
    )
    return Presentation(search.scan, [Paragraph(found)], [Section("How well it is seen", search_blocks(search))])


@presentation.register
def _scan_search(search: ScanSearch) -> Presentation:
    return Presentation(search.scan, [Paragraph(f"{search.scan}:"), *scan_blocks(search)])


def scan_blocks(
    search: ScanSearch, names: Mapping[tuple[float, ...], str] = MappingProxyType({}), colours: Sequence[str] = ()
) -> list[Block]:
    """Blocks on all targets of a scan: places and sizes, findings, or reasons why they were not found.

    Args:
        names: of targets by their place, where equal ones are identified from all poses together.
        colours: of the targets' points where they are drawn, one after the other.
    """
    rows: list[tuple[Words, ...]] = []
    sizes: list[str] = []
    alerts: list[Block] = []
    for one in search.found:
        wanted = ", ".join(one.names)
        alerts += [Verdict(f"{wanted}: {one.failure}", BAD)] if one.failure else []
        for place in one.places:
            name = names.get(tuple(place.xyz_mm), place.name or wanted)
            at = " ".join(map(numbers.coordinate, place.xyz_mm))
            sigma, rms = map(numbers.column_mm, (place.sigma_mm(), place.rms_mm))
            shown = Coloured(name, colours[len(rows) % len(colours)]) if colours else name
            rows.append((shown, at, sigma, f"{place.points:,}", rms))
            sizes += [] if place.radius_mm is None else [f"{name} ø {2 * place.radius_mm:.3f} mm"]
            alerts += [Verdict(f"{name}: {doubt}", DOUBT) for doubt in place.doubts]
    table = Table(("target", "x y z, mm", "sigma 3D, mm", "points", "rms, mm"), rows)
    return [table, Paragraph("; ".join(sizes), soft=True), *alerts]


def search_blocks(search: CornerSearch, colours: Sequence[str] = ()) -> list[Block]:
    """Blocks on how well the faces of a scan's corner are visible, and on the sources of its uncertainty.

    colours: of the three faces where they are drawn.
    """
    assert search.corner is not None
    took = f"{search.seconds:.2f} s, {numbers.count(search.search_passes, 'look')}"
    facts = [*_origins(search.corner.quality), ("search took", took)]
    return [*_face_tables(search.corner, colours), Paragraph(_SEEN_AT, soft=True), Facts(facts)]


def doubt_blocks(corner: Corner) -> list[Block]:
    """Blocks with warnings on a corner and what would help."""
    doubts = corner.quality.doubts()
    return [Verdict(doubt, DOUBT) for doubt in doubts] or [Paragraph(_NO_DOUBT, soft=True)]


def place_table(xyz_mm: Array, covariance_mm2: Array | None) -> Table:
    """Table of a point in the scanner's frame with its sigma along each axis."""
    sigmas_mm = [None] * 3 if covariance_mm2 is None else list(np.sqrt(np.diag(covariance_mm2)))
    rows = [
        (name, numbers.coordinate(value), numbers.column_mm(sigma))
        for name, value, sigma in zip("xyz", xyz_mm, sigmas_mm, strict=True)
    ]
    if covariance_mm2 is not None:
        rows.append(("all three (3D)", "", numbers.column_mm(float(np.sqrt(np.trace(covariance_mm2))))))
    return Table(("scanner frame", "position, mm", "sigma, mm"), rows)


def _face_tables(corner: Corner, colours: Sequence[str]) -> Iterator[Table]:
    quality = corner.quality
    faces = []
    for k, (face, seen) in enumerate(zip(corner.faces, quality.faces, strict=True)):
        name = f"face {k + 1}"
        seen_at = (f"{seen.incidence_deg:.0f}°", numbers.share(seen.coverage))
        points = (f"{face.points:,}", numbers.column_mm(face.rms_mm))
        faces.append((Coloured(name, colours[k]) if colours else name, *points, *seen_at))
    yield Table(("face", "points", "rms, mm", "seen at", "covered"), faces)
    pairs = ("1–2", "2–3", "3–1")
    angles = [
        (f"faces {pair}", f"{angle:.3f}°", f"{numbers.signed(error, '+z.3f')}°", f"{sigma:.3f}°")
        for pair, angle, error, sigma in zip(
            pairs, quality.angles_deg, quality.angle_errors_deg, quality.angle_sigmas_deg, strict=True
        )
    ]
    yield Table(("angle between", "measured", "off the jig's", "sigma"), angles)


def _origins(quality: CornerQuality) -> list[tuple[str, object]]:
    """Facts on the sources of the apex's uncertainty, and on points left out of the faces."""
    smooth = (
        f"{numbers.length(quality.smooth_error_mm)} over {quality.smooth_length_mm:.0f} mm: sigma × "
        f"{quality.smooth_factor:.2f}"
    )
    return [
        ("left out along every edge", f"{quality.margin_mm:.2f} mm"),
        ("sigma of the apex", f"{quality.amplification:.1f} times that of the faces"),
        ("error that neighbours share", smooth if quality.smooth_factor > _PLAIN else "next to none"),
        ("angles between the faces", _ANGLES_HELD[quality.angles_held]),
    ]


# ---- documents ------------------------------------------------------------------------------------------------------


@document.register
def _quality_document(quality: CornerQuality) -> dict[str, Any]:
    return {**own_fields(quality), "rigid": quality.rigid, "doubts": quality.doubts()}


@document.register
def _labels_document(labels: FaceLabels) -> dict[str, Any]:
    """Keys on the jig's face labels; quaternions are w, x, y, z of scanner_R_jig."""
    return {
        "named_by": labels.by,
        "margin_unit": labels.unit,
        "found_angles_deg": labels.found_angles_deg,
        "poses": [
            {
                "pose": pose_id,
                "quaternion": found.quaternion(),
                "sigma_rad": found.sigma_rad(),
                "faces": found.order,
                **keys_of(found, "covariance_rad2", "misfit"),
                "off": labels.off.get(pose_id),
                "margin": labels.margin.get(pose_id),
            }
            for pose_id, found in labels.orientations.items()
        ],
        "refused": [{"pose": pose_id, "reason": reason} for pose_id, reason in labels.refused.items()],
    }


@document.register
def _batch_document(batch: CornerBatch) -> dict[str, Any]:
    labels = label_faces(batch.dataset, batch)
    return corners_document(batch, labels, assign_targets(batch.dataset, batch))


def corners_document(searches: CornerBatch, labels: FaceLabels, named: Assignment) -> dict[str, Any]:
    """Document that `corners --json` prints: corners with their planes, the jig's orientations, failures with reasons.

    `targets` are all that have a name, where a dataset has others than one jig.
    """
    found = [_corner_document(i, s, s.corner) for i, s in searches.items() if s.corner is not None]
    failed = [
        {"pose": pose_id, "reason": reason, **_count(searches[pose_id])}
        for pose_id, reason in failed_searches(searches).items()
    ]
    targets = [
        {
            "pose": pose_id,
            "target": name,
            **keys_of(place, "xyz_mm", "covariance_mm2", "points", "rms_mm", "facts", "doubts"),
        }
        for pose_id, of_pose in named.points.items()
        for name, place in of_pose.items()
    ]
    refused = [
        {"pose": pose_id, "target": name, "reason": reason}
        for pose_id, reasons in named.refused.items()
        for name, reason in reasons.items()
    ]
    corners = {"corners": found, "failed": failed, "orientations": labels, "jig_angles": searches.jig_angles}
    corners |= {} if searches.face_bows is None else {"face_bows": searches.face_bows}
    return corners | ({"targets": targets, "targets_failed": refused} if targets or refused else {})


def _corner_document(pose_id: str, search: CornerSearch, corner: Corner) -> dict[str, Any]:
    return {
        "pose": pose_id,
        **keys_of(corner, "xyz_mm", "covariance_mm2", "quality"),
        "planes": [keys_of(face, "normal", "offset_mm", "points", "rms_mm") for face in corner.faces],
        "seconds": search.seconds,
        **_count(search),
    }


def _count(search: CornerSearch) -> dict[str, int | None]:
    count = search.count
    points, dropped = (None, None) if count is None else (count.points, count.dropped)
    return {"points": points, "dropped_points": dropped}
