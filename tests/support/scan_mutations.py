"""Scan files that somebody damaged: every format written plainly, clouds without a corner, and ways to spoil bytes.

The writers share no code with the readers.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

Writer = Callable[[NDArray], bytes]


def _ply(order: str, kind: str) -> Writer:
    def write(points: NDArray) -> bytes:
        word = "double" if kind.endswith("8") else "float"
        header = f"ply\nformat {order} 1.0\ncomment from a test\nelement vertex {len(points)}\n"
        header += "".join(f"property {word} {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        rows = np.hstack([points, np.tile([0.0, 0.0, -1.0], (len(points), 1))])
        header += "property uchar red\nend_header\n"
        if order == "ascii":
            return header.encode() + _text(rows, " ", " 7")
        row = np.dtype([("rows", kind, 6), ("red", "u1")])
        table = np.zeros(len(points), row)
        with np.errstate(over="ignore"):
            table["rows"] = rows
        return header.encode() + table.tobytes()

    return write


def _pcd(data: str) -> Writer:
    def write(points: NDArray) -> bytes:
        n = len(points)
        header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        header += f"WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
        if data == "ascii":
            return header.encode() + _text(points, " ", " 255")
        with np.errstate(over="ignore"):
            columns = np.vstack([points.T.astype("<f4").view("<u4"), np.full((1, n), 0, dtype="<u4")])
        if data == "binary":
            return header.encode() + np.ascontiguousarray(columns.T).tobytes()
        packed = _lzf(columns.tobytes())
        lengths = len(packed).to_bytes(4, "little") + columns.nbytes.to_bytes(4, "little")
        return header.encode() + lengths + packed

    return write


def _lzf(data: bytes) -> bytes:
    """LZF with no other repeats than runs of zeros: enough to have both kinds of instruction."""
    out = bytearray()
    for piece in re.findall(rb"\0{10,250}|(?:(?!\0{10}).){1,32}", data, re.DOTALL):
        run = len(piece) >= 10 and not any(piece)  # one literal zero, then 7 + 2 + more of what is one byte back
        out += bytes([0, 0, 0xE0, len(piece) - 10, 0]) if run else bytes([len(piece) - 1]) + piece
    return bytes(out)


def _text(rows: NDArray, delimiter: str, end: str = "") -> bytes:
    return "".join(delimiter.join(f"{v:.9g}" for v in row) + f"{end}\n" for row in rows).encode()


def _stl(points: NDArray) -> bytes:
    triangles = points[: len(points) // 3 * 3].reshape(-1, 3, 3)
    table = np.zeros(len(triangles), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    with np.errstate(over="ignore"):
        table["v"] = triangles
    return b"a mesh".ljust(80) + len(triangles).to_bytes(4, "little") + table.tobytes()


def _stl_text(points: NDArray) -> bytes:
    text = "solid mesh\n"
    for triangle in points[: len(points) // 3 * 3].reshape(-1, 3, 3):
        corners = "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in triangle)
        text += f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
    return (text + "endsolid mesh\n").encode()


def _obj(points: NDArray) -> bytes:
    vertices = b"".join(b"v " + line + b"\n" for line in _text(points, " ").splitlines())
    return b"# mesh\no scan\n" + vertices + b"f 1 2 3\n"


def _npz(save: Callable[..., None]) -> Writer:
    def write(points: NDArray) -> bytes:
        file = BytesIO()
        save(file, points=points.astype(np.float64), normals=np.tile([0.0, 0, 1], (len(points), 1)))
        return file.getvalue()

    return write


def _npy(points: NDArray) -> bytes:
    file = BytesIO()
    np.save(file, points)
    return file.getvalue()


def las(points: NDArray, *, version: int = 2, point_format: int = 1, more: int = 16, scale: float = 1e-5) -> bytes:
    """A LAS file of version 1.`version` with `more` bytes after each point's coordinates."""
    size = 375 if version >= 4 else 227
    header = bytearray(size)
    header[:4], header[24], header[25] = b"LASF", 1, version
    count = 0 if version >= 4 else len(points)
    struct.pack_into("<HI4xBHI", header, 94, size, size, point_format, 12 + more, count)
    struct.pack_into("<6d", header, 131, scale, scale, scale, 1.0, -2.0, 3.0)
    if version >= 4:
        struct.pack_into("<Q", header, 247, len(points))
    rows = np.zeros((len(points), 12 + more), dtype=np.uint8)
    whole = np.round((points - [1.0, -2.0, 3.0]) / scale)
    rows[:, :12] = whole.astype("<i4").view(np.uint8).reshape(-1, 12)
    return bytes(header) + rows.tobytes()


