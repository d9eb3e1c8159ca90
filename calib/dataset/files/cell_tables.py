"""The tables [scanner], [signals], [jig] and [cell] of dataset.toml, read, checked and written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calib.array_types import Vector
from calib.dataset.dataset import Box, Scanner, SignalNoise, Surroundings
from calib.dataset.files.points_csv import LEAST_SIGMA_DEG, LEAST_SIGMA_MM, MOST_SIGMA_DEG, MOST_SIGMA_MM
from calib.errors import CornerError, is_one_line
from calib.jig import Jig, jig_normals
from calib.text_files.toml_table import TomlTable, document_of, is_finite

_FARTHEST_MM = 1e5
_SHORTEST_WAVE_MM = 0.01
_MOST_BOXES = 1000
_LONGEST_EDGE_MM = 1e4
_MOST_UNLIKE_EDGES = 10.0
MOUNTS = ("room", "flange")
_SAYS_NOISE = re.compile("noise|sigma|std|accuracy|uncertainty", re.IGNORECASE)


_KINDS = ("scanner", "camera")  # of the instrument
_SIGMAS = ("declared", "estimated")  # how the sigmas of [scanner] are known


_TOGETHER = (  # keys of [scanner] that only tell something together
    ("field_mm", "distance_mm", "give field_mm = [width, height, depth] and distance_mm, to the field's middle"),
    ("correlated_sigma_mm", "correlation_length_mm", "give the size of the smooth error and how far it reaches"),
)
_LIMITS = {  # of sigmas, by the end of their key
    "sigma_mm": (LEAST_SIGMA_MM, MOST_SIGMA_MM), "orientation_sigma_deg": (LEAST_SIGMA_DEG, MOST_SIGMA_DEG),
    "link_sigma_deg": (1e-9, MOST_SIGMA_DEG), "torque_sigma_nm": (1e-9, 1e5),
}  # fmt: skip


def load_scanner(table: TomlTable) -> Scanner:
    """The instrument that [scanner] declares. Raises DatasetError."""
    found = table.record(Scanner, positive=True)
    _require_sigmas(table)
    field_mm, distance_mm, incidence_deg, length_mm = map(
        found.get, ("field_mm", "distance_mm", "max_incidence_deg", "correlation_length_mm")
    )
    for one, other, remedy in _TOGETHER:
        if (one in found) != (other in found):
            raise table.error(one if other in found else other, "the key is missing", f"{remedy}, or neither")
    if field_mm is not None and not all(0.0 < size <= _FARTHEST_MM for size in field_mm):
        remedy = "width, height and depth of the field, above 0, are needed"
        raise table.error("field_mm", f"found {list(field_mm)}", remedy)
    if field_mm is not None and 0.5 * field_mm[2] >= distance_mm:
        found_words = f"found a depth of {field_mm[2]:g} mm around {distance_mm:g} mm"
        raise table.error("field_mm", found_words, "half the depth is less than distance_mm")
    if incidence_deg is not None and incidence_deg >= 90.0:
        raise table.error("max_incidence_deg", f"found {incidence_deg:g}", "an angle below 90 is needed")
    if length_mm is not None and not _SHORTEST_WAVE_MM <= length_mm <= _FARTHEST_MM:
        remedy = f"a length between {_SHORTEST_WAVE_MM:g} and {_FARTHEST_MM:g} mm is needed"
        raise table.error("correlation_length_mm", f"found {length_mm:g}", remedy)
    return Scanner(
        **found,
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


def _require_sigmas(table: TomlTable) -> None:
    """Raise DatasetError where a standard deviation is outside its limits."""
    for key, sigma in table.data.items():
        for end, (least, most) in _LIMITS.items():
            if key.endswith(end) and is_finite(sigma) and not least <= sigma <= most:
                unit = key.rpartition("_")[2].replace("nm", "Nm")
                remedy = f"a sigma lies between {least:g} and {most:g} {unit}; leave the line out where it is not known"
                raise table.error(key, f"found {sigma:g} {unit}", remedy)


def scanner_document(scanner: Scanner) -> dict[str, Any]:
    """[scanner] as a dict for writing; `load_scanner` reads it back."""
    kind = {"kind": _KINDS[1]} if scanner.is_camera else {}
    sigmas = {"sigmas": _SIGMAS[1]} if scanner.sigmas_estimated else {}
    return document_of(scanner, but=("is_camera", "sigmas_estimated")) | kind | sigmas


def load_signal_noise(table: TomlTable) -> SignalNoise:
    """The noise of signals in poses.csv that [signals] declares. Raises DatasetError."""
    found = table.record(SignalNoise, positive=True)
    _require_sigmas(table)
    return SignalNoise(**found, extra=table.unread())


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
    shape = table.text("shape", default.shape, choices=(default.shape,)) or default.shape
    flags = {key: table.flag(key, getattr(default, key)) for key in ("convex", "certified")}
    return Jig(shape, edge_mm, face_angles_deg=angles, **flags), table.unread()


def _edges(table: TomlTable) -> float | Vector | None:
    """Edge length of the jig in mm, one for all edges or three; None where none is declared."""
    key = "edge_mm"
    found = table.vector(key) if isinstance(table.data.get(key), list) else table.number(key, positive=True)
    lengths = found if isinstance(found, tuple) else () if found is None else (found,)
    for length in lengths:
        if length <= 0:
            raise table.error(key, f"found {length:g}", "lengths above 0 are needed")
        if length > _LONGEST_EDGE_MM:
            raise table.error(key, f"found {length:g} mm", f"an edge has {_LONGEST_EDGE_MM:g} mm at most")
        if length < 1.0:
            raise table.error(key, f"found {length:g} mm, which looks like metres", "multiply it by 1000")
    if lengths and max(lengths) > _MOST_UNLIKE_EDGES * min(lengths):
        remedy = f"the longest may be {_MOST_UNLIKE_EDGES:g} times the shortest; give the part that is scanned"
        raise table.error(key, f"found edges of {list(lengths)} mm", remedy)
    return found


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
    unused = ("boxes", *([] if surroundings.least_manipulability else ["least_manipulability"]))
    boxes = {"boxes": [document_of(box) for box in surroundings.boxes]} if surroundings.boxes else {}
    return document_of(surroundings, but=unused) | boxes
