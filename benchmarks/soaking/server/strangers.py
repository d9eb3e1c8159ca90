"""Hostile clients that speak no page's protocol: functions of the server's port that take some seconds each."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator

import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

HOST = "127.0.0.1"
SUBPROTOCOL = f"viser-v{viser.__version__}"
SPAN_S = 12.0  # that a slow one goes on


@contextlib.contextmanager
def call(port: int, *, reset: bool = False) -> Iterator[socket.socket]:
    """A connection; what it breaks off with is not told."""
    with socket.create_connection((HOST, port), 10.0) as caller:
        caller.settimeout(5.0)
        with contextlib.suppress(OSError):
            yield caller
            if reset:  # the next close sends RST, not FIN
                caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def say(port: int, words: bytes, *, reset: bool = False, listen: bool = True) -> bytes:
    """Say this, and take what is answered."""
    answer = b""
    with call(port, reset=reset) as caller:
        caller.sendall(words)
        if listen:
            caller.shutdown(socket.SHUT_WR)
            while len(answer) < 10_000_000 and (part := caller.recv(65536)):
                answer += part
    return answer


# ---- below HTTP -----------------------------------------------------------------------------------------------------


def port_scan(port: int) -> None:
    """Connections that say nothing, closed and reset."""
    for k in range(300):
        say(port, b"", reset=bool(k % 2), listen=False)


def half_a_greeting(port: int) -> None:
    """Half of what a TLS client says, and rubbish."""
    for k in range(60):
        say(
            port,
            (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", os.urandom(400))[k % 2],
            listen=bool(k % 3),
        )


def half_http(port: int) -> None:
    """Requests that stop in the middle."""
    whole = f"GET / HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode()
    for k in range(1, len(whole)):
        say(port, whole[:k], reset=bool(k % 2), listen=False)


def slow_headers(port: int) -> None:
    """A hundred requests of which a byte comes now and then (slowloris)."""
    callers = [socket.create_connection((HOST, port), 10.0) for _ in range(100)]
    end = time.monotonic() + SPAN_S
    for caller in callers:
        caller.sendall(b"GET / HTTP/1.1\r\n")
    while time.monotonic() < end:
        for caller in callers:
            with contextlib.suppress(OSError):
                caller.sendall(b"X-a: b\r\n")
        time.sleep(0.5)
    for caller in callers:
        caller.close()


def long_headers(port: int) -> None:
    """A line of 10 MB, a header of 10 MB, a hundred thousand headers."""
    for words in (
        b"GET /" + b"a" * 10_000_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nX: " + b"a" * 10_000_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000 + b"\r\n",
    ):
        say(port, words)


def wrong_methods(port: int) -> None:
    """HTTP methods that this server does not know."""
    for method in (b"POST", b"PUT", b"DELETE", b"TRACE", b"CONNECT", b"PROPFIND", b"OPTIONS", b"\xff\xfe"):
        for version in (b"HTTP/1.1", b"HTTP/1.0", b"HTTP/9.9", b""):
            say(port, method + b" / " + version + b"\r\nHost: x\r\nContent-Length: 5\r\n\r\nhello")
    say(port, b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(50))


def path_traversal(port: int) -> None:
    """Files that are none of a page's business."""
    for path in (
        "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..%2f..%2fetc/passwd", "/.git/config",
        "/inspector/../../pyproject.toml", "/assets/..%5c..%5cx", "/%00", "/" + "a/" * 5000, "/?x=" + "y" * 5000,
        "http://[::1", "/inspector/page.js/../../x", "/" + "%ff" * 100,
    ):  # fmt: skip
        answer = say(port, f"GET {path} HTTP/1.1\r\nHost: {HOST}:{port}\r\nConnection: close\r\n\r\n".encode())
        assert b"root:" not in answer, path
        assert b"[core]" not in answer, path


# ---- other pages ----------------------------------------------------------------------------------------------------


def foreign_origin(port: int) -> None:
    """Pages of elsewhere in the user's browser."""
    for origin in (
        "http://evil.example",
        f"http://{HOST}.evil.example:{port}",
        "null",
        f"http://{HOST}:{port + 1}",
    ):
        for _ in range(5):
            let_in = False
            with (
                contextlib.suppress(InvalidStatus, OSError),
                connect(f"ws://{HOST}:{port}", subprotocols=[SUBPROTOCOL], origin=origin),  # type: ignore[list-item,arg-type]
            ):
                let_in = True
            assert not let_in, f"a page of {origin} was let in"


def foreign_host(port: int) -> None:
    """A foreign name that someone points at this machine."""
    for host in ("evil.example", "127.0.0.1.nip.io", "", "[", "a" * 300, "127.0.0.1:99999999"):
        for target in ("/", "/inspector/ask?name=pose&value=p02"):
            said = f"GET {target} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nX-Inspector: 1\r\n\r\n"
            assert not say(port, said.encode()).startswith(b"HTTP/1.1 200"), host


def odd_asks(port: int) -> None:
    """Requests that the page's own script could send and never would."""
    for query in (
        "", "name=pose", "name=nothing&value=1", "name=pose&value=" + "9" * 900, "name=pose&value=%00%ff", "a" * 900,
        "name=joint&value=1e999", "name=joint&value=-1", "name=effect&value=<img>", "name=pose&value=" + "x" * 5000,
    ):  # fmt: skip
        for header in ("X-Inspector: 1\r\n", "", "X-Inspector: 1\r\nSec-Fetch-Site: cross-site\r\n"):
            said = f"GET /inspector/ask?{query} HTTP/1.1\r\nHost: {HOST}:{port}\r\n{header}\r\n"
            say(port, said.encode())


def flood_of_connections(port: int) -> None:
    """Fifteen hundred at once, more than a process may have open files as a rule, until they are closed."""
    callers, end = [], time.monotonic() + 2 * SPAN_S
    while len(callers) < 1500 and time.monotonic() < end:
        with contextlib.suppress(OSError):
            callers.append(socket.create_connection((HOST, port), 8.0))
    time.sleep(SPAN_S / 3)
    for caller in callers:
        caller.close()


STRANGERS: tuple[Callable[[int], None], ...] = (
    port_scan, half_a_greeting, half_http, slow_headers, long_headers, wrong_methods, path_traversal, foreign_origin,
    foreign_host, odd_asks, flood_of_connections,
)  # fmt: skip