WRITERS: dict[str, Writer] = {
    "text.ply": _ply("ascii", "f4"),
    "little.ply": _ply("binary_little_endian", "<f4"),
    "big.ply": _ply("binary_big_endian", ">f8"),
    "text.pcd": _pcd("ascii"),
    "binary.pcd": _pcd("binary"),
    "compressed.pcd": _pcd("binary_compressed"),
    "plain.xyz": lambda points: _text(points, " "),
    "header.csv": lambda points: b"x,y,z,i\n" + _text(points, ",", ",1"),
    "comments.txt": lambda points: b"# id; x; y; z\n# mm\n" + _text(points, ";"),
    "mesh.stl": _stl,
    "text.stl": _stl_text,
    "mesh.obj": _obj,
    "stored.npz": _npz(np.savez),
    "packed.npz": _npz(np.savez_compressed),
    "array.npy": _npy,
    "points.las": las,
    "points of 1.4.las": lambda points: las(points, version=4, point_format=6, more=18),
}
"""By file name: points (N, 3) -> the bytes of a good file."""


def _plane(rng: np.random.Generator, n: int, z_mm: float = 700.0) -> NDArray:
    return np.column_stack([rng.uniform(-80, 80, (n, 2)), z_mm + 0.02 * rng.standard_normal(n)])


CLOUDS: dict[str, Callable[[np.random.Generator], NDArray]] = {
    "0 to 12 points": lambda rng: rng.uniform(-30, 30, (rng.integers(0, 13), 3)),
    "all equal": lambda rng: np.tile(rng.uniform(-700, 700, 3), (1500, 1)),
    "three spots": lambda rng: rng.uniform(-700, 700, (3, 3))[np.arange(1500) % 3],
    "on a line": lambda rng: np.outer(rng.uniform(-90, 90, 1500), rng.normal(size=3)) + np.array([0, 0, 700]),
    "one plane": lambda rng: _plane(rng, 1500),
    "two planes": lambda rng: np.vstack([_plane(rng, 800), _plane(rng, 800)[:, [0, 2, 1]] - [0, 780, -780]]),
    "three parallel planes": lambda rng: np.vstack([_plane(rng, 600, z) for z in (650.0, 700.0, 750.0)]),
    "NaN": lambda rng: np.full((2000, 3), np.nan),
    "half NaN": lambda rng: np.where(rng.random((1500, 1)) < 0.5, np.nan, _plane(rng, 1500)),
    "1e9 mm wide": lambda rng: rng.uniform(-1e9, 1e9, (1500, 3)),
    "1e9 mm away": lambda rng: _plane(rng, 1500) + 1e9,
    "1e300": lambda rng: _plane(rng, 1500) * 10.0 ** rng.integers(10, 300),
    "1e-300": lambda rng: _plane(rng, 1500) * 10.0 ** -rng.integers(10, 300),
    "metres": lambda rng: _plane(rng, 1500) / 1000,
    "few values": lambda rng: np.round(rng.uniform(-60, 60, (1500, 3)) / 60) * 60 + [0, 0, 700],
    "a few far off": lambda rng: np.vstack(
        [_plane(rng, 1500), rng.uniform(-1, 1, (9, 3)) * 10.0 ** rng.integers(3, 12)]
    ),
}
"""By name: clouds that hold no corner."""


def _at(rng: np.random.Generator, content: bytes, most: int = 10**9) -> int:
    return int(rng.integers(0, max(1, min(len(content), most))))


def _replace(content: bytes, at: int, new: bytes) -> bytes:
    return content[:at] + new + content[at + len(new) :]


