"""Dark or light belongs to each page: as its browser prefers, or as chosen there; the server hears nothing of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from inspector.app.app import App
from inspector.server.viser_server import url_of
from tests.support.app import idle, idle_app, shows
from tests.support.browser import COARSE, MS, open_tab
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SCHEME = "document.documentElement.dataset.mantineColorScheme"
SEEN = """() => {
  const plain = (element, name) => getComputedStyle(element)[name].match(/[\\d.]+/g).slice(0, 3).map(Number);
  const view = document.querySelector("canvas").closest('div[style^="background-color"]');
  const ticks = [...document.querySelectorAll(".js-plotly-plot .xtick text")];
  const labels = [];
  window.__viserMutable.scene.traverse((node) => {
    if (node.material?.uniforms?.uLabelData) labels.push(node.material.fragmentShader);
  });
  return {
    view: plain(view, "backgroundColor")[0], panel: plain(document.body, "backgroundColor")[0],
    tick: plain(ticks.find((each) => each.getClientRects().length), "fill")[0],
    whiteLabels: labels.some((shader) => shader.includes("vec4(1.0, 1.0, 1.0,")),
  };
}"""


@pytest.fixture(scope="module")
def running(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    del chromium
    with idle_app(write_hidden(tmp_path_factory.mktemp("theme") / "hidden")) as app:
        yield app


@contextmanager
def theme_page(chromium: Any, app: App, prefers: str, address: str = "") -> Iterator[Any]:
    """A page of a browser of its own that prefers "dark" or "light", on the tab Fit."""
    context = chromium.new_context(viewport={"width": 1280, "height": 720}, color_scheme=prefers)
    page = context.new_page()
    page.set_default_timeout(2 * MS)
    opened(page, app, address)
    yield page
    context.close()


def opened(page: Any, app: App, address: str = "") -> None:
    page.goto(f"{url_of(app.server)}/?fixedDpr={COARSE}{address}")
    page.get_by_role("tab", name="Measure").wait_for(timeout=60_000)
    open_tab(page, "Fit")
    page.locator(".js-plotly-plot .xtick text").first.wait_for(state="attached", timeout=MS)


def becomes(page: Any, scheme: str) -> None:
    """Wait until the page is light or dark, everything of it."""
    page.wait_for_function(f"scheme => {SCHEME} === scheme", arg=scheme)
    dark = scheme == "dark"
    page.wait_for_function(f"dark => ({SEEN})().whiteLabels !== dark", arg=dark)
    seen = page.evaluate(SEEN)
    assert (seen["view"] < 60, seen["panel"] < 60, seen["tick"] > 150) == (dark, dark, dark), seen


def press_d(page: Any) -> None:
    page.mouse.click(600, 650)
    page.keyboard.press("d")


@pytest.mark.thorough
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_is_as_its_browser_prefers(app: App, chromium: Any, scheme: str) -> None:
    other = "light" if scheme == "dark" else "dark"
    with theme_page(chromium, app, scheme) as page:
        becomes(page, scheme)
        page.emulate_media(color_scheme=other)
        becomes(page, other)


@pytest.mark.thorough
def test_d_turns_one_page_and_no_figure_is_sent_again(app: App, chromium: Any) -> None:
    idle(app)
    with theme_page(chromium, app, "light") as one, theme_page(chromium, app, "light") as other:
        with WireClient(app.server.get_port()) as wire:
            shows(wire, "3 pages are open")  # two browsers and this: nothing of their arrival comes later
            idle(app)
            figures = wire.figures()
            one.evaluate("() => window.was = [...document.querySelectorAll('.js-plotly-plot')].map(each => each.data)")
            log = len(wire.log)
            press_d(one)
            becomes(one, "dark")
            becomes(other, "light")
            idle(app)
            assert wire.figures() == figures
            assert not [kind for kind in list(wire.log)[log:] if "Theme" in kind or "GuiUpdate" in kind]
        assert one.evaluate(
            "() => [...document.querySelectorAll('.js-plotly-plot')].every((each, k) => each.data === window.was[k])"
        )


@pytest.mark.thorough
def test_a_choice_is_kept_by_the_browser_and_the_address_begins_dark(app: App, chromium: Any) -> None:
    with theme_page(chromium, app, "light") as page:
        press_d(page)
        becomes(page, "dark")
        opened(page, app)
        becomes(page, "dark")
        press_d(page)
        opened(page, app)
        becomes(page, "light")
        opened(page, app, "&darkMode")
        becomes(page, "dark")
        press_d(page)
        becomes(page, "light")
