"""File uploads of pages: accepted through given buttons only, within limits, and written straight to a folder.

Viser keeps all parts in memory, of any number, from anyone, for any widget. Here a transfer has to come from the upload
button, of a size that is told and held to, its parts whole and in order, one transfer a page at a time; what arrives is
written at once, below a folder of its own for each page.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

import viser
from viser import _messages

from calib.errors import CalibError
from inspector.server.connection_log import bounded_logger

log = bounded_logger(__name__)

PART_BYTES = 512 * 1024  # as the page cuts files
_LONGEST_NAME = 120
_STAGING = ".arriving-"
_LEAST_BYTES = 4096  # that a file takes on the disk
_STALLED_S = 60.0  # without a part; another transfer may then take its place


@dataclass(frozen=True)
class UploadLimits:
    """Limits of what a page may upload."""

    page_bytes: int = 1_000_000_000  # of one page until it imports or gives up, as its files lie here: unpacked
    total_bytes: int = 2_000_000_000  # of all pages
    folder_bytes: int = 20_000_000_000  # of the folder, with the datasets that were imported
    free_bytes: int = 500_000_000  # that stay free on the disk
    pages: int = 8  # that may have files here at a time


@dataclass(frozen=True)
class Upload:
    """A file that was uploaded completely."""

    client: int
    name: str  # its last part, a plain file name
    path: Path


@dataclass
class _Transfer:
    uuid: str
    name: str
    path: Path
    file: BinaryIO
    size: int
    parts: int
    source: str
    arrived: int = 0  # parts
    last: float = field(default_factory=time.monotonic)

    def bytes_of(self, part: int) -> int:
        """Expected length of a part, bytes."""
        return PART_BYTES if part < self.parts - 1 else self.size - PART_BYTES * (self.parts - 1)


class Uploads:
    """The uploads of all pages. All methods but `release` and `close` are called on the server's event loop."""

    def __init__(
        self,
        folder: Path,
        answer: Callable[[int, Any], None],
        refused: Callable[[int, str], None],
        limits: UploadLimits | None = None,
    ) -> None:
        """Uploads into a hidden folder below `folder`, which is made where it is missing and removed at the end.

        `answer`, `refused`: called with the page, and with viser's acknowledgement or the reason.
        """
        self.folder, self.limits = folder, limits or UploadLimits()
        self.buttons: dict[str, Callable[[Upload], None]] = {}  # what takes their files, by uuid
        self._answer, self._refused = answer, refused
        self._staging: Path | None = None
        self._made = False  # whether the folder itself is ours
        self._now: dict[int, _Transfer] = {}
        self._held: dict[int, int] = {}  # bytes by page
        self._lock: int | None = None  # of the hidden folder, for as long as this program runs
        clear_leftovers(folder)

    # ---- what pages send ----

    def start(self, client: int, message: _messages.FileTransferStartUpload) -> None:
        """Handle a page's announcement of a file."""
        before = self._now.get(client)
        if before is not None and time.monotonic() - before.last < _STALLED_S:
            log.warning("client %s: refused a second transfer beside the first", client)
            return
        self._drop(client)
        if not _is_sound(message) or message.source_component_uuid not in self.buttons:
            log.warning("client %s: refused the transfer %.200r", client, message)
            return
        try:
            why = self._in_the_way(client, message.size_bytes)
            if why:
                self._refuse(client, message, why)
                return
            place = self.of(client)
            name = plain_name(message.filename)
            handle, path = tempfile.mkstemp(dir=place, prefix="part.")
        except OSError as error:
            self._refuse(client, message, f"it cannot be written here ({error.strerror or error})")
            return
        self._now[client] = _Transfer(
            message.transfer_uuid,
            name,
            Path(path),
            os.fdopen(handle, "wb"),
            message.size_bytes,
            message.part_count,
            message.source_component_uuid,
        )
        self._held[client] = self._held.get(client, 0) + message.size_bytes
        if message.part_count == 0:
            self._finish(client)

    def part(self, client: int, message: _messages.FileTransferPart) -> None:
        """Handle the next part of a page's file."""
        transfer = self._now.get(client)
        if transfer is None or message.transfer_uuid != transfer.uuid:
            return
        content, index = message.content, message.part_index
        kinds: tuple[object, object] = (content, index)  # a client may send anything
        fits = (
            isinstance(kinds[0], bytes)
            and not isinstance(kinds[1], bool)
            and index == transfer.arrived
            and len(content) == transfer.bytes_of(transfer.arrived)
        )
        if not fits:
            log.warning("client %s: not the next part of %s, or not of its length", client, transfer.name)
            self._drop(client)
            return
        try:
            transfer.file.write(content)
        except OSError as error:
            self._drop(client)
            self._refuse(client, message, f"it cannot be written here ({error.strerror or error})", transfer.source)
            return
        transfer.arrived += 1
        transfer.last = time.monotonic()
        sent = min(transfer.arrived * PART_BYTES, transfer.size)
        self._answer(client, _ack(transfer.source, transfer.uuid, sent, transfer.size))
        if transfer.arrived == transfer.parts:
            self._finish(client)

    def leave(self, client: int) -> None:
        """Handle the end of a page's connection."""
        self._drop(client)
        self.release(client)

    def _in_the_way(self, client: int, size: int) -> str:
        held, limits = self._held.get(client, 0), self.limits
        if held + size > limits.page_bytes:
            beside = f" with the {held / 1e6:.0f} MB that are here already" if held else ""
            return f"it has {size / 1e6:.0f} MB{beside}; {limits.page_bytes / 1e6:.0f} MB are taken at a time"
        if client not in self._held and len(self._held) >= limits.pages:
            return "too many pages have files here at the moment; try again later"
        if sum(self._held.values()) + size > limits.total_bytes:
            return "too many files are here at the moment; try again later"
        if shutil.disk_usage(self._place()).free - size < limits.free_bytes:
            return "the disk of the server is nearly full"
        return ""

    def _finish(self, client: int) -> None:
        transfer = self._now.pop(client)
        transfer.file.close()
        if transfer.size == 0:
            self._answer(client, _ack(transfer.source, transfer.uuid, 0, 0))
        self.buttons[transfer.source](Upload(client, transfer.name, transfer.path))

    def _refuse(self, client: int, message: Any, why: str, source: str = "") -> None:
        size = getattr(message, "size_bytes", 1)
        # Without it the page would show the transfer, and keep its button off, for ever.
        self._answer(client, _ack(source or message.source_component_uuid, message.transfer_uuid, size, size))
        self._refused(client, why)

    def _drop(self, client: int) -> None:
        transfer = self._now.pop(client, None)
        if transfer is not None:
            transfer.file.close()
            transfer.path.unlink(missing_ok=True)
            self._held[client] -= transfer.size

    def room_bytes(self, client: int) -> int:
        """Bytes that may still be written for a page, at least 0; slow, so not for the event loop."""
        limits, held = self.limits, sum(self._held.values())
        return max(
            0,
            min(
                limits.page_bytes - self._held.get(client, 0),
                limits.total_bytes - held,
                limits.folder_bytes - size_bytes(self.folder),
                shutil.disk_usage(self._place()).free - limits.free_bytes,
            ),
        )

    @contextmanager
    def writing(self, client: int) -> Iterator[int]:
        """Context for unpacking a page's files: yields their size limit, bytes, and counts their size at the end."""
        try:
            yield self.room_bytes(client)
        finally:
            if client in self._held:
                transfer = self._now.get(client)
                coming = 0 if transfer is None else transfer.size - transfer.arrived * PART_BYTES
                self._held[client] = size_bytes(self.of(client)) + max(coming, 0)
            else:  # the page has left meanwhile
                self.release(client)

    def refuse_copy(self, client: int) -> None:
        """Raise CalibError where the disk has no room for a dataset in addition to the page's files and draft."""
        needed = 2 * self._held.get(client, 0)
        free = shutil.disk_usage(self._place()).free - self.limits.free_bytes
        if needed > min(free, self.limits.folder_bytes - size_bytes(self.folder)):
            raise CalibError(
                f"there is no room for it: the disk of the server is nearly full, or {self.folder.name} has its "
                f"{self.limits.folder_bytes / 1e9:g} GB; remove datasets there"
            )

    # ---- folders ----

    def _place(self) -> Path:
        if self._staging is None:
            self._made = not self.folder.exists()
            self.folder.mkdir(parents=True, exist_ok=True)
            self._staging = Path(tempfile.mkdtemp(dir=self.folder, prefix=_STAGING))
            self._lock = _locked(self._staging)
        return self._staging

    def of(self, client: int) -> Path:
        """Folder of a page's uploaded files."""
        place = self._place() / str(int(client))
        place.mkdir(exist_ok=True)
        return place

    def release(self, client: int) -> None:
        """Remove the files that a page uploaded."""
        self._held.pop(client, None)
        if self._staging is not None:
            shutil.rmtree(self._staging / str(int(client)), ignore_errors=True)

    def close(self) -> None:
        """Remove all uploaded files that were not imported."""
        for client in list(self._now):
            self._drop(client)
        if self._staging is not None:
            if self._lock is not None:
                os.close(self._lock)
                self._lock = None
            shutil.rmtree(self._staging, ignore_errors=True)
            self._staging = None
            if self._made and not any(self.folder.iterdir()):
                self.folder.rmdir()


