"""Requests of the page's own script, in addition to viser's: clicks on plots, table rows and words of sentences.

Viser's plots and HTML send nothing to Python. The page is therefore served with a script of ours (`client/*.js`), and
what it asks (`GET inspector/ask?name=pose&value=p37`) is answered here. Only this server's own page can ask: a request
needs a header that a foreign page may not send, and the server's own name.
"""

from __future__ import annotations

import functools
import gzip
import http
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Response

from inspector.server.connection_log import bounded_logger

log = bounded_logger(__name__)

HEADER = "X-Inspector"
ASK, SCRIPT = "/inspector/ask", "/inspector/page.js"
SCRIPTS = Path(__file__).parent / "client"
VALUE_LIMIT = 1000  # characters of a request's value
TITLE = "Calibration inspector"

_GUARDS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",  # for browsers that do not know the former
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}

Ask = Callable[[str], None]


class PageRequests:
    """Registry of handlers by name for the requests of the page's script; a handler returns at once."""

    def __init__(self) -> None:
        self._asks: dict[str, Ask] = {}

    def on(self, name: str, ask: Ask) -> None:
        """Register the handler of all requests with a name; the handler is called with the request's value."""
        self._asks[name] = ask

    def respond(self, target: str, headers: Headers, *, own_host: bool) -> Response | None:
        """HTTP response to a GET of `target` (path and query); None where viser itself has to answer.

        own_host: whether the request was sent to a name of this machine.
        """
        path = urlsplit(target).path
        if path == SCRIPT:
            return _answer(http.HTTPStatus.OK, script(), "application/javascript", headers)
        if path != ASK:
            return None
        if HEADER not in headers or not own_host or headers.get("Sec-Fetch-Site", "same-origin") != "same-origin":
            return _answer(http.HTTPStatus.FORBIDDEN, b"Only the inspector's own page may ask.\n")
        asked = parse_qs(urlsplit(target).query, keep_blank_values=True)
        name, value = asked.get("name", [""])[0], asked.get("value", [""])[0]
        if name not in self._asks or len(value) > VALUE_LIMIT:
            log.warning("the page asked for %.50r with %.50r, which nothing answers", name, value)
            return _answer(http.HTTPStatus.NOT_FOUND, b"Nothing answers this.\n")
        self._asks[name](value)
        return _answer(http.HTTPStatus.OK, b"")


def with_script(page: Response) -> Response:
    """Viser's page with the inspector's script, style sheet and title added."""
    compressed = page.headers.get("Content-Encoding") == "gzip"
    body = _scripted(bytes(page.body), compressed)
    headers = _headers(page.headers["Content-Type"], body, compressed)
    return Response(page.status_code, page.reason_phrase, headers, body)


@functools.lru_cache(maxsize=2)
def _scripted(body: bytes, compressed: bool) -> bytes:
    plain = gzip.decompress(body) if compressed else body
    head, end, rest = plain.rpartition(b"</body>")
    if not end:
        raise AssertionError("viser's page has no end of its body to put the script before")
    title = f"<title>{TITLE}</title>".encode()
    plain = (
        head.replace(b"<title>Viser</title>", title)
        + b"<style>"
        + (SCRIPTS / "page.css").read_bytes()
        + b"</style>"
        + b'<script src="inspector/page.js"></script>'
        + end
        + rest
    )
    return gzip.compress(plain) if compressed else plain


@functools.cache
def script() -> bytes:
    """Concatenated text of all `client/*.js`, page.js first."""
    files = sorted(SCRIPTS.glob("*.js"), key=lambda file: (file.name != "page.js", file.name))
    return b"\n".join(file.read_bytes() for file in files)


def _answer(status: http.HTTPStatus, body: bytes, kind: str = "text/plain", asked: Headers | None = None) -> Response:
    compressed = asked is not None and "gzip" in asked.get("Accept-Encoding", "")
    body = gzip.compress(body) if compressed else body
    return Response(status, status.phrase, _headers(f"{kind}; charset=utf-8", body, compressed), body)


def guarded(answer: Response) -> Response:
    """HTTP response with headers that forbid framing, content sniffing and referrers."""
    for name, value in _GUARDS.items():
        if name not in answer.headers:
            answer.headers[name] = value
    return answer


def _headers(kind: str, body: bytes, compressed: bool) -> Headers:
    headers = Headers()
    headers["Content-Type"], headers["Content-Length"] = kind, str(len(body))
    headers["Content-Encoding"] = "gzip" if compressed else "identity"
    headers["Cache-Control"] = "no-store"
    return headers
