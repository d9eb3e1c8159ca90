"""Safe unpacking of a user's zip: no path outside the folder, no links, bounded size."""

from __future__ import annotations

import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from calib.errors import DatasetError
from calib.text_files.records import SPREADSHEETS

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
            wanted = _judged(path, archive.infolist(), limits)
            needed_bytes = sum(info.file_size for info in wanted)
            there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
            if shutil.disk_usage(there).free - needed_bytes < limits.spare_bytes:
                raise DatasetError(
                    f"{path}: unpacked it has {needed_bytes / 1e6:.4g} MB, for which {there} has no room; make some"
                )
            folder.mkdir(parents=True, exist_ok=True)
            return tuple(Path(archive.extract(info, folder)) for info in wanted)  # no more than its size in the table
    except OSError as error:
        raise DatasetError(f"{path}: cannot be unpacked ({error.strerror or error})") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, ValueError) as error:
        raise DatasetError(
            f"{path}: cannot be read as a zip ({' '.join(str(error).split()) or type(error).__name__}); pack it again"
        ) from None


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


def _judged(path: Path, infos: Sequence[zipfile.ZipInfo], limits: ArchiveLimits) -> list[zipfile.ZipInfo]:
    """Files of the zip that are to be unpacked, without folders and hidden files. Raises DatasetError."""
    if len(infos) > limits.files:
        raise DatasetError(f"{path}: holds {len(infos)} files; {limits.files} are the most that is taken")
    total = sum(info.file_size for info in infos)
    if total > limits.total_bytes:
        raise DatasetError(
            f"{path}: unpacked it has {total / 1e6:.4g} MB; {limits.total_bytes / 1e6:g} MB are the most that is taken"
        )
    wanted: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        name = info.filename.replace("\\", "/")
        if problem := _problem(info, name, limits):
            raise DatasetError(f"{path}: {name[:60]!r} {problem}")
        if info.is_dir() or any(part in _LITTER or part.startswith(".") for part in PurePosixPath(name).parts):
            continue
        if name.casefold() in wanted:
            raise DatasetError(f"{path}: {name[:60]!r} stands in it twice; rename one")
        wanted[name.casefold()] = info
    if not wanted:
        raise DatasetError(f"{path}: holds no file; pack a robot and the tables, or a dataset folder")
    return list(wanted.values())


def _problem(info: zipfile.ZipInfo, name: str, limits: ArchiveLimits) -> str:
    """Why a file is not unpacked; "" where nothing is wrong with it."""
    parts = PurePosixPath(name).parts
    if info.flag_bits & 0x1:
        return "is encrypted; pack it without a password"
    if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is a link or a device; pack the files themselves"
    if name.startswith("/") or ".." in parts or ":" in name or any(ord(c) < 32 for c in name):
        return "leads out of the folder; pack the files with their names alone"
    if len(name) > _LONGEST_NAME or len(parts) > _DEEPEST:
        return "... is too long or too deep a name; pack it less deep"
    if info.file_size > max(limits.free_bytes, limits.ratio * info.compress_size):
        grows = info.file_size / max(info.compress_size, 1)
        return f"grows {grows:.0f} times as it is unpacked; more than {limits.ratio:g} times is not taken"
    return ""
