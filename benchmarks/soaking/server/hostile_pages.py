"""Hostile clients that speak the page's own protocol, or nearly: functions of the server's port."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
from websockets.sync.client import ClientConnection, connect

from soaking.server.strangers import HOST, SPAN_S, STRANGERS, SUBPROTOCOL, call
from tests.support.wire_client import WireClient

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [1, 1, 1], "fov": 0.9, "near": 0.01, "far": 1000.0,
    "image_height": 600, "image_width": 800, "look_at": [0, 0, 0], "up_direction": [0, 0, 1],
}  # fmt: skip
UPGRADE = (
    f"GET / HTTP/1.1\r\nHost: {HOST}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n"
).encode()


@contextlib.contextmanager
def _page(port: int, **options: Any) -> Iterator[ClientConnection]:
    with (
        contextlib.suppress(Exception),
        connect(
            f"ws://{HOST}:{port}",
            subprotocols=[SUBPROTOCOL],
            max_size=None,
            compression=None,
            **options,  # type: ignore[list-item]
        ) as page,
    ):
        yield page


def _drain(page: ClientConnection, for_s: float = 0.3) -> None:
    with contextlib.suppress(Exception):
        while True:
            page.recv(timeout=for_s)


# ---- websockets -----------------------------------------------------------------------------------------------------


def _frames(port: int, frames: list[bytes], for_s: float = 0.3) -> None:
    with call(port) as caller:
        caller.sendall(UPGRADE)
        caller.recv(65536)
        for frame in frames:
            caller.sendall(frame)
        caller.settimeout(for_s)
        while caller.recv(65536):
            pass


def _frame(opcode: int, body: bytes, *, fin: bool = True, mask: bool = True, length: int | None = None) -> bytes:
    size = len(body) if length is None else length
    head = bytes([(0x80 if fin else 0) | opcode])
    bit = 0x80 if mask else 0
    if size < 126:
        head += bytes([bit | size])
    elif size < 2**16:
        head += bytes([bit | 126]) + struct.pack(">H", size)
    else:
        head += bytes([bit | 127]) + struct.pack(">Q", size)
    return head + (b"\0\0\0\0" if mask else b"") + body


def oversized_frames(port: int) -> None:
    """Frames of a told length beyond all bounds, and a message that never ends."""
    for length in (2**62, 2**63, 2**40, 2**31):
        _frames(port, [_frame(2, b"x" * 1000, length=length)])
    _frames(port, [_frame(2, b"x" * 1_000_000, fin=False), *[_frame(0, b"x" * 1_000_000, fin=False)] * 150])


def broken_frames(port: int) -> None:
    """Frames that RFC 6455 forbids: no mask, reserved bits, codes, long or split control frames, no UTF-8."""
    for frames in (
        [_frame(2, b"hello", mask=False)],
        [_frame(opcode, b"") for opcode in (3, 7, 11, 15)],
        [bytes([0xF2, 0x80, 0, 0, 0, 0])],
        [_frame(9, b"x" * 200)],
        [_frame(9, b"x", fin=False)],
        [_frame(0, b"goes on")],
        [_frame(1, b"\xff\xfe")],
        [_frame(8, b"\x00")],
        [_frame(8, struct.pack(">H", 9999))],
        [_frame(9, b"")] * 20_000,
    ):
        _frames(port, frames)


def malformed_messages(port: int) -> None:
    """Bytes that are no msgpack, and msgpack that is no message."""
    rng = np.random.default_rng(0)
    pieces: list[bytes | str] = [
        b"", b"\xc1\xff" * 30, "text", b"\x81\xa4type\xa4None", b"\xdf\xff\xff\xff\xff", b"\xdd\xff\xff\xff\xff",
        b"\x91" * 100_000, b"\xc6\xff\xff\xff\xff", *(rng.bytes(int(n)) for n in rng.integers(1, 3000, 40)),
    ]  # fmt: skip
    for piece in pieces:
        with _page(port) as page:
            page.send(piece)
            _drain(page, 0.1)


def unsound_messages(port: int) -> None:
    """Messages of every kind that viser knows, with fields that are missing, of another type, or absurd."""
    from viser import _messages

    kinds = [name for name in dir(_messages) if name.endswith("Message")]
    odd: list[Any] = [
        None,
        -1,
        1e308,
        float("nan"),
        "x" * 5000,
        [],
        {},
        [[1]],
        b"\xff",
        True,
        "../../etc/passwd",
    ]
    rng = np.random.default_rng(1)
    for kind in kinds:
        with _page(port) as page:
            page.send(msgspec.msgpack.encode({"type": kind}))
            fields = getattr(getattr(_messages, kind), "__annotations__", {})
            for _ in range(2):
                values = {name: odd[int(rng.integers(len(odd)))] for name in fields}
                page.send(msgspec.msgpack.encode({"type": kind, **values}))
            _drain(page, 0.05)
    for camera in (
        {"fov": 0.0},
        {"position": [1e308] * 3},
        {"wxyz": [0, 0, 0, 0]},
        {"near": float("nan")},
        {"image_width": 0},
    ):
        with _page(port) as page:
            page.send(msgspec.msgpack.encode({**CAMERA, **camera}))
            _drain(page, 0.1)


def wrong_values(port: int) -> None:
    """Values that no widget of the page can have."""
    rng = np.random.default_rng(2)
    garbage = [
        9999,
        -1,
        "../../../etc/passwd",
        "<img src=x>",
        None,
        [],
        {"value": 1},
        float("nan"),
        "x" * 5000,
        1e308,
        b"\0",
    ]
    with WireClient(port) as page:
        for uuid in list(page.gui):
            for k in rng.permutation(len(garbage))[:4]:
                page.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": garbage[int(k)]})
            page.send(type="GuiUpdateMessage", uuid=uuid, updates={"label": "evil", "visible": False})
        page.send(type="CommandTriggerMessage", uuid="nothing")
        time.sleep(1.0)


def flood_of_messages(port: int) -> None:
    """Twenty thousand camera moves, unknown widgets and selections of poses as fast as they go."""
    with WireClient(port) as page:
        pose, options = page.find("Pose"), page.props("Pose")["options"]
        for k in range(20_000):
            if k % 3 == 0:
                page.send(**{**CAMERA, "position": [k, 1, 1]})
            elif k % 3 == 1:
                page.send(type="GuiUpdateMessage", uuid=f"{k}", updates={"value": k})
            elif k % 30 == 2:
                page.send(type="GuiUpdateMessage", uuid=pose, updates={"value": options[k % len(options)]})


def upload_abuse(port: int) -> None:
    """Files that are too large, lie about their size, come in pieces out of order, are bombs, or have evil names."""
    from soaking.inputs.zips import packed

    bomb = packed({"zeros.csv": bytes(30_000_000)})
    files = (
        ("../../evil.zip", 4, 1), ("a.zip", 10**15, 2), ("a.zip", -5, 1), ("a.zip", 4, 10**9), ("", 4, 1), ("\0", 4, 1),
        ("x" * 5000, 4, 1), ("a.zip", 4, 0), ("bomb.zip", len(bomb), 1),
    )  # fmt: skip
    with WireClient(port) as page:
        buttons = [u for u, m in page.gui.items() if "upload" in m["type"].lower()]
        assert buttons, "the page has no button to send files by"
        for number, (name, size, parts) in enumerate(files):
            for source in (*buttons, next(iter(page.gui)), "nothing"):
                these = {"source_component_uuid": source, "transfer_uuid": f"u{number}{source[:8]}"}
                told = {"filename": name, "mime_type": "x", "part_count": parts, "size_bytes": size}
                page.send(type="FileTransferStartUpload", **these, **told)
                for index in (1, 0, 0, -1, 10**9):
                    content = bomb if name == "bomb.zip" else b"evil"
                    page.send(type="FileTransferPart", **these, part_index=index, content=content)
        page.send(type="ShareUrlRequest")
        time.sleep(2.0)


def deaf_pages(port: int) -> None:
    """Twenty pages that ask for everything and read nothing."""
    callers = []
    for _ in range(20):
        caller = socket.create_connection((HOST, port), 10.0)
        caller.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        caller.sendall(UPGRADE)
        caller.sendall(_frame(2, msgspec.msgpack.encode(CAMERA)))
        callers.append(caller)
    time.sleep(SPAN_S)
    for caller in callers:
        caller.close()


def vanishing_pages(port: int) -> None:
    """Pages that come, and are gone without a word before they have seen anything."""
    for k in range(150):
        with call(port, reset=True) as caller:
            caller.sendall(UPGRADE)
            caller.sendall(_frame(2, msgspec.msgpack.encode(CAMERA)))
            if k % 3:
                caller.recv(65536 * (k % 3))


ATTACKS: tuple[Callable[[int], None], ...] = (
    *STRANGERS, oversized_frames, broken_frames, malformed_messages, unsound_messages, wrong_values, flood_of_messages,
    upload_abuse, deaf_pages, vanishing_pages,
)  # fmt: skip
