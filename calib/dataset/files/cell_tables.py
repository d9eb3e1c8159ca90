"""The tables [scanner], [signals], [jig] and [cell] of dataset.toml, read, checked and written."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.dataset.dataset import Box, Scanner, SignalNoise, Surroundings
from calib.dataset.files.points_csv import LEAST_SIGMA_DEG, LEAST_SIGMA_MM, MOST_SIGMA_DEG, MOST_SIGMA_MM
from calib.dataset.files.robot_toml import degrees
from calib.errors import CornerError, is_one_line
from calib.jig import Jig, jig_normals
from calib.text_files.toml_table import TomlTable

_FARTHEST_MM = 1e5
_SHORTEST_WAVE_MM = 0.01
_MOST_BOXES = 1000
_LONGEST_EDGE_MM = 1e4
_MOST_UNLIKE_EDGES = 10.0
MOUNTS = ("room", "flange")
_SAYS_NOISE = re.compile("noise|sigma|std|accuracy|uncertainty", re.IGNORECASE)


_KINDS = ("scanner", "camera")  # of the instrument
_SIGMAS = ("declared", "estimated")  # how the sigmas of [scanner] are known


def load_scanner(table: TomlTable) -> Scanner:
    """The instrument that [scanner] declares. Raises DatasetError."""
    sigma_deg = _sigma(table, "orientation_sigma_deg", LEAST_SIGMA_DEG, MOST_SIGMA_DEG, "deg")
    field_mm, distance_mm = table.vector("field_mm"), table.number("distance_mm", positive=True)
    if field_mm is not None and not all(0.0 < size <= _FARTHEST_MM for size in field_mm):
        raise table.error(
            "field_mm", f"found {list(field_mm)}", "width, height and depth of the field, above 0, are needed"
        )
    if (field_mm is None) != (distance_mm is None):
        missing = "field_mm" if field_mm is None else "distance_mm"
        remedy = "give field_mm = [width, height, depth] and distance_mm, to the field's middle, or neither"
        raise table.error(missing, "the key is missing", remedy)
    if field_mm is not None and distance_mm is not None and 0.5 * field_mm[2] >= distance_mm:
        found = f"found a depth of {field_mm[2]:g} mm around {distance_mm:g} mm"
        raise table.error("field_mm", found, "half the depth is less than distance_mm")
    incidence_deg = table.number("max_incidence_deg", positive=True)
    if incidence_deg is not None and incidence_deg >= 90.0:
        raise table.error("max_incidence_deg", f"found {incidence_deg:g}", "an angle below 90 is needed")
    correlated_mm = _sigma(table, "correlated_sigma_mm", LEAST_SIGMA_MM, MOST_SIGMA_MM, "mm")
    length_mm = table.number("correlation_length_mm", positive=True)
    if (correlated_mm is None) != (length_mm is None):
        missing = "correlated_sigma_mm" if correlated_mm is None else "correlation_length_mm"
        remedy = "give the size of the smooth error and how far it reaches across the view, or neither"
        raise table.error(missing, "the key is missing", remedy)
    if length_mm is not None and not _SHORTEST_WAVE_MM <= length_mm <= _FARTHEST_MM:
        remedy = f"a length between {_SHORTEST_WAVE_MM:g} and {_FARTHEST_MM:g} mm is needed"
        raise table.error("correlation_length_mm", f"found {length_mm:g}", remedy)
    return Scanner(
        orientation_sigma_rad=None if sigma_deg is None else math.radians(sigma_deg),
        point_sigma_mm=_sigma(table, "point_sigma_mm", LEAST_SIGMA_MM, MOST_SIGMA_MM, "mm"),
        scan_sigma_mm=_sigma(table, "scan_sigma_mm", LEAST_SIGMA_MM, MOST_SIGMA_MM, "mm"),
        field_mm=field_mm,
        distance_mm=distance_mm,
        max_incidence_deg=incidence_deg,
        correlated_sigma_mm=correlated_mm,
        correlation_length_mm=length_mm,
        registration_sigma_mm=_sigma(table, "registration_sigma_mm", LEAST_SIGMA_MM, MOST_SIGMA_MM, "mm"),
        place_sigma_mm=_sigma(table, "place_sigma_mm", LEAST_SIGMA_MM, MOST_SIGMA_MM, "mm"),
        is_camera=table.text("kind", _KINDS[0], choices=_KINDS) == _KINDS[1],
        sigmas_estimated=table.text("sigmas", _SIGMAS[0], choices=_SIGMAS) == _SIGMAS[1],
        extra=table.unread(),
    )


def unused_keys(path: Path, tables: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Notes on keys of tables of dataset.toml that are kept and not used: a name that was meant otherwise, perhaps."""
    return tuple(
        f"{path}: [{table}] {key} is no key of the format and is not used"
        + (f"; the noise of a point is [{table}] point_sigma_mm" if _SAYS_NOISE.search(key) else "")
        for table, keys in tables.items()
        for key in keys
    )


