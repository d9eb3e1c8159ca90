"""Scan files: a written scan is read back; damaged files raise errors that name what was found in them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import ScanError
from calib.scans.scan import Scan, load_scan, write_scan

POINTS = np.random.default_rng(1).uniform(-300, 900, (1000, 3)).astype(np.float32).astype(np.float64)
PLY_HEADER = "ply\nformat {} 1.0\nelement vertex {}\nproperty {t} x\nproperty {t} y\nproperty {t} z\nend_header\n"


def ply(kind: str, points: NDArray, *, promised: int | None = None, dtype: str = "<f4") -> bytes:
    word = {"f4": "float", "f8": "double"}[dtype[-2:]]
    header = PLY_HEADER.format(kind, len(points) if promised is None else promised, t=word).encode()
    if kind == "ascii":
        return header + "".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in points).encode()
    return header + points.astype(dtype).tobytes()


def test_written_scan_is_read_back_exactly_with_its_normals(tmp_path: Path) -> None:
    normals = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    write_scan(tmp_path / "p7.ply", Scan("p7", POINTS, normals))
    scan = load_scan(tmp_path / "p7.ply")
    assert scan.name == "p7"
    assert scan.dropped == 0
    np.testing.assert_array_equal(scan.points_mm, POINTS)
    assert scan.normals is not None
    np.testing.assert_allclose(scan.normals, normals, atol=1e-7)
    assert list(tmp_path.iterdir()) == [tmp_path / "p7.ply"]  # no temporary file stays


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.ply", b"", "empty"),
        (
            "a.ply",
            ply("binary_little_endian", POINTS[:400], promised=1000),
            "promises 1000 points, it holds 400",
        ),
        ("a.ply", ply("ascii", POINTS[:400], promised=1000), "promises 1000 points, it holds 400"),
        ("a.ply", ply("binary_little_endian", POINTS[:0]), "no points"),
        ("a.ply", ply("binary_little_endian", np.full((5, 3), np.nan)), "5 in the file"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "end_header"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement face 3\nend_header\n", "no vertices"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float u\nend_header\n1\n",
            "no x, y, z",
        ),
        ("a.ply", ply("ascii", POINTS).replace(b"\n1", b"\nx"), "not three numbers"),
        ("a.ply", ply("ascii", POINTS, promised=10**12), "promises 1000000000000 points, it holds 1000"),
        ("a.ply", ply("ascii", POINTS).replace(b"1000\n", b"9" * 5000 + b"\n"), "number of points"),
        ("a.ply", ply("ascii", POINTS).replace(b"float y", b"list uchar float y"), "lists stand before or among"),
        ("a.ply", ply("ascii", POINTS).replace(b"ascii", b"binary"), "format 'binary'"),
        ("a.ply", b"\x00\x01\x02 not a scan", "not a .ply"),
        ("a.pcd", b"not a cloud\n" * 9, "not a .pcd"),
        ("a.xyz", b"1 2 3\n4 5\n", "row 2"),
        ("a.xyz", b"# x y z\n \t\n", "no usable point"),
        ("a.xyz", b"\xff\xfe\x00\x80" * 9, "three numbers"),
        ("a.stl", b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", "not a readable .stl"),
        ("a.obj", b"# nothing\nf 1 2 3\n", "no vertex"),
        ("a.npz", b"PK\x03\x04 not a zip", "not a readable .npz"),
        ("a.csv", b"r,g,b\n1,2,3\n", "no x, y, z (found: r, g, b)"),
        ("a.csv", b"x_m,y_m,z_m\n0.1,0.2,0.3\n", "coordinates in m;"),
        ("a.csv", "x;y;z\n1;2;3\n".encode("utf-16"), "in UTF-8"),
        ("a.docx", b"1 2 3\n", "not a kind of scan"),
    ],
)
def test_a_damaged_file_is_told_in_one_line_that_names_it(
    tmp_path: Path, name: str, content: bytes, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ScanError) as caught:
        load_scan(tmp_path / name)
    assert said in str(caught.value)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")  # the readers below keep quiet


def test_no_such_file(tmp_path: Path) -> None:
    (tmp_path / "folder.ply").mkdir()
    os.mkfifo(tmp_path / "pipe.ply")
    with (tmp_path / "large.ply").open("wb") as large:
        large.truncate(2**33)  # a file of zeros that takes no place
    said = {
        "missing": "no such file", "pipe": "no such file", "folder": "this is a folder", "large": "has 8 GB"
    }  # fmt: skip
    for name, words in said.items():
        with pytest.raises(ScanError, match=words):
            load_scan(tmp_path / f"{name}.ply")


def test_a_failed_write_leaves_the_old_scan(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_scan(path, Scan("a", POINTS))
    before = path.read_bytes()
    with pytest.raises(ValueError):
        write_scan(path, Scan("a", POINTS, normals=POINTS[:5]))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
