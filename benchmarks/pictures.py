"""Take README's picture of a scan's corner anew from the page on sample_data, in a headless Chromium.

    python benchmarks/pictures.py [--pose p12] [--out inspector/pictures/inspector.png]

Software rendering takes a minute or two. The other picture, `learn.png`, shows a dataset without scans.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.app import idle_app  # noqa: E402
from tests.support.browser import browser, open_page, open_tab, says  # noqa: E402

WIDTH, HEIGHT = 1600, 900
SETTLED_S = 12.0  # fonts, camera and plots, on a machine without a GPU


def corner_picture(pose: str, out: Path) -> None:
    """Measure, Corner: one pose's corner with its faces."""
    with (
        idle_app(ROOT / "sample_data" / "rb5_jang", as_users_see_it=True) as app,
        browser() as running,
        open_page(running, f"http://127.0.0.1:{app.server.get_port()}", WIDTH, HEIGHT, dpr=1.0) as page,
    ):
        open_tab(page, "Corner")
        page.get_by_label("Pose", exact=True).first.click()
        page.get_by_role("option", name=f"{pose} ·").click()
        says(page, f"Pose {pose}")
        notice = page.locator(".mantine-Notification-closeButton")  # that there is no GPU
        if notice.count():
            notice.first.click()
        time.sleep(SETTLED_S)
        page.screenshot(path=str(out))


def main() -> None:
    """Take it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pose", default="p12")
    parser.add_argument("--out", type=Path, default=ROOT / "inspector" / "pictures" / "inspector.png")
    arguments = parser.parse_args()
    corner_picture(arguments.pose, arguments.out)


if __name__ == "__main__":
    main()
