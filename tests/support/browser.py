"""A real headless Chromium for tests. Without one: CI fails, elsewhere the test is skipped and says why."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from inspector.app.page.tabs import STEPS

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (  # software rendering in a container without GPU, sandbox or much shared memory
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",  # of the page itself: the emulated GPU has enough to do with the 3D view
    "--disable-gpu-compositing",
    "--no-sandbox",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-dev-shm-usage",
)
COARSE = 0.25  # of the screen's pixels an axis, in the 3D view: without a GPU it takes most of a page's time
MS = 30_000  # the longest that something on the page is waited for


def chromium_path() -> str | None:
    """The system's Chromium or Chrome; CHROMIUM overrides."""
    named = os.environ.get("CHROMIUM")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


def need_chromium() -> str:
    """The browser's path; fails in CI and skips elsewhere if there is none."""
    path = chromium_path()
    if path is not None:
        return path
    why = f"no browser: none of {', '.join(NAMES)} is installed (apt-get install chromium, or set CHROMIUM=path)"
    if os.environ.get("CI", "").lower() in ("1", "true"):
        pytest.fail(why)
    pytest.skip(why)


@contextmanager
def browser() -> Iterator[Any]:
    """A running Chromium."""
    path = need_chromium()
    with pytest.importorskip("playwright.sync_api").sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield running
        running.close()


@contextmanager
def open_page(
    running: Any, url: str, width: int = 1280, height: int = 720, dpr: float = COARSE, scheme: str = "light"
) -> Iterator[Any]:
    """A browser page on the app, once its panel is there; a script that fails on it fails the test."""
    page = running.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
    page.set_default_timeout(4 * MS)  # a busy machine draws a frame in seconds
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(f"{error}: {error.stack}"))
    page.goto(f"{url}/?fixedDpr={dpr}&hideViserLogo")
    page.get_by_role("tab", name="Measure").wait_for(timeout=60_000)
    yield page
    assert not problems, "\n".join(problems)
    page.close()


def open_tab(page: Any, name: str) -> None:
    """Open a tab of the right panel, its step first."""
    step = next(step for step, inside in STEPS.items() if name in (step, *inside))
    for label in dict.fromkeys((step, name)):
        page.locator(f'[role="tab"][data-label="{label}"]:visible').click()


def says(page: Any, text: str) -> None:
    """Wait until this can be read on the page."""
    page.get_by_text(text).locator("visible=true").first.wait_for(timeout=MS)


def close_notices(page: Any) -> None:
    """Close what covers the 3D view: that there is no GPU."""
    notices = page.locator(".mantine-Notification-closeButton")
    while notices.count():
        notices.first.click()
        page.wait_for_timeout(500)


def node_drawn(page: Any, name: str) -> None:
    """Wait until the page's 3D view has this node."""
    page.wait_for_function("name => window.__viserMutable?.nodeRefFromName?.[name] != null", arg=name, timeout=MS)


def colours_in(png: bytes) -> int:
    """Number of colours in a screenshot (a blank one has one or two)."""
    import io

    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    return len(set(image.resize((image.width // 4, image.height // 4)).get_flattened_data()))
