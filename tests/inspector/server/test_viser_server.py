"""The server's closed doors: address, foreign pages, share tunnel, hostile values."""

from __future__ import annotations

import socket
import urllib.error
import urllib.request
from collections.abc import Iterator

import pytest
from viser import _messages
from websockets.exceptions import InvalidStatus

from calib.errors import CalibError
from inspector.panels.input_checks import clamped, one_of
from inspector.server import viser_server as server_module
from inspector.server.viser_server import ServerError, origin_allowed, start_server, url_of
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture
def server() -> Iterator[server_module.InspectorServer]:
    started = start_server(port=0)
    yield started
    started.stop()


def test_binds_loopback_only_by_default(server: server_module.InspectorServer) -> None:
    assert server.get_host() == "127.0.0.1"
    assert url_of(server) == f"http://127.0.0.1:{server.get_port()}"
    other = socket.socket()
    with other:  # 127.0.0.2 is this machine too: a server on every interface would answer there
        other.settimeout(2)
        with pytest.raises(OSError):
            other.connect(("127.0.0.2", server.get_port()))


def test_busy_port_is_one_clear_error(server: server_module.InspectorServer) -> None:
    port = server.get_port()
    with pytest.raises(ServerError) as caught:
        start_server(port=port)
    assert isinstance(caught.value, CalibError)
    message = str(caught.value)
    assert f"127.0.0.1:{port}" in message
    assert "--port" in message
    assert "\n" not in message


@pytest.mark.parametrize(("host", "port"), [("127.0.0.1", 70000), ("127.0.0.1", -1), ("no-such-host.invalid", 0)])
def test_bad_address_is_one_clear_error(host: str, port: int) -> None:
    with pytest.raises(ServerError) as caught:
        start_server(host, port)
    assert "\n" not in str(caught.value)


def test_a_stopped_server_frees_its_port() -> None:
    first = start_server(port=0)
    port = first.get_port()
    first.stop()
    second = start_server(port=port)
    assert second.get_port() == port
    second.stop()


# ---- foreign pages --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_own_page_is_served_and_accepted(server: server_module.InspectorServer, name: str) -> None:
    port = server.get_port()
    with urllib.request.urlopen(f"http://{name}:{port}/") as page:
        assert page.status == 200
        assert b"<html" in page.read()[:2000].lower()
    with WireClient(port, host=name, origin=f"http://{name}:{port}") as client:
        assert "ReplayDoneMessage" in client.log


def test_a_program_without_a_page_is_accepted(server: server_module.InspectorServer) -> None:
    with WireClient(server.get_port()) as client:
        assert "ReplayDoneMessage" in client.log


@pytest.mark.parametrize("origin", ["http://evil.example", "https://127.0.0.1:1", "null", "file://", "http://["])
def test_foreign_page_is_refused(server: server_module.InspectorServer, origin: str) -> None:
    with pytest.raises(InvalidStatus) as caught:
        WireClient(server.get_port(), origin=origin)
    assert caught.value.response.status_code == 403
    assert server.get_clients() == {}


@pytest.mark.parametrize(
    ("origin", "host", "bound", "allowed"),
    [
        (None, "127.0.0.1:8080", "127.0.0.1", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "127.0.0.1", True),
        ("http://localhost:9999", "localhost:9999", "127.0.0.1", True),  # ssh -L 9999:localhost:8080
        ("http://[::1]:8080", "[::1]:8080", "::1", True),
        ("http://localhost", "localhost", "127.0.0.1", True),  # port 80 is not written out
        ("http://localhost:8081", "localhost:8080", "127.0.0.1", False),  # another program's page here
        ("http://evil.example:8080", "127.0.0.1:8080", "127.0.0.1", False),
        ("http://evil.example:8080", "evil.example:8080", "127.0.0.1", False),  # DNS rebinding
        ("http://evil.example:8080", "evil.example:8080", "0.0.0.0", False),
        ("http://192.168.1.5:8080", "192.168.1.5:8080", "0.0.0.0", True),
        ("http://192.168.1.5:8080", "192.168.1.5:8080", "127.0.0.1", False),
        ("https://localhost:8080", "localhost:8080", "127.0.0.1", False),  # this server speaks no TLS
        ("http://localhost:bad", "localhost:8080", "127.0.0.1", False),
        ("ftp://localhost:8080", "localhost:8080", "127.0.0.1", False),
        ("http://localhost:8080", None, "127.0.0.1", False),
    ],
)
def test_origin_rule(origin: str | None, host: str | None, bound: str, allowed: bool) -> None:
    assert origin_allowed(origin, host, bound_host=bound) is allowed


def test_a_foreign_name_of_this_machine_is_refused(server: server_module.InspectorServer) -> None:
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(urllib.request.Request(url_of(server), headers={"Host": "evil.example"}))
    assert caught.value.code == 403
    caught.value.close()


