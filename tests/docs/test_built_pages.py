"""The documentation as a reader meets it: opened from disk, without a network, in both themes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.support import ROOT

pytest.importorskip("sphinx")
PLAIN = "myst_parser,sphinx_design,sphinx_copybutton,sphinx.ext.autodoc,mathml,reference,offline"
PAGES = {
    "index.md": """# First

A [link](second.md#stiffness-of-joints) and [one away](https://example.org/).

```{toctree}
second
```
""",
    "second.md": r"""# Second

## Stiffness of joints

See {eq}`law` and `Jig`.

$$
\tau &= \frac{k}{1 + k^2} \\
x &= \sqrt{2}
$$ (law)

```python
print("copied")
```

```{eval-rst}
.. module-members:: calib.jig Jig
```
""",
}


def build(folder: Path, **pages: str) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Build pages with the documentation's own settings, but for the extensions that compute."""
    source, out = folder / "source", folder / "out"
    source.mkdir(parents=True)
    for name, text in pages.items():
        (source / name).write_text(text, encoding="utf-8")
    command = [
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-c",
        "docs",
        "-D",
        f"extensions={PLAIN}",
        source,
        out,
    ]
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    return done, out


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    done, out = build(tmp_path_factory.mktemp("docs"), **PAGES)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture
def tab(chromium: Any) -> Iterator[tuple[Any, list[str]]]:
    """A page of the browser, and what it asked for or complained of that it should not."""
    page = chromium.new_page(viewport={"width": 1200, "height": 800})
    faults: list[str] = []
    page.on("request", lambda request: request.url.startswith("file:") or faults.append(request.url))
    page.on("requestfailed", lambda request: faults.append(f"failed: {request.url}"))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda said: said.type in ("error", "warning") and faults.append(said.text))
    yield page, faults
    page.close()


@pytest.mark.browser
@pytest.mark.parametrize("name", ["index.html", "second.html", "genindex.html", "search.html"])
def test_pages_opened_from_disk_ask_nothing_of_the_network_and_complain_of_nothing(
    built: Path, tab: tuple[Any, list[str]], name: str
):
    page, faults = tab
    page.goto((built / name).as_uri())
    page.wait_for_load_state("networkidle")
    assert faults == []


@pytest.mark.browser
def test_the_search_works_from_disk(built: Path, tab: tuple[Any, list[str]]):
    page, faults = tab
    page.goto(f"{(built / 'search.html').as_uri()}?q=stiffness")
    page.locator("ul.search li a").first.wait_for(timeout=10_000)
    assert "second.html" in page.locator("ul.search li a").first.get_attribute("href")
    assert faults == []


@pytest.mark.browser
def test_equations_are_drawn_and_numbered_and_can_be_linked_to(built: Path, tab: tuple[Any, list[str]]):
    page, _ = tab
    page.goto((built / "second.html").as_uri())
    assert page.locator("a[href='#equation-law']").first.inner_text() == "(1)"
    fraction = page.locator("mfrac").bounding_box()
    letter = page.locator("math mi").first.bounding_box()
    assert fraction["height"] > 1.5 * letter["height"], "a fraction is two lines high"
    columns = page.locator("mtd").evaluate_all("cells => cells.map(c => getComputedStyle(c).textAlign)")
    assert [align.removeprefix("-webkit-") for align in columns] == ["right", "left"] * 2


FAULTY = {
    "script": ('<script src="https://cdn.example.org/x.js"></script>', "<script> fetches https://cdn"),
    "font": ("<style>@import url(//fonts.example.org/a.css)</style>", "<style> fetches //fonts"),
    "picture": ('<img src="http://example.org/a.png" alt="a">', "<img> fetches http://example.org"),
    "words": ('<img src="a.png">', "a picture without alt text"),
    "style": ('<link rel="stylesheet" href="//example.org/a.css">', "<link> fetches"),
    "call": ("<script>fetch('https://example.org/api')</script>", "<script> fetches https://example.org/api"),
}


@pytest.mark.parametrize("fault", FAULTY)
def test_what_a_page_would_fetch_is_found(tmp_path: Path, fault: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    text, says = FAULTY[fault]
    good = '<a href="https://example.org">away</a><link rel="canonical" href="https://x.org/"><img src="a" alt="b">'
    (tmp_path / "good.html").write_text(good)
    (tmp_path / "bad.html").write_text(text)
    ((name, found),) = import_module("offline").faults_of(tmp_path)
    assert name == "bad.html"
    assert says in found


WRONG = {  # on a page, and what the build says of it
    "[x](second.md#no-such-heading)": "no-such-heading",
    "[x](nowhere.md)": "nowhere.md",
    "{eq}`nolaw`": "nolaw",
    "$\\nosuch$": "not understood in an equation",
    "{py:func}`calib.nothing`": "calib.nothing",
    '```{raw} html\n<img src="https://example.org/a.png" alt="x">\n```': "<img> fetches",
}


@pytest.mark.slow
def test_faults_of_pages_stop_the_build_and_are_all_told(tmp_path: Path):
    done, _ = build(tmp_path, **PAGES | {"index.md": "\n\n".join([PAGES["index.md"], *WRONG])})
    assert done.returncode != 0
    assert [says for says in WRONG.values() if says not in done.stderr] == []
