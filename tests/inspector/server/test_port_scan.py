"""Whoever knocks at the port and speaks no HTTP: nothing is told of it, and the page is served on."""

from __future__ import annotations

import logging
import resource
import socket
import struct
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
import viser
from websockets.sync.client import connect

from inspector.server.viser_server import start_server
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow

HELLO = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(40))  # half a TLS greeting
KNOCKS = (
    b"",
    b"\r\n\r\n",
    HELLO,
    b"\xff\xfe" * 20 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhello",
    b"GET " + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nbad header\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Key: !\r\n\r\n",
)


def knock(port: int, said: bytes, *, reset: bool) -> None:
    with socket.create_connection(("127.0.0.1", port), 2.0) as caller:
        try:
            caller.sendall(said)
            if reset:  # the next close sends RST, not FIN
                caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            else:
                caller.shutdown(socket.SHUT_WR)
                caller.settimeout(2.0)
                while caller.recv(4096):
                    pass
        except OSError:
            pass  # it closes first, as it should


def test_a_port_scan_says_nothing_and_the_page_is_served_on(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    server = start_server(port=0)
    port = server.get_port()
    try:
        with caplog.at_level(logging.WARNING):
            for said in KNOCKS:
                knock(port, said, reset=True)
                knock(port, said, reset=False)
            with WireClient(port):  # comes after all of them in the one loop of the server
                pass
        assert caplog.records == []
        assert urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5.0).status == 200
        out, error = capfd.readouterr()
        assert (out, error) == ("", "")
    finally:
        server.stop()


def test_rubbish_from_a_page_is_a_line(caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]) -> None:
    server = start_server(port=0)
    url = f"ws://127.0.0.1:{server.get_port()}"
    try:
        with caplog.at_level(logging.WARNING):
            for rubbish in (b"\xc1\xff" * 30, "text", b"\x81\xa4type\xa4None", b""):
                with connect(url, subprotocols=[f"viser-v{viser.__version__}"]) as page:  # type: ignore[list-item]
                    page.send(rubbish)
                    try:
                        while True:
                            page.recv(timeout=0.3)
                    except Exception:
                        pass
        for record in caplog.records:
            assert record.exc_info is None
            assert "\n" not in record.getMessage()
        assert "Traceback" not in capfd.readouterr().err
    finally:
        server.stop()


CROWD = """
import socket, sys
callers = [socket.create_connection(("127.0.0.1", int(sys.argv[1])), 20.0) for _ in range(80)]
print("there", flush=True)
sys.stdin.readline()
"""


def test_a_crowd_beyond_the_open_files_is_one_line_and_the_page_is_served_on(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    server = start_server(port=0)
    port = server.get_port()
    usual = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        with WireClient(port) as page, caplog.at_level(logging.WARNING):
            command = [sys.executable, "-S", "-c", CROWD, str(port)]
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as crowd:
                taken = {int(path.name) for path in Path("/proc/self/fd").iterdir()}
                free = [number for number in range(10_000) if number not in taken]
                resource.setrlimit(resource.RLIMIT_NOFILE, (free[20], usual[1]))
                assert crowd.stdout.readline() == "there\n"
                for _ in range(100):
                    if caplog.records:
                        break
                    page.wait(lambda _: True)
                    time.sleep(0.05)
                resource.setrlimit(resource.RLIMIT_NOFILE, usual)
                crowd.stdin.write("\n")
                crowd.stdin.flush()
            with WireClient(port):  # whoever waited is let in
                pass
        (told,) = caplog.records
        assert "connections at a time" in told.getMessage()
        assert told.exc_info is None
        assert "Traceback" not in capfd.readouterr().err
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, usual)
        server.stop()