_ODD = (
    b"0", b"1", b"-1", b"1e999", b"-1e308", b"4294967295", b"9" * 400, b"nan", b"inf", b"7", b"900", b"", b"0x10",
    b"1_000", b"1,5", "\u0663".encode(), b"\0", b"&x;", b"[", b"]]>", b"<!--", b"\xff\xfe", b"\n", b'"', b"null", b"*a",
    b"&a", b"!!python/object", b"../../../etc/passwd",
)  # fmt: skip


def _other_number(rng: np.random.Generator, content: bytes) -> bytes:
    """Something else in place of one of the numbers, of the header most of all."""
    found = list(re.finditer(rb"(?<![\w.])-?\d+\.?\d*", content[: int(rng.choice([400, 10_000]))]))
    if not found:
        return _flip(rng, content)
    match = found[rng.integers(len(found))]
    return content[: match.start()] + _ODD[rng.integers(len(_ODD))] + content[match.end() :]


def _other_lines(rng: np.random.Generator, content: bytes) -> bytes:
    """A line left out, doubled or exchanged with another."""
    lines = content.splitlines(keepends=True) or [b""]
    i, j = rng.integers(len(lines), size=2)
    lines[i] = (b"", lines[i] * 2, lines[j])[rng.integers(3)]
    return b"".join(lines)


def _other_word(rng: np.random.Generator, content: bytes) -> bytes:
    """A word of the header left out, doubled, or in another's place."""
    found = list(re.finditer(rb"[A-Za-z_]\w*", content[:400]))
    if len(found) < 2:
        return _flip(rng, content)
    match, other = (found[rng.integers(len(found))] for _ in range(2))
    new = (b"", match[0] + b" " + match[0], other[0], b"list uchar float")[rng.integers(4)]
    return content[: match.start()] + new + content[match.end() :]


def _flip(rng: np.random.Generator, content: bytes) -> bytes:
    for _ in range(int(rng.integers(1, 30))):
        content = _replace(content, _at(rng, content), bytes([rng.integers(256)]))
    return content


def _floats(rng: np.random.Generator, content: bytes) -> bytes:
    """NaN, infinities, the largest and the smallest numbers wherever they fall."""
    values = np.array([np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 1e-45, 1e9, 0.0])
    for _ in range(int(rng.integers(1, 200))):
        new = values[rng.integers(len(values))].astype(rng.choice(["<f4", ">f4"])).tobytes()
        content = _replace(content, _at(rng, content) & ~3, new)
    return content


def _chunk(rng: np.random.Generator, content: bytes) -> bytes:
    """A piece left out, doubled, or moved."""
    start, length = _at(rng, content), int(rng.integers(1, max(2, len(content) // 3)))
    piece = content[start : start + length]
    at = _at(rng, content)
    return (content[:start] + content[start + length :], content[:at] + piece + content[at:])[rng.integers(2)]


MUTATIONS: dict[str, Callable[[np.random.Generator, bytes], bytes]] = {
    "none": lambda rng, content: content,
    "cut": lambda rng, content: content[: _at(rng, content)],
    "flipped bytes": _flip,
    "flipped in the header": lambda rng, content: _replace(content, _at(rng, content, 300), rng.bytes(1)),
    "another number": _other_number,
    "another word": _other_word,
    "other lines": _other_lines,
    "odd floats": _floats,
    "pieces": _chunk,
    "random bytes": lambda rng, content: rng.bytes(int(rng.integers(0, 3000))),
    "random body": lambda rng, content: content[: (at := _at(rng, content, 600))] + rng.bytes(len(content) - at),
    "zeros": lambda rng, content: _replace(content, at := _at(rng, content), bytes(len(content) - at)),
    "line ends": lambda rng, content: content.replace(b"\n", (b"\r\n", b"\r", b"\n\n", b" ")[rng.integers(4)]),
    "trailing": lambda rng, content: content + rng.bytes(int(rng.integers(1, 99))),
    "digits": lambda rng, content: re.sub(rb"(?<=\d)\.(?=\d)", (b",", b"", b"..", b";")[rng.integers(4)], content),
}
"""By name: ways to spoil a good file."""


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A file's content with one to three random damages."""
    ways = [*MUTATIONS.values()]
    for _ in range(int(rng.integers(1, 4))):
        content = ways[int(rng.integers(1, len(ways)))](rng, content)
    return content
