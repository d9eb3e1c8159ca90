"""Take README's pictures anew from the page on sample_data, in a headless Chromium.

    python benchmarks/pictures.py [corner] [learn] [--out docs/pictures]

`corner` is inspector.png, one pose's corner with its faces. `learn` is learn.gif, the error that falls as effects are
found and added, and learn.png, its last picture. Software rendering takes a minute or two.
"""

from __future__ import annotations

import argparse
import io
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.app import ADD, idle_app  # noqa: E402
from tests.support.browser import browser, open_page, open_tab, says  # noqa: E402

SETTLED_S = 12.0  # fonts, camera and plots, on a machine without a GPU
COLOURS = 128  # of the animation, all frames alike, so that what does not change is not stored twice
FRAME_MS, LAST_MS = 2500, 5000


@contextmanager
def page_of(dataset: str, width: int, height: int) -> Iterator[Any]:
    """The page on a sample dataset, with the notice closed that there is no GPU."""
    with (
        idle_app(ROOT / "sample_data" / dataset, as_users_see_it=True) as app,
        browser() as running,
        open_page(running, f"http://127.0.0.1:{app.server.get_port()}", width, height, dpr=1.0) as page,
    ):
        yield page


def picture(page: Any) -> Image.Image:
    """Image of the page once nothing on it moves."""
    time.sleep(SETTLED_S)
    notices = page.locator(".mantine-Notification-closeButton")
    while notices.count():
        notices.first.click()
        time.sleep(0.5)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def corner(out: Path, pose: str = "p12") -> None:
    """Measure, Corner: one pose's corner with its faces."""
    with page_of("rb5_jang", 1600, 900) as page:
        open_tab(page, "Corner")
        page.get_by_label("Pose", exact=True).first.click()
        page.get_by_role("option", name=f"{pose} ·").click()
        says(page, f"Pose {pose}")
        picture(page).save(out / "inspector.png", optimize=True)


def learn(out: Path) -> None:
    """Learn, What is missing: as delivered, with calibrated links, then each effect that the page advises."""
    frames = []
    with page_of("hidden_effect_b", 1360, 880) as page:
        open_tab(page, "What is missing")
        page.get_by_role("button", name="as delivered").click()
        frames.append(picture(page))
        page.get_by_role("button", name="with calibrated links").click()
        frames.append(picture(page))
        for effect in ("joint_compliance", "backlash"):
            page.get_by_label("Effect", exact=True).click()
            page.get_by_role("option", name=effect).first.click()
            page.get_by_role("button", name=ADD).click()
            says(page, f"+ {effect}: the test error fell")
            frames.append(picture(page))
    frames[-1].save(out / "learn.png", optimize=True)
    animate(frames, out / "learn.gif")


def animate(frames: list[Image.Image], path: Path) -> None:
    """Write the images as one animation with a palette taken from all of them."""
    width, height = frames[0].size
    together = Image.new("RGB", (width, height * len(frames)))
    for row, frame in enumerate(frames):
        together.paste(frame, (0, row * height))
    palette = together.quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
    few = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    times_ms = [FRAME_MS] * (len(few) - 1) + [LAST_MS]
    few[0].save(path, save_all=True, append_images=few[1:], duration=times_ms, loop=0, optimize=True)


PICTURES = {"corner": corner, "learn": learn}


def main() -> None:
    """Take those that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[[], *PICTURES], metavar="corner|learn")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    arguments = parser.parse_args()
    for name in arguments.names or PICTURES:
        PICTURES[name](arguments.out)


if __name__ == "__main__":
    main()