def load_mount(table: TomlTable) -> bool:
    """Whether [scanner] declares that the arm carries the scanner; by default the scanner is fixed in the world."""
    return table.text("mount", "room", choices=MOUNTS) == "flange"


def _sigma(table: TomlTable, key: str, least: float, most: float, unit: str) -> float | None:
    """Standard deviation under a key, in its unit, checked against the limits; None where the key is absent."""
    sigma = table.number(key, positive=True)
    if sigma is not None and not least <= sigma <= most:
        raise table.error(
            key,
            f"found {sigma:g} {unit}",
            f"a sigma lies between {least:g} and {most:g} {unit}; leave the line out where it is not known",
        )
    return sigma


def scanner_document(scanner: Scanner) -> dict[str, Any]:
    """[scanner] as a dict for writing; `load_scanner` reads it back."""
    sigma_rad = scanner.orientation_sigma_rad
    declared: dict[str, Any] = {
        "point_sigma_mm": scanner.point_sigma_mm,
        "scan_sigma_mm": scanner.scan_sigma_mm,
        "correlated_sigma_mm": scanner.correlated_sigma_mm,
        "correlation_length_mm": scanner.correlation_length_mm,
        "registration_sigma_mm": scanner.registration_sigma_mm,
        "place_sigma_mm": scanner.place_sigma_mm,
        "orientation_sigma_deg": None if sigma_rad is None else math.degrees(sigma_rad),
        "field_mm": None if scanner.field_mm is None else list(scanner.field_mm),
        "distance_mm": scanner.distance_mm,
        "max_incidence_deg": scanner.max_incidence_deg,
    }
    if scanner.is_camera:
        declared["kind"] = _KINDS[1]
    if scanner.sigmas_estimated:
        declared["sigmas"] = _SIGMAS[1]
    return {key: value for key, value in declared.items() if value is not None} | dict(scanner.extra)


def load_signal_noise(table: TomlTable) -> SignalNoise:
    """The noise of signals in poses.csv that [signals] declares. Raises DatasetError."""
    link_deg = _sigma(table, "link_sigma_deg", 1e-9, MOST_SIGMA_DEG, "deg")
    return SignalNoise(
        torque_sigma_nm=_sigma(table, "torque_sigma_nm", 1e-9, 1e5, "Nm"),
        link_sigma_rad=None if link_deg is None else math.radians(link_deg),
        extra=table.unread(),
    )


def signal_noise_document(noise: SignalNoise) -> dict[str, Any]:
    """[signals] as a dict for writing; `load_signal_noise` reads it back."""
    link_rad = noise.link_sigma_rad
    declared = {
        "torque_sigma_nm": noise.torque_sigma_nm,
        "link_sigma_deg": None if link_rad is None else degrees(link_rad),
    }
    return {key: value for key, value in declared.items() if value is not None} | dict(noise.extra)


def load_jig(table: TomlTable) -> tuple[Jig, dict[str, Any]]:
    """The jig that [jig] declares, and its unknown keys, which are kept. Raises DatasetError."""
    default = Jig()
    edge_mm = _edges(table) or default.edge_mm
    angles = table.vector("face_angles_deg") or default.face_angles_deg
    if not all(10.0 < angle < 170.0 for angle in angles):
        raise table.error("face_angles_deg", f"found {list(angles)}", "angles between faces lie between 10 and 170")
    try:
        jig_normals(angles)
    except CornerError:
        raise table.error(
            "face_angles_deg", f"found {list(angles)}", "no corner has such faces, a cube's has [90, 90, 90]"
        ) from None
    jig = Jig(
        shape=table.text("shape", default.shape, choices=(default.shape,)) or default.shape,
        edge_mm=edge_mm,
        convex=table.flag("convex", default.convex),
        face_angles_deg=angles,
        certified=table.flag("certified", default.certified),
    )
    return jig, table.unread()