def clear_leftovers(folder: Path) -> None:
    """Remove partial uploads that killed programs left in a folder; uploads of running programs stay."""
    for staging in folder.glob(f"{_STAGING}*") if folder.is_dir() else ():
        if staging.is_symlink() or not staging.is_dir():
            continue
        lock = _locked(staging)
        if lock is not None:
            shutil.rmtree(staging, ignore_errors=True)
            os.close(lock)


def _locked(folder: Path) -> int | None:
    """Handle that locks a folder until closed; None where another program holds the lock or locks do not exist."""
    try:
        import fcntl
    except ImportError:
        return None
    handle = None
    try:
        handle = os.open(folder, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        if handle is not None:
            os.close(handle)
        return None
    return handle


def size_bytes(folder: Path) -> int:
    """Disk space of all files below a folder, bytes; links are not followed."""
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                total += max(os.lstat(os.path.join(place, name)).st_size, _LEAST_BYTES)  # noqa: PTH118
            except OSError:  # gone meanwhile
                continue
    return total


def take_uploads(
    server: viser.ViserServer,
    buttons: Sequence[tuple[viser.GuiUploadButtonHandle, Callable[[Upload], None]]],
    uploads: Uploads,
) -> None:
    """Accept files uploaded through some buttons, each with what takes them, within the limits of `uploads`."""
    uploads.buttons = {button._impl.uuid: done for button, done in buttons}
    handlers = server.gui._websock_interface._incoming_handlers
    handlers[_messages.FileTransferStartUpload] = [uploads.start]  # type: ignore[list-item]
    handlers[_messages.FileTransferPart] = [uploads.part]  # type: ignore[list-item]

    async def left(client: viser.ClientHandle) -> None:
        uploads.leave(client.client_id)

    server.on_client_disconnect(left)


def answer(server: viser.ViserServer, client_id: int, message: _messages.Message) -> None:
    """Send a message to one page, if it is still connected."""
    client = server.get_clients().get(client_id)
    if client is not None:
        client._websock_connection.queue_message(message)


def plain_name(name: str) -> str:
    """File name without folders and without unusual characters; "file" where nothing is left."""
    last = PurePosixPath(name.replace("\\", "/")).name
    kept = "".join(c if c.isprintable() and c not in ':*?"<>|' else "_" for c in last).strip(" .")
    stem, suffix = Path(kept).stem, Path(kept).suffix
    return (stem[: _LONGEST_NAME - len(suffix[:10])] + suffix[:10]) or "file"


def _is_sound(message: _messages.FileTransferStartUpload) -> bool:
    """Whether an upload's announcement has the field types and the number of parts that viser's page sends."""
    counts: tuple[object, ...] = (message.size_bytes, message.part_count)
    texts: tuple[object, ...] = (message.filename, message.transfer_uuid, message.source_component_uuid)
    return (
        all(isinstance(count, int) and not isinstance(count, bool) and count >= 0 for count in counts)
        and all(isinstance(text, str) and len(text) <= 1000 for text in texts)
        and message.part_count == -(-message.size_bytes // PART_BYTES)
    )


def _ack(source: str, uuid: str, sent: int, size: int) -> _messages.FileTransferPartAck:
    return _messages.FileTransferPartAck(
        source_component_uuid=source, transfer_uuid=uuid, transferred_bytes=sent, total_bytes=size
    )
