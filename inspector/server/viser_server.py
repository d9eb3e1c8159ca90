"""A viser server that accepts connections and widget values from its own page only.

Viser as it comes binds every interface, moves to the next port when the asked one is taken, accepts websocket
connections that any web page in the user's browser opens, lets any client open a public share tunnel, and applies
whatever value a client sends, also to fields that are not values. `start_server` prevents all five.

This file, `viser_caches` and `uploads` alone lean on viser's private names, so viser is pinned to >=1.1.1,<1.2.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import http
import io
import ipaddress
import math
import os
import socket
import threading
import zipfile
from collections.abc import Awaitable, Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints
from urllib.parse import urlsplit

import viser
from viser import _assignable_props_api, _icons, _messages
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.asyncio.server import serve as websockets_serve
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from calib.errors import CalibError
from inspector.server.connection_log import ConnectionWarning, bounded_logger, connection_logger
from inspector.server.page_requests import PageRequests, guarded, with_script

log = bounded_logger(__name__)

LOOPBACK = "127.0.0.1"
TEXT_LIMIT = 1000  # characters that a text field may hold


class ServerError(CalibError):
    """Error: the server cannot listen on an address."""


def bind(host: str, port: int) -> socket.socket:
    """Listening socket on exactly host:port; port 0 takes any free port.

    Raises:
        ServerError: port out of range, taken or not permitted, or a host that is not this machine's.
    """
    if not 0 <= port <= 65535:
        raise ServerError(f"--port {port}: a port is a number from 0 (any free one) to 65535")
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except socket.gaierror as error:
        raise ServerError(f"--host {host}: not an address of this machine ({error.strerror})") from error
    except OSError as error:
        raise ServerError(
            f"cannot listen on {host}:{port} ({os.strerror(error.errno or 0)}); close the program that uses it or pass "
            "--port with another number (0 takes any free one)"
        ) from error


# ---- which web pages may connect ---------------------------------------------------------------------------------


def _host_name(netloc: str) -> str:
    return (urlsplit(f"//{netloc}").hostname or "").lower()


def _is_own_name(name: str, bound_host: str) -> bool:
    """Whether a host name can only mean this machine: never a public name that may resolve to 127.0.0.1."""
    if name == "localhost" or name == bound_host.lower():
        return True
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        return not _is_loopback(bound_host) and name in {socket.gethostname().lower(), socket.getfqdn().lower()}
    return address.is_loopback or not _is_loopback(bound_host)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def origin_allowed(origin: str | None, host_header: str | None, *, bound_host: str) -> bool:
    """Whether the web page at `origin` is this server's own page; True where no web page made the request.

    The page's host:port has to be the one that the request went to (so a forwarded port works), and that host has to
    be this machine's own name: a foreign name that resolves to 127.0.0.1 (DNS rebinding) is refused.
    """
    if origin is None:
        return True
    if host_header is None:
        return False
    try:
        page, asked = urlsplit(origin), urlsplit(f"//{host_header}")
        same = (page.scheme, page.hostname, page.port or 80) == ("http", asked.hostname, asked.port or 80)
    except ValueError:
        return False
    return same and _is_own_name(_host_name(host_header), bound_host)


# ---- what a client may change ---------------------------------------------------------------------------------------


def _value_fits(props: Any, current: object, value: object, is_button: bool) -> bool:
    """Whether a widget with these properties can have sent `value`."""
    if getattr(props, "disabled", False) or not getattr(props, "visible", True):
        return False
    if isinstance(props, (_messages.GuiDropdownProps, _messages.GuiButtonGroupProps)):
        return isinstance(value, str) and value in props.options
    if is_button or isinstance(current, bool):
        return isinstance(value, bool)
    if isinstance(props, (_messages.GuiSliderProps, _messages.GuiNumberProps)):
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            return False
        low = -math.inf if props.min is None else props.min
        high = math.inf if props.max is None else props.max
        slack = 1e-9 * max(1.0, abs(value))
        return low - slack <= value <= high + slack
    if isinstance(current, str):
        return isinstance(value, str) and len(value) <= TEXT_LIMIT
    return False


def guard_gui(gui: viser.GuiApi) -> None:
    """Reject widget messages except changes of `value` that the page's widget could have made."""
    handlers = gui._websock_interface._incoming_handlers
    apply = gui._handle_gui_updates

    async def guarded(client_id: Any, message: _messages.GuiUpdateMessage) -> None:
        handle = gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None:
            return
        state = handle._impl
        fits = set(message.updates) == {"value"} and _value_fits(
            state.props, state.value, message.updates["value"], state.is_button
        )
        if not fits:
            log.warning("client %s: refused %.200r for a widget", client_id, message.updates)
            return
        await apply(client_id, message)

    handlers[_messages.GuiUpdateMessage] = [guarded]  # type: ignore[list-item]
    # Nothing takes uploads but what `uploads.take_uploads` allows, and nothing may open a tunnel: without a handler the
    # messages are dropped.
    for kind in (
        _messages.FileTransferStartUpload,
        _messages.FileTransferPart,
        _messages.ShareUrlRequest,
        _messages.ShareUrlDisconnect,
    ):
        handlers.pop(kind, None)