def _edges(table: TomlTable) -> float | tuple[float, float, float] | None:
    """Edge length of the jig in mm, one for all edges or three; None where none is declared."""
    key, three = "edge_mm", None
    if isinstance(table.data.get(key), list):
        three = table.vector(key)
    one = None if three else table.number(key, positive=True)
    lengths: tuple[float, ...] = three or (() if one is None else (one,))
    for length in lengths:
        if length <= 0:
            raise table.error(key, f"found {length:g}", "lengths above 0 are needed")
        if length > _LONGEST_EDGE_MM:
            raise table.error(key, f"found {length:g} mm", f"an edge has {_LONGEST_EDGE_MM:g} mm at most")
        if length < 1.0:
            raise table.error(key, f"found {length:g} mm, which looks like metres", "multiply it by 1000")
    if three and max(three) > _MOST_UNLIKE_EDGES * min(three):
        remedy = f"the longest may be {_MOST_UNLIKE_EDGES:g} times the shortest; give the part that is scanned"
        raise table.error(key, f"found edges of {list(three)} mm", remedy)
    return three or one


def jig_document(jig: Jig) -> dict[str, Any]:
    """[jig] as a dict for writing; `load_jig` reads it back."""
    return {
        "shape": jig.shape,
        "edge_mm": list(jig.edge_mm) if isinstance(jig.edge_mm, tuple) else jig.edge_mm,
        "convex": jig.convex,
        "face_angles_deg": list(jig.face_angles_deg),
        "certified": jig.certified,
    }


def load_surroundings(table: TomlTable) -> Surroundings:
    """The floor, boxes and least manipulability that [cell] declares. Raises DatasetError."""
    floor_z_mm = table.number("floor_z_mm")
    if floor_z_mm is not None and abs(floor_z_mm) > _FARTHEST_MM:
        remedy = f"a height within {_FARTHEST_MM:g} mm of the base is needed"
        raise table.error("floor_z_mm", f"found {floor_z_mm:g}", remedy)
    rows = table.tables("boxes")
    if len(rows) > _MOST_BOXES:
        raise table.error("boxes", f"found {len(rows)}", f"{_MOST_BOXES} or fewer would do")
    boxes = [_box(row, f"box {i + 1}") for i, row in enumerate(rows)]
    names = [box.name for box in boxes]
    for row, name in zip(rows, names, strict=True):
        if names.count(name) > 1:
            raise row.error("name", f"found {name!r} more than once", "give each box a name of its own")
    manipulability = table.number("least_manipulability", 0.0) or 0.0
    if not 0.0 <= manipulability < 1.0:
        raise table.error("least_manipulability", f"found {manipulability:g}", "0 (off) to below 1 is needed")
    return Surroundings(floor_z_mm, tuple(boxes), manipulability, table.unread())


def _box(row: TomlTable, default_name: str) -> Box:
    name = row.text("name", default_name) or default_name
    if not is_one_line(name):
        raise row.error("name", f"found {name!r}", "a name is one line without control characters")
    corners = {key: row.vector(key) for key in ("min_mm", "max_mm")}
    for key, corner in corners.items():
        if corner is None:
            raise row.error(key, "the key is missing", f"add a line such as {key} = [0.0, 0.0, 0.0]")
        if max(map(abs, corner)) > _FARTHEST_MM:
            remedy = f"a corner within {_FARTHEST_MM:g} mm of the base is needed"
            raise row.error(key, f"found {list(corner)}", remedy)
    low, high = corners["min_mm"], corners["max_mm"]
    assert low is not None
    assert high is not None
    for axis, least, most in zip("xyz", low, high, strict=True):
        if least >= most:
            found = f"found {axis} {most:g}, and min_mm has {least:g}"
            raise row.error("max_mm", found, "each number is larger than that of min_mm")
    for key in row.unread():
        raise row.error(key, "is no key of a box", "name, min_mm and max_mm are")
    return Box(name, low, high)


def surroundings_document(surroundings: Surroundings) -> dict[str, Any]:
    """[cell] as a dict for writing, empty where nothing is declared; `load_surroundings` reads it back."""
    document: dict[str, Any] = {}
    if surroundings.floor_z_mm is not None:
        document["floor_z_mm"] = surroundings.floor_z_mm
    if surroundings.least_manipulability:
        document["least_manipulability"] = surroundings.least_manipulability
    document |= surroundings.extra
    if surroundings.boxes:
        document["boxes"] = [
            {"name": box.name, "min_mm": list(box.min_mm), "max_mm": list(box.max_mm)} for box in surroundings.boxes
        ]
    return document
