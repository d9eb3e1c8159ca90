"""Small files that claim, or unpack to, more points than memory holds: refused before an array is made."""

from __future__ import annotations

import struct
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from calib.errors import ScanError
from calib.scans.readers.parsing import MOST_POINTS
from calib.scans.scan import load_scan

MB = 1 << 20
ROWS = 100_000_000


def npz_of_zeros(path: Path, rows: int, held: int) -> None:
    """Archive whose array has `rows` by its header and `held` bytes of zeros by the archive's directory."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, 3), }}"
    header = header.ljust(117) + "\n"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("points.npy", "w", force_zip64=True) as file,
    ):
        file.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())
        for _ in range(held // MB):
            file.write(bytes(MB))


def claim_size(path: Path, size: int) -> None:
    """Overwrite the size that the archive's directory gives for its one member."""
    content = bytearray(path.read_bytes())
    at = content.rfind(b"PK\x01\x02")
    content[at + 24 : at + 28] = struct.pack("<I", size)
    path.write_bytes(content)


def peak_mb(path: Path) -> tuple[str, float]:
    tracemalloc.start()
    try:
        with pytest.raises(ScanError) as caught:
            load_scan(path)
        return str(caught.value), tracemalloc.get_traced_memory()[1] / MB
    finally:
        tracemalloc.stop()


def test_a_packed_array_is_refused_by_its_header(tmp_path: Path) -> None:
    path = tmp_path / "zeros.npz"
    npz_of_zeros(path, ROWS, 8 * MB)
    claim_size(path, 24 * ROWS + 128)
    said, mb = peak_mb(path)
    assert "100 million points" in said
    assert "crop it to the jig, or keep every 4th point" in said
    assert mb < 5.0


def test_an_array_shorter_than_the_archive_says_is_truncated(tmp_path: Path) -> None:
    path = tmp_path / "short.npz"
    npz_of_zeros(path, 10 * MB // 24, 8 * MB)
    claim_size(path, 10 * MB + 128)
    said, mb = peak_mb(path)
    assert "truncated" in said or "not a readable .npz" in said
    assert mb < 20.0


def test_packed_points_of_the_point_cloud_library_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    rows = MOST_POINTS + 1
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 1 1 1\nTYPE I I I\nCOUNT 1 1 1\n"
        f"WIDTH {rows}\nHEIGHT 1\nPOINTS {rows}\nDATA binary_compressed\n"
    )
    body = bytes(3 * rows // 88 + 10)
    path.write_bytes(header.encode() + struct.pack("<II", len(body), 3 * rows) + body)
    said, mb = peak_mb(path)
    assert "30 million points" in said
    assert mb < 10.0


def test_lines_are_counted_before_they_are_split(tmp_path: Path) -> None:
    path = tmp_path / "a.xyz"
    path.write_bytes(b"\n" * (MOST_POINTS + 1))
    said, mb = peak_mb(path)
    assert "million points" in said
    assert mb < 60.0