# ---- the server -----------------------------------------------------------------------------------------------------

_starting = threading.Lock()


LONGEST_PATH = 250  # characters: no file's name is longer


def _is_page(target: str) -> bool:
    return urlsplit(target).path in ("", "/", "/index.html")


ProcessRequest = Callable[[ServerConnection, Request], Response | None]


@contextlib.contextmanager
def _serving_on(listener: socket.socket, bound_host: str, requests: PageRequests) -> Iterator[None]:
    """Context in which a starting viser server uses `listener`, refuses foreign origins and answers `requests`.

    Viser opens its own port inside a function that cannot be reached from outside, so the module that it takes
    `serve` from is swapped in viser's own namespace (nobody else's) until the server is up.
    """
    real = _infra.websockets

    def guard(inner: ProcessRequest) -> ProcessRequest:
        def process_request(connection: ServerConnection, request: Request) -> Response | None:
            answer = respond(connection, request)
            return None if answer is None else guarded(answer)

        def respond(connection: ServerConnection, request: Request) -> Response | None:
            headers = request.headers
            origins, hosts = headers.get_all("Origin"), headers.get_all("Host")
            origin = origins[0] if len(origins) == 1 else (None if not origins else "several")
            host = hosts[0] if len(hosts) == 1 else None
            own_host = host is not None and origin_allowed(f"http://{host}", host, bound_host=bound_host)
            if (hosts and not own_host) or not origin_allowed(origin, host, bound_host=bound_host):
                return connection.respond(
                    http.HTTPStatus.FORBIDDEN, "This page may not talk to the inspector (foreign origin).\n"
                )
            if len(urlsplit(request.path).path) > LONGEST_PATH:  # viser looks for a file of this name
                return connection.respond(http.HTTPStatus.NOT_FOUND, "There is no such file.\n")
            answer = requests.respond(request.path, headers, own_host=own_host)
            if answer is not None:
                return answer
            page = inner(connection, request)
            return with_script(page) if _is_page(request.path) and page is not None else page

        return process_request

    def serve(
        handler: Callable[[ServerConnection], Awaitable[None]],
        host: str,
        port: int,
        *,
        process_request: ProcessRequest,
        max_size: int,
        compression: str | None,
        subprotocols: Sequence[Subprotocol] | None,
        select_subprotocol: Callable[[ServerConnection, Sequence[Subprotocol]], Subprotocol | None],
    ) -> websockets_serve:
        del host, port
        asyncio.get_running_loop().set_exception_handler(ConnectionWarning())
        return websockets_serve(
            handler,
            sock=listener,
            process_request=guard(process_request),
            max_size=max_size,
            compression=compression,
            subprotocols=subprotocols,
            select_subprotocol=select_subprotocol,
            logger=connection_logger(),
        )

    stand_in = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=serve, ServerConnection=ServerConnection)),
        datastructures=real.datastructures,
        exceptions=real.exceptions,
    )
    with _starting:
        _infra.websockets = stand_in  # type: ignore[assignment]
        try:
            yield
        finally:
            _infra.websockets = real


class InspectorServer(viser.ViserServer):
    """A viser server that accepts connections from its own page only; made by `start_server`."""

    requests: PageRequests  # what the page's own script may ask

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse viser's public tunnel: scans and robots stay on this machine."""
        del verbose
        raise ServerError("public share links are switched off; forward the port instead (ssh -L 8080:localhost:8080)")

    def stop(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # viser announces its end on stdout
            super().stop()


def start_server(host: str = LOOPBACK, port: int = 8080, *, label: str | None = None) -> InspectorServer:
    """Start a server on exactly host:port that accepts connections from its own pages only.

    Raises:
        ServerError: the address cannot be bound (`bind`).
    """
    cache_lookups()
    listener = bind(host, port)
    requests = PageRequests()
    try:
        with _serving_on(listener, host, requests), contextlib.redirect_stdout(io.StringIO()):
            server = InspectorServer(host=host, port=listener.getsockname()[1], label=label, verbose=False)
    except BaseException:
        listener.close()
        raise
    server.requests = requests
    guard_gui(server.gui)
    return server


def url_of(server: viser.ViserServer) -> str:
    """Address of the page for a browser on this machine."""
    host = server.get_host()
    if host in ("0.0.0.0", "::", ""):
        host = "localhost"
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def tell(server: viser.ViserServer, title: str, body: str) -> None:
    """Show a plain-text notification in every open page."""
    for client in server.get_clients().values():
        client.add_notification(title, body, color="red", auto_close_seconds=15.0)


_type_hints = functools.cache(get_type_hints)


@functools.cache
def _opened(path: Path) -> contextlib.AbstractContextManager[zipfile.ZipFile]:
    """Zip file that stays open between lookups."""
    return contextlib.nullcontext(zipfile.ZipFile(path))


def cache_lookups() -> None:
    """Add caches to the functions of viser that take noticeable time.

    It works out the types of a kind of node for every node (a sixth of a turn of the page), and reads the directory of
    its four thousand icons for every icon (more than half a second of the start).
    """
    _assignable_props_api.get_type_hints = _type_hints  # type: ignore[assignment]
    _icons.zipfile = SimpleNamespace(ZipFile=_opened)  # type: ignore[assignment]
