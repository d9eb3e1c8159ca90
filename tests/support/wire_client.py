"""A browser-free viser client: speaks the wire protocol of viser 1.1 and mirrors the page's widgets and scene.

It can do what a page does and, unlike a page, whatever a hostile client would do (`send`).
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from websockets.sync.client import connect

from inspector.server.uploads import PART_BYTES

POLL_S = 0.05


def _resolve(value: Any, buffers: list[memoryview]) -> Any:
    """Put the arrays back in the places that the message names by number."""
    if isinstance(value, dict):
        if "__binary_index" in value and "dtype" in value:
            return np.frombuffer(buffers[value["__binary_index"]], dtype=np.dtype(value["dtype"]))
        return {k: _resolve(v, buffers) for k, v in value.items()}
    if isinstance(value, list):
        return [_resolve(v, buffers) for v in value]
    return value


def decode(raw: bytes, zstd: zstandard.ZstdDecompressor) -> list[dict[str, Any]]:
    """The messages of one frame: two lengths, compressed msgpack, then the arrays, each 8-byte aligned."""
    plain, packed = struct.unpack_from("<QQ", raw)
    frame = msgspec.msgpack.decode(zstd.decompress(raw[16 : 16 + packed], max_output_size=plain))
    offset, buffers = 16 + packed, []
    for length in frame["binaryBufferLengths"]:
        offset += -offset % 8
        buffers.append(memoryview(raw)[offset : offset + length])
        offset += length
    return [_resolve(message, buffers) for message in frame["messages"]]


class WireClient:
    """One connected page without a browser. `gui`: uuid -> message, `scene`: node name -> message."""

    def __init__(self, port: int, host: str = "127.0.0.1", origin: str | None = None) -> None:
        self.gui: dict[str, dict[str, Any]] = {}
        self.scene: dict[str, dict[str, Any]] = {}
        self.commands: dict[str, dict[str, Any]] = {}
        self.notifications: list[dict[str, Any]] = []
        self.downloads: dict[str, bytes] = {}  # by file name, those that came whole
        self._coming: dict[str, tuple[str, int, dict[int, bytes]]] = {}
        self.log: list[str] = []
        self.bytes_received = 0
        self._changed = threading.Condition()
        self._replayed = threading.Event()
        self._socket = connect(
            f"ws://{host}:{port}",
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None,
            compression=None,
            origin=origin,  # type: ignore[arg-type]
        )
        threading.Thread(target=self._receive, daemon=True).start()
        # The server lists a client only after its first camera message.
        self.send(
            type="ViewerCameraMessage", wxyz=[1, 0, 0, 0], position=[1, 1, 1], fov=0.9, near=0.01, far=1000.0,
            image_height=600, image_width=800, look_at=[0, 0, 0], up_direction=[0, 0, 1],
        )  # fmt: skip
        assert self._replayed.wait(60), f"the server did not replay its state: {self.log[-1:]}"

    def __enter__(self) -> WireClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def vanish(self) -> None:
        """Leave without a word, as a page whose machine falls asleep."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)

    def send(self, **message: Any) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    def _receive(self) -> None:
        zstd = zstandard.ZstdDecompressor()  # one a thread: it is not to be shared
        try:
            for raw in self._socket:
                assert isinstance(raw, bytes)
                messages = decode(raw, zstd)
                with self._changed:
                    self.bytes_received += len(raw)
                    for message in messages:
                        self._apply(message)
                    self._changed.notify_all()
        except Exception as error:
            with self._changed:
                self.log.append(f"connection ended: {error}")
                self._changed.notify_all()

    def _apply(self, m: dict[str, Any]) -> None:
        kind = m["type"]
        self.log.append(kind)
        if kind == "ReplayDoneMessage":
            self._replayed.set()
        elif kind == "RegisterCommandMessage":
            self.commands[m["uuid"]] = m["props"]
        elif kind == "CommandUpdateMessage":
            self.commands[m["uuid"]].update(m["updates"])
        elif kind == "NotificationShowMessage":
            self.notifications.append(m)
        elif kind == "FileTransferStartDownload":
            self._coming[m["transfer_uuid"]] = (m["filename"], m["part_count"], {})
        elif kind == "FileTransferPart":
            name, parts, got = self._coming[m["transfer_uuid"]]
            got[m["part_index"]] = bytes(m["content"])
            if len(got) == parts:
                self.downloads[name] = b"".join(got[i] for i in range(parts))
        elif kind == "GuiUpdateMessage":
            for name, value in m["updates"].items() if m["uuid"] in self.gui else ():
                if name == "value":
                    self.gui[m["uuid"]]["value"] = value
                else:
                    self.gui[m["uuid"]]["props"][name] = value
        elif kind == "GuiRemoveMessage":
            self.gui.pop(m["uuid"], None)
        elif kind.startswith("Gui") and "props" in m and "uuid" in m:
            self.gui[m["uuid"]] = m
        elif kind == "SceneNodeUpdateMessage":
            if m["name"] in self.scene:
                self.scene[m["name"]]["props"].update(m["updates"])
        elif kind == "RemoveSceneNodeMessage":
            for name in [n for n in self.scene if n == m["name"] or n.startswith(m["name"] + "/")]:
                del self.scene[name]
        elif kind == "SetSceneNodeVisibilityMessage":
            if m["name"] in self.scene:
                self.scene[m["name"]]["visible"] = m["visible"]
        elif kind == "SetPositionMessage":
            if m["name"] in self.scene:
                self.scene[m["name"]]["position"] = m["position"]
        elif kind == "SetOrientationMessage":
            if m["name"] in self.scene:
                self.scene[m["name"]]["wxyz"] = m["wxyz"]
        elif "props" in m and "name" in m:
            self.scene[m["name"]] = {"visible": True, **m}

    # ---- what a person sees and does ----

    def wait(self, holds: Callable[[WireClient], object], timeout_s: float = 60.0) -> None:
        """Block until `holds(self)`; AssertionError if it never does.

        It is asked after each message and every POLL_S: what it asks of the app itself may come true without one.
        """
        end = time.monotonic() + timeout_s
        with self._changed:
            while not holds(self):
                assert time.monotonic() < end, f"still not so after {timeout_s} s"
                self._changed.wait(POLL_S)

    def find(self, label: str) -> str:
        """The uuid of the widget with this label, waited for where the page is being built anew."""
        found: list[str] = []

        def there(page: WireClient) -> bool:
            found[:] = [u for u, m in page.gui.items() if m["props"].get("label") == label]
            return bool(found)

        self.wait(there, 10.0)
        return found[0]

    def has(self, label: str) -> bool:
        with self._changed:
            return any(m["props"].get("label") == label for m in self.gui.values())

    def value(self, label: str) -> Any:
        return self.gui[self.find(label)]["value"]

    def props(self, label: str) -> dict[str, Any]:
        props: dict[str, Any] = self.gui[self.find(label)]["props"]
        return props

    def set(self, label: str, value: Any) -> None:
        """Change a widget, as a page does: the server does not echo a value to the page that sent it."""
        uuid = self.find(label)
        with self._changed:
            self.gui[uuid]["value"] = value
        self.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def upload(self, button: str, name: str, content: bytes) -> None:
        """Send a file through an upload button, in parts as viser's page does."""
        uuid, parts = self.find(button), -(-len(content) // PART_BYTES)
        self.send(
            type="FileTransferStartUpload", source_component_uuid=uuid, transfer_uuid=name, filename=name, mime_type="",
            part_count=parts, size_bytes=len(content),
        )  # fmt: skip
        for k in range(parts):
            part = content[k * PART_BYTES : (k + 1) * PART_BYTES]
            self.send(
                type="FileTransferPart", source_component_uuid=uuid, transfer_uuid=name, part_index=k, content=part
            )

    def press(self, label: str, button: str) -> None:
        """Press one of a group's buttons, once the page has it."""
        self.wait(lambda page: button in page.props(label)["options"])
        self.set(label, button)

    def click(self, label: str) -> None:
        self.send(type="GuiUpdateMessage", uuid=self.find(label), updates={"value": True})

    def trigger(self, label: str) -> None:
        """Run a command, as its key does."""
        uuid = next(u for u, p in self.commands.items() if p["label"] == label)
        self.send(type="CommandTriggerMessage", uuid=uuid)

    def text(self) -> str:
        """Everything that the page says in markdown and HTML, hidden parts too."""
        with self._changed:
            parts = [m["props"].get("_markdown") or m["props"].get("content") or "" for m in self.gui.values()]
        return "\n".join(parts)

    def figures(self) -> list[str]:
        """The plotly figures as JSON text."""
        with self._changed:
            return [m["props"]["_plotly_json_str"] for m in self.gui.values() if "_plotly_json_str" in m["props"]]

    def tabs(self) -> list[str]:
        with self._changed:
            return [t for m in self.gui.values() for t in m["props"].get("_tab_labels", ())]
