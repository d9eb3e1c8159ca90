"""Safe unpacking of a user's zip: no path outside the folder, no links, bounded size."""

from __future__ import annotations

import os
import shutil
import stat
import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from calib.errors import DatasetError
from calib.text_files.records import SPREADSHEETS

_CHUNK_BYTES = 1 << 20
_END_BYTES = 22 + 65535  # the end record of a zip with the longest comment
_ENTRY_BYTES = 1000  # of a file in the archive's table: 46, its name and a few further fields
_LONGEST_NAME = 200  # characters of a name in it, folders included
_DEEPEST = 8  # folders
_LITTER = ("__MACOSX", "Thumbs.db", "desktop.ini")  # what packing programs add


@dataclass(frozen=True)
class ArchiveLimits:
    """Largest number and size of the files in an archive."""

    files: int = 5000
    total_bytes: int = 2_000_000_000  # unpacked
    ratio: float = 200.0  # of a file's size to its packed one; text of numbers has 3 to 20
    free_bytes: int = 10_000_000  # up to which a file's ratio does not matter
    spare_bytes: int = 500_000_000  # that stay free on the disk


def is_archive(path: Path) -> bool:
    """Whether a file is a zip by its content, and no spreadsheet, which is one, too."""
    try:
        return path.is_file() and path.suffix.lower() not in SPREADSHEETS and zipfile.is_zipfile(path)
    except OSError:
        return False


def unpack(path: Path, folder: Path, limits: ArchiveLimits = ArchiveLimits()) -> tuple[Path, ...]:
    """Unpack a zip into an empty folder; the paths of the written files.

    Everything is checked in the archive's table before anything is written, and its sizes are enforced while unpacking.

    Raises:
        DatasetError: names that leave the folder, links, encryption, damage, or more than the limits allow.
    """
    try:
        _refuse_long_table(path, limits)
        with zipfile.ZipFile(path) as archive:
            wanted = _judged(path, archive, limits)
            _refuse_full_disk(path, folder, sum(info.file_size for info in wanted.values()), limits)
            return tuple(_write(path, archive, info, folder / name) for name, info in wanted.items())
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        UnicodeDecodeError,
        ValueError,
    ) as error:
        raise DatasetError(
            f"{path}: cannot be read as a zip ({' '.join(str(error).split()) or type(error).__name__}); pack it again"
        ) from None
    except OSError as error:
        raise DatasetError(f"{path}: cannot be unpacked ({error.strerror or error})") from None


def _refuse_full_disk(path: Path, folder: Path, needed_bytes: int, limits: ArchiveLimits) -> None:
    """Raise DatasetError where the files would leave too little space on the disk."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if shutil.disk_usage(there).free - needed_bytes < limits.spare_bytes:
        raise DatasetError(
            f"{path}: unpacked it has {needed_bytes / 1e6:.4g} MB, for which {there} has no room; make some"
        )


def _refuse_long_table(path: Path, limits: ArchiveLimits) -> None:
    """Raise DatasetError, before reading, where the zip's directory is longer than the allowed files need."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _END_BYTES))
        end = file.read(_END_BYTES)
    at = end.rfind(b"PK\x05\x06")
    if at < 0 or len(end) < at + 22:
        raise DatasetError(f"{path}: is no whole zip; pack it again")
    (table_bytes,) = struct.unpack_from("<I", end, at + 12)
    if b"PK\x06\x07" in end[max(0, at - 20) : at] or table_bytes > limits.files * _ENTRY_BYTES:
        raise DatasetError(f"{path}: holds too many files; {limits.files} are the most that is taken")


def _judged(path: Path, archive: zipfile.ZipFile, limits: ArchiveLimits) -> dict[str, zipfile.ZipInfo]:
    """Files of the zip that are to be unpacked, by their path below the folder. Raises DatasetError."""
    infos = archive.infolist()
    if len(infos) > limits.files:
        raise DatasetError(f"{path}: holds {len(infos)} files; {limits.files} are the most that is taken")
    total = sum(info.file_size for info in infos)
    if total > limits.total_bytes:
        raise DatasetError(
            f"{path}: unpacked it has {total / 1e6:.4g} MB; {limits.total_bytes / 1e6:g} MB are the most that is taken"
        )
    out: dict[str, zipfile.ZipInfo] = {}
    seen: dict[str, str] = {}
    for info in infos:
        name = _place(path, info)
        if name is None:
            continue
        if info.file_size > max(limits.free_bytes, limits.ratio * info.compress_size):
            raise DatasetError(
                f"{path}: {name[:60]!r} grows {info.file_size / max(info.compress_size, 1):.0f} times as it is "
                f"unpacked; more than {limits.ratio:g} times is not taken"
            )
        before = seen.setdefault(name.casefold(), name)
        if name in out or before != name:
            raise DatasetError(f"{path}: {name[:60]!r} stands in it twice; rename one")
        out[name] = info
    for name in out:
        parents = [str(parent) for parent in PurePosixPath(name).parents][:-1]
        if any(parent.casefold() in seen for parent in parents):
            raise DatasetError(f"{path}: {name[:60]!r} lies below a file; rename one")
    if not out:
        raise DatasetError(f"{path}: holds no file; pack a robot and the tables, or a dataset folder")
    return out


def _place(path: Path, info: zipfile.ZipInfo) -> str | None:
    """Path of a file below the folder; None for folders and hidden files. Raises DatasetError for unsafe names."""
    name = info.filename.replace("\\", "/")
    where = PurePosixPath(name)
    if info.flag_bits & 0x1:
        raise DatasetError(f"{path}: is encrypted; pack it without a password")
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise DatasetError(f"{path}: {name[:60]!r} is a link or a device; pack the files themselves")
    if where.is_absolute() or ".." in where.parts or ":" in name or any(ord(c) < 32 for c in name):
        raise DatasetError(f"{path}: {name[:60]!r} leads out of the folder; pack the files with their names alone")
    if len(name) > _LONGEST_NAME or len(where.parts) > _DEEPEST:
        raise DatasetError(f"{path}: {name[:60]!r} ... is too long or too deep a name; pack it less deep")
    if info.is_dir() or not where.parts:
        return None
    if any(part in _LITTER or part.startswith(".") for part in where.parts):
        return None
    return str(where)


def _write(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, place: Path) -> Path:
    """Unpack one file; its path. Raises DatasetError where it is longer than the archive's table says."""
    place.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    with archive.open(info) as source, os.fdopen(os.open(place, flags, 0o644), "wb") as target:
        while chunk := source.read(_CHUNK_BYTES):
            written += len(chunk)
            if written > info.file_size:
                raise DatasetError(f"{path}: {info.filename[:60]!r} is longer than the zip says; pack it again")
            target.write(chunk)
    return place
