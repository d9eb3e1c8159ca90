"""When the pages are built: none of them may ask anything of the network, and each picture says what it shows.

Links that a reader may follow are no matter; what a browser fetches by itself is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

FETCHED = {  # attributes whose address a browser fetches by itself, by element
    **dict.fromkeys(("script", "iframe", "embed", "track", "input", "use", "image", "feimage"), ("src", "href")),
    **dict.fromkeys(("img", "source", "video", "audio"), ("src", "srcset", "poster")),
    "link": ("href",),
    "object": ("data",),
}
LINKS_FETCHED = (
    "stylesheet",
    "icon",
    "preload",
    "prefetch",
    "modulepreload",
    "preconnect",
    "dns-prefetch",
    "manifest",
)
ELSEWHERE = re.compile(r"^\s*(?:https?:|wss?:)?//", re.IGNORECASE)
IN_STYLE = re.compile(r"(?:url\(|@import)\s*['\"]?\s*((?:https?:)?//[^'\")\s]+)", re.IGNORECASE)
IN_SCRIPT = re.compile(
    r"(?:\bfetch\(|\bimport\(?|\.open\(\s*['\"]\w+['\"]\s*,|\.src\s*="
    r"|\bsendBeacon\(|new (?:WebSocket|EventSource|Worker)\()"
    r"\s*['\"`]((?:https?|wss?)://[^'\"`]+)"
)


class _Page(HTMLParser):
    """Collects what a page would fetch, and pictures without words."""

    def __init__(self) -> None:
        super().__init__()
        self.faults: list[str] = []
        self.inside = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.inside = tag
        if tag != "link" or any(word in LINKS_FETCHED for word in given.get("rel", "").lower().split()):
            for name in FETCHED.get(tag, ()):
                addresses = given.get(name, "").split(",") if name == "srcset" else [given.get(name, "")]
                self.faults += [f"<{tag}> fetches {one.strip()}" for one in addresses if ELSEWHERE.match(one)]
        self.faults += [f"a style fetches {found}" for found in IN_STYLE.findall(given.get("style", ""))]
        if tag == "img" and not given.get("alt", "").strip():
            self.faults.append(f"a picture without alt text: {given.get('src', '')[:80]}")

    def handle_data(self, data: str) -> None:
        pattern = {"style": IN_STYLE, "script": IN_SCRIPT}.get(self.inside)
        if pattern is not None:
            self.faults += [f"<{self.inside}> fetches {found}" for found in pattern.findall(data)]

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""


def faults_of(folder: Path) -> Iterator[tuple[str, str]]:
    """File and fault of everything that the built pages in a folder would fetch, and of pictures without words."""
    for path in sorted(folder.rglob("*")):
        if path.suffix not in (".html", ".css", ".js", ".svg"):
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        if path.suffix in (".css", ".js"):
            pattern = IN_STYLE if path.suffix == ".css" else IN_SCRIPT
            found = [f"fetches {address}" for address in pattern.findall(text)]
        else:
            page = _Page()
            page.feed(text)
            found = page.faults
        yield from ((str(path.relative_to(folder)), fault) for fault in found)


def _when_built(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.name == "html":
        for name, fault in faults_of(Path(app.outdir)):
            logger.warning("%s: %s", name, fault, type="offline")


def setup(app: Sphinx) -> dict[str, bool]:
    """Look through the pages when all are written."""
    app.connect("build-finished", _when_built)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