def test_no_path_leaves_the_page_folder(server: server_module.InspectorServer) -> None:
    for path in (
        "/../../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/..%5c..%5cetc/passwd",
        "/" + "a" * 7000,
    ):
        with pytest.raises(urllib.error.HTTPError) as caught:
            urllib.request.urlopen(url_of(server) + path)
        assert caught.value.code == 404, path
        caught.value.close()  # an open connection would hold the server up when it stops


# ---- no public tunnel -----------------------------------------------------------------------------------------------


def test_no_client_can_open_a_share_tunnel(
    server: server_module.InspectorServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: object) -> None:
        raise AssertionError("a tunnel was made")

    monkeypatch.setattr("viser._viser.ViserTunnel", forbidden)
    asked: list[object] = []
    monkeypatch.setattr(type(server), "request_share_url", lambda self, verbose=True: asked.append(self))
    handlers = server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers
    assert _messages.ShareUrlDisconnect not in handlers
    box = server.gui.add_checkbox("after", False)
    with WireClient(server.get_port()) as client:
        client.send(type="ShareUrlRequest")
        client.send(type="ShareUrlDisconnect")
        client.set("after", True)
        with WireClient(server.get_port()) as other:
            other.wait(lambda c: c.value("after"))
    assert box.value
    assert not asked


def test_the_program_itself_cannot_open_one_either(server: server_module.InspectorServer) -> None:
    with pytest.raises(ServerError, match="switched off"):
        server.request_share_url()


# ---- hostile values -------------------------------------------------------------------------------------------------


def test_hostile_values_are_ignored_and_good_ones_pass(server: server_module.InspectorServer) -> None:
    gui = server.gui
    slider = gui.add_slider("slider", min=0, max=10, step=1, initial_value=3)
    choice = gui.add_dropdown("choice", ("a", "b"))
    group = gui.add_button_group("group", ("x", "y"))
    box = gui.add_checkbox("box", False)
    dead = gui.add_checkbox("dead", False, disabled=True)
    hidden = gui.add_checkbox("hidden", False, visible=False)
    text = gui.add_text("text", "t")
    pressed: list[str] = []
    off = gui.add_button("off", disabled=True)
    off.on_click(lambda _: pressed.append("off"))
    on = gui.add_button("on")
    on.on_click(lambda _: pressed.append("on"))
    last = gui.add_checkbox("last", False)
    callbacks: list[object] = []
    for handle in (slider, choice, box, dead, hidden, text):
        handle.on_update(lambda event: callbacks.append(event.target.value))

    with WireClient(server.get_port()) as client:
        values: dict[str, list[object]] = {
            "slider": [9999, "x", float("nan"), None, True],
            "choice": ["c", ["a"], 1],
            "group": ["z"],
            "box": ["yes", 2],
            "dead": [True],
            "hidden": [True],
            "text": ["n" * 100_000],
            "off": [True],
        }
        hostile: list[tuple[str, dict[str, object]]] = [
            *((label, {"value": bad}) for label, those in values.items() for bad in those),
            ("slider", {"removed": True}),
            ("slider", {"update_cb": []}),
            ("slider", {"sync_cb": None}),
            ("box", {"value": True, "removed": True}),
            ("box", {}),
            ("slider", {"no_such_field": 1}),
            ("off", {"is_button": False}),
        ]
        for label, updates in hostile:
            client.send(type="GuiUpdateMessage", uuid=client.find(label), updates=updates)
        client.send(type="GuiUpdateMessage", uuid="no-such-widget", updates={"value": 1})
        client.set("last", True)
        with WireClient(server.get_port()) as other:
            other.wait(lambda c: c.value("last"))
            assert (slider.value, choice.value, group.value, box.value) == (3, "a", "x", False)
            assert (dead.value, hidden.value, text.value) == (False, False, "t")
            assert (callbacks, pressed) == ([], [])
            client.set("slider", 10)
            client.set("choice", "b")
            client.set("box", True)
            client.click("on")
            other.wait(lambda c: (c.value("slider"), c.value("choice"), c.value("box")) == (10, "b", True))
    assert (slider.value, choice.value, box.value, last.value) == (10, "b", True, True)


def test_one_of_and_clamped() -> None:
    assert one_of("b", ("a", "b"), "a") == "b"
    assert one_of("c", ("a", "b"), "a") == "a"
    assert one_of(True, (1, 2), 2) == 2
    assert one_of(["a"], ("a",), "a") == "a"
    assert clamped(5, 0, 10, 1) == 5
    assert clamped(9999, 0, 10, 1) == 10
    assert clamped(-1, 0, 10, 1) == 0
    for bad in (float("nan"), float("inf"), "5", None, True, [5]):
        assert clamped(bad, 0, 10, 1) == 1
