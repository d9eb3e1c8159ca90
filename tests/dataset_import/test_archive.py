"""Zips of untrusted users are unpacked below their folder, or refused with a reason and without leaving files."""

from __future__ import annotations

import stat
import zipfile
from pathlib import Path

import pytest

from calib.dataset_import.archive import ArchiveLimits, is_archive, unpack
from calib.errors import DatasetError


def packed(folder: Path, files: dict[str, bytes], deflated: bool = True) -> Path:
    path = folder / "given.zip"
    kind = zipfile.ZIP_DEFLATED if deflated else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def refused(folder: Path, path: Path, limits: ArchiveLimits | None = None) -> str:
    out = folder / "out"
    with pytest.raises(DatasetError) as caught:
        unpack(path, out, limits or ArchiveLimits())
    assert not [file for file in folder.rglob("*") if file != path and file.is_file()]
    return str(caught.value)


@pytest.mark.parametrize("deflated", [True, False])
def test_files_come_out_as_they_went_in(tmp_path: Path, deflated: bool) -> None:
    files = {"arm.urdf": b"<robot/>", "scans/p1.xyz": b"1 2 3\n" * 1000, "a/b/c.csv": b""}
    litter = {"__MACOSX/arm.urdf": b"x", ".DS_Store": b"x", "scans/.hidden": b"x", "empty/": b""}
    path = packed(tmp_path, files | litter, deflated)
    assert is_archive(path)
    assert not is_archive(tmp_path)
    made = unpack(path, tmp_path / "out")
    assert {str(file.relative_to(tmp_path / "out")): file.read_bytes() for file in made} == files
    assert {file for file in (tmp_path / "out").rglob("*") if file.is_file()} == set(made)


@pytest.mark.parametrize(
    "name",
    ["../evil", "a/../../evil", "/etc/evil", "C:\\evil", "..\\evil", "\\\\host\\evil", "a\nb", "c:evil", "x" * 300,
     "/".join("abcdefghij")],
)  # fmt: skip
def test_no_name_leaves_the_folder(tmp_path: Path, name: str) -> None:
    path = packed(tmp_path, {"fine.csv": b"1", name: b"evil"})
    assert str(path) in refused(tmp_path, path)


def test_links_and_devices_are_refused(tmp_path: Path) -> None:
    for kind in (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR):
        info = zipfile.ZipInfo("passwords")
        info.external_attr = (kind | 0o777) << 16
        with zipfile.ZipFile(tmp_path / "given.zip", "w") as archive:
            archive.writestr(info, "/etc/passwd")
        assert "is a link or a device" in refused(tmp_path, tmp_path / "given.zip")


def test_bombs_are_refused_by_what_the_table_says(tmp_path: Path) -> None:
    bomb = packed(tmp_path, {"zeros.csv": b"0" * 30_000_000})
    assert "grows" in refused(tmp_path, bomb)
    many = packed(tmp_path, {f"{i}.csv": b"1" for i in range(60)})
    assert "holds 60 files" in refused(tmp_path, many, ArchiveLimits(files=50))
    large = packed(tmp_path, {"a.csv": b"12" * 60, "b.csv": b"34" * 60})
    assert "unpacked it has" in refused(tmp_path, large, ArchiveLimits(total_bytes=200))
    comments = zipfile.ZipInfo("a.csv")
    comments.comment = b"x" * 60_000
    with zipfile.ZipFile(tmp_path / "given.zip", "w") as archive:
        archive.writestr(comments, "1")
    assert "too many files" in refused(tmp_path, tmp_path / "given.zip", ArchiveLimits(files=50))


def test_a_disk_without_room_is_told_before_anything_is_written(tmp_path: Path) -> None:
    path = packed(tmp_path, {"a.csv": b"1" * 5000})
    assert "has no room" in refused(tmp_path, path, ArchiveLimits(spare_bytes=10**18))


def test_a_table_that_lies_about_a_size_writes_no_more_than_it_says(tmp_path: Path) -> None:
    path = packed(tmp_path, {"a.csv": b"7" * 5000})
    content = bytearray(path.read_bytes())
    entry = content.rfind(b"PK\x01\x02")
    content[entry + 24 : entry + 28] = (100).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(DatasetError):
        unpack(path, tmp_path / "out")
    assert all(file.stat().st_size <= 100 for file in (tmp_path / "out").rglob("*") if file.is_file())


@pytest.mark.parametrize(
    "content", [b"", b"PK", b"no zip at all", b"PK\x05\x06" + b"\0" * 18, b"PK\x05\x06" + b"\xff" * 18]
)
def test_what_is_no_zip_is_told_in_a_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "given.zip"
    path.write_bytes(content)
    assert str(path) in refused(tmp_path, path)


def test_damage_is_told(tmp_path: Path) -> None:
    whole = packed(tmp_path, {"a.csv": bytes(range(256)) * 40, "a.CSV": b"2"}).read_bytes()
    path = tmp_path / "given.zip"
    assert "stands in it twice" in refused(tmp_path, path)
    rows = bytes(range(256)) * 40
    whole = packed(tmp_path, {"a.csv": rows}, deflated=False).read_bytes()
    path.write_bytes(whole.replace(rows[:100], rows[1:101], 1))
    with pytest.raises(DatasetError, match="cannot be read as a zip"):
        unpack(path, tmp_path / "out")
    assert "cannot be unpacked" in refused_fresh(tmp_path, {"a": b"1", "a/b": b"2"})


def refused_fresh(folder: Path, files: dict[str, bytes]) -> str:
    with pytest.raises(DatasetError) as caught:
        unpack(packed(folder, files), folder / "fresh")
    return str(caught.value)
