"""What the page's own script may ask, and who else may not."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator

import pytest

from inspector.server.page_requests import HEADER, SCRIPTS, VALUE_LIMIT, script
from inspector.server.viser_server import InspectorServer, start_server

OWN = {HEADER: "1"}


@pytest.fixture(scope="module")
def asked() -> list[str]:
    return []


@pytest.fixture(scope="module")
def server(asked: list[str]) -> Iterator[InspectorServer]:
    server = start_server(port=0)
    server.requests.on("pose", asked.append)
    yield server
    server.stop()


def get(
    server: InspectorServer, path: str, headers: dict[str, str] | None = None, method: str = "GET"
) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
    connection.request(method, path, headers=headers or {})
    response = connection.getresponse()
    answer = response.status, response.read()
    connection.close()
    return answer


def test_the_page_comes_with_the_script(server: InspectorServer) -> None:
    status, page = get(server, "/")
    assert status == 200
    assert b'<script src="inspector/page.js"></script></body>' in page.replace(b"\n", b"").replace(b"  ", b"")
    assert b"<title>Viser</title>" not in page
    assert get(server, "/inspector/page.js") == (200, script())
    assert all(file.read_bytes() in script() for file in SCRIPTS.glob("*.js"))


def test_a_request_reaches_what_answers_it(server: InspectorServer, asked: list[str]) -> None:
    assert get(server, "/inspector/ask?name=pose&value=p%2037%26%3C", OWN) == (200, b"")
    assert asked[-1] == "p 37&<"


@pytest.mark.parametrize(
    ("headers", "why"),
    [
        ({}, "a form or an image of a foreign page sends no header of its own"),
        ({**OWN, "Host": "evil.example"}, "a foreign name that resolves to this machine"),
        ({**OWN, "Origin": "http://evil.example"}, "a foreign page"),
        ({**OWN, "Sec-Fetch-Site": "cross-site"}, "the browser says it is a foreign page"),
    ],
)
def test_nobody_else_may_ask(server: InspectorServer, asked: list[str], headers: dict[str, str], why: str) -> None:
    before = len(asked)
    assert get(server, "/inspector/ask?name=pose&value=p1", headers)[0] == 403, why
    assert len(asked) == before


@pytest.mark.parametrize("query", ["name=open&value=x", "value=x", "", "name=pose&value=" + "x" * (VALUE_LIMIT + 1)])
def test_what_nothing_answers_is_refused(server: InspectorServer, asked: list[str], query: str) -> None:
    before = len(asked)
    assert get(server, f"/inspector/ask?{query}", OWN)[0] == 404
    assert len(asked) == before


def test_a_preflight_of_a_foreign_page_gets_no_leave(server: InspectorServer) -> None:
    wanted = {"Origin": "http://evil.example", "Access-Control-Request-Headers": json.dumps(HEADER)}
    with pytest.raises(http.client.HTTPException):  # websockets answers nothing but GET
        get(server, "/inspector/ask?name=pose&value=p1", wanted, method="OPTIONS")


@pytest.mark.parametrize("path", ["/", "/index.html", "/inspector/page.js", "/inspector/ask?name=no", "/nothing"])
def test_no_other_page_shows_this_one_in_a_frame(server: InspectorServer, path: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
    connection.request("GET", path)
    response = connection.getresponse()
    response.read()
    connection.close()
    assert response.getheader("Content-Security-Policy") == "frame-ancestors 'none'"
    assert response.getheader("X-Frame-Options") == "DENY"
    assert response.getheader("X-Content-Type-Options") == "nosniff"


def test_what_strangers_cause_fills_no_log(server: InspectorServer, caplog: pytest.LogCaptureFixture) -> None:
    for k in range(300):
        get(server, f"/inspector/ask?name=no{k}&value=%1b%5B31m%e2%80%ae", OWN)
    lines = [record.getMessage() for record in caplog.records]
    assert 0 < len(lines) <= 61
    assert all(line.isprintable() for line in lines)
