"""The files that scans come in: .ply, .pcd, .xyz and .stl, each read into points and, where it has them, normals.

trimesh and Open3D read the files, but neither can be trusted with a damaged one: trimesh returns what it found of a
truncated text file, Open3D fills up with zeros and prints. So what the header promises is held against the file first.
All readers raise ScanError with what was found.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import ScanError

_MOST_HEADER_BYTES = 65536
_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


def _read_ply(path: Path) -> tuple[NDArray, NDArray | None]:
    promised = _check_ply_header(path)
    import trimesh

    try:
        loaded = trimesh.load(path, process=False)
        points = np.asarray(loaded.vertices, dtype=np.float64)
        raw = loaded.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
        names = raw.dtype.names if isinstance(raw, np.ndarray) else raw
        normals = None
        if all(n in names for n in ("nx", "ny", "nz")):  # trimesh keeps them for meshes only
            normals = np.stack(
                [np.asarray(raw[n], dtype=np.float64).ravel() for n in ("nx", "ny", "nz")], axis=1
            )
    except Exception as error:  # whatever the reader trips over, it is the file's content
        raise ScanError(f"{path}: not a readable .ply ({_one_line(error)}); export the scan again") from None
    if len(points) < promised:
        raise _truncated(path, promised, len(points))
    return points, normals


def _check_ply_header(path: Path) -> int:
    """The number of vertices that the header promises, once the file is seen to be long enough for them."""
    with path.open("rb") as file:
        head = file.read(_MOST_HEADER_BYTES)
    if not head.startswith(b"ply"):
        raise ScanError(f"{path}: not a .ply file (it starts with {head[:8]!r}); export the scan as .ply")
    end = head.find(b"end_header")
    body_start = head.find(b"\n", end) + 1
    if end < 0 or body_start == 0:
        raise ScanError(f"{path}: the .ply header has no end_header line; export the scan again")
    words = [line.split() for line in head[:end].decode("ascii", "replace").splitlines()]
    elements = [i for i, w in enumerate(words) if w[:1] == ["element"]]
    vertex = next((i for i in elements if words[i][1:2] == ["vertex"] and len(words[i]) == 3), None)
    if vertex is None or not words[vertex][2].isdigit():
        raise ScanError(f"{path}: the .ply header names no vertices; export the scan as a point cloud")
    promised = int(words[vertex][2])
    if promised == 0:
        raise ScanError(f"{path}: the scan holds no points (element vertex 0); scan the pose again")
    following = min((i for i in elements if i > vertex), default=len(words))
    properties = [w for w in words[vertex + 1 : following] if w[:1] == ["property"]]
    names = {w[-1] for w in properties}
    if not {"x", "y", "z"} <= names:
        raise ScanError(
            f"{path}: the .ply vertices have no x, y, z (found: {', '.join(sorted(names)) or 'nothing'})"
        )
    if vertex == elements[0]:  # else what lies before the vertices may be of any length
        held = promised
        if ["format", "ascii"] in (w[:2] for w in words):
            with path.open("rb") as file:
                file.seek(body_start)
                held = sum(bool(line.strip()) for line in file)
        elif all(len(w) == 3 and w[1] in _PLY_BYTES for w in properties):
            held = (path.stat().st_size - body_start) // sum(_PLY_BYTES[w[1]] for w in properties)
        if held < promised:
            raise _truncated(path, promised, held)
    return promised


def _read_pcd(path: Path) -> tuple[NDArray, NDArray | None]:
    _check_pcd_header(path)
    import open3d

    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(path, format="pcd")
    points = np.asarray(cloud.points)
    if not len(points):
        raise ScanError(f"{path}: no points could be read from the .pcd; export the scan again, or as .ply")
    return points, np.asarray(cloud.normals) if cloud.has_normals() else None


def _check_pcd_header(path: Path) -> None:
    """See that a .pcd holds the points that its header promises."""
    content = path.read_bytes()
    fields: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in fields and (end := content.find(b"\n", start, _MOST_HEADER_BYTES)) >= 0:
        words = content[start:end].decode("ascii", "replace").split()
        fields |= {words[0]: words[1:]} if words else {}
        start = end + 1
    try:
        promised, kind = int(fields["POINTS"][0]), fields["DATA"][0]
        counts = [int(c) for c in fields.get("COUNT", ["1"] * len(fields["SIZE"]))]
        row = sum(int(s) * c for s, c in zip(fields["SIZE"], counts, strict=True))
    except (KeyError, IndexError, ValueError):
        raise ScanError(
            f"{path}: not a .pcd file (no POINTS, SIZE and DATA lines); export the scan again"
        ) from None
    body = content[start:]
    if kind == "ascii":
        held = sum(bool(line.strip()) for line in body.splitlines())
    elif kind == "binary":
        held = len(body) // row if row else 0
    else:  # binary_compressed: the length of the compressed block, then that of the points, then the block
        whole = len(body) >= 8 and len(body) - 8 >= int.from_bytes(body[:4], "little")
        held = promised if whole else 0
    if held < promised:
        raise _truncated(path, promised, held)


def _read_xyz(path: Path) -> tuple[NDArray, None]:
    try:
        text = path.read_text("utf-8").replace(",", " ").replace(";", " ")
        lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
        rows = np.loadtxt(lines, ndmin=2, usecols=(0, 1, 2)) if lines else np.zeros((0, 3))
    except ValueError as error:  # also what is not text at all
        raise ScanError(
            f"{path}: not three numbers a line ({_one_line(error)}); write x y z in each line"
        ) from None
    return rows, None


def _read_stl(path: Path) -> tuple[NDArray, None]:
    import trimesh

    try:
        mesh = trimesh.load(path, process=False)
        vertices = np.asarray(getattr(mesh, "vertices", np.zeros((0, 3))), dtype=np.float64)
    except Exception as error:  # whatever the reader trips over, it is the file's content
        raise ScanError(f"{path}: not a readable .stl ({_one_line(error)}); export the scan again") from None
    if not len(vertices):
        raise ScanError(
            f"{path}: not a readable .stl (no triangles in it, or cut short); export the scan again"
        )
    return np.unique(vertices, axis=0), None  # each vertex once, not once a triangle


def _truncated(path: Path, promised: int, held: int) -> ScanError:
    return ScanError(
        f"{path}: the file is truncated: its header promises {promised} points, it holds {held}; "
        "copy or export the scan again"
    )


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


READERS: dict[str, Callable[[Path], tuple[NDArray, NDArray | None]]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    ".xyz": _read_xyz,
    ".stl": _read_stl,
}
"""By suffix: path -> points (N, 3), non-finite rows included, and normals (N, 3) or None."""
