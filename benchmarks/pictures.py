"""Take README's pictures anew from the page on sample_data, in a headless Chromium.

    python benchmarks/pictures.py [corner] [learn] [tabs] [watch] [--out docs/pictures]

`corner` is inspector.png, one pose's corner with its faces. `learn` is learn.gif, the error that falls as effects are
found and added, and learn.png, its last picture. `tabs` is tabs/NAME.webp, every tab of the page, light and dark, and
on a phone. `watch` is watch.webp, a series of checks of a cell that drifts. Software rendering takes some minutes.
"""

from __future__ import annotations

import argparse
import datetime
import io
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib.dataset.dataset import Dataset  # noqa: E402
from calib.dataset.files.folder import write_dataset  # noqa: E402
from inspector.app.page.tabs import TABS  # noqa: E402
from inspector.panels.learn.missing_effects import FIND  # noqa: E402
from inspector.server.viser_server import url_of  # noqa: E402
from tests.support.app import idle_app  # noqa: E402
from tests.support.browser import browser, close_notices, open_page, open_tab, says  # noqa: E402
from tests.support.checked_cell import Cell  # noqa: E402

SETTLED_S = 12.0  # fonts, camera and plots, on a machine without a GPU
COLOURS = 128  # of the animation, all frames alike, so that what does not change is not stored twice
FRAME_MS, LAST_MS = 2500, 5000


@contextmanager
def page_of(dataset: str, width: int, height: int, scheme: str = "light") -> Iterator[Any]:
    """The page on a sample dataset, with the notice closed that there is no GPU."""
    with (
        idle_app(ROOT / "sample_data" / dataset, as_users_see_it=True) as app,
        browser() as running,
        open_page(running, url_of(app.server), width, height, dpr=1.0, scheme=scheme) as page,
    ):
        yield page


def picture(page: Any, settled_s: float = SETTLED_S) -> Image.Image:
    """Image of the page once nothing on it moves."""
    time.sleep(settled_s)
    close_notices(page)
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
            page.get_by_role("button", name=re.compile(f"^Add {effect}")).click()
            says(page, f"with {effect.replace('_', ' ')}")  # in the headline
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


def tabs(out: Path) -> None:
    """Every tab: light on two arms, dark and on a phone on one."""
    folder = out / "tabs"
    folder.mkdir(exist_ok=True)
    for dataset, look, width, height in LOOKS:
        names = [tab.name for tab in TABS if dataset != "rb5_jang" or tab.step == "Measure"]
        with page_of(dataset, width, height, scheme="dark" if look == "dark" else "light") as page:
            if dataset != "rb5_jang":
                page.get_by_role("button", name=FIND, exact=True).click()
                says(page, "Verdict")
            for name in names:
                if dataset != "rb5_jang" and name in ("Planes", "Corner"):
                    continue
                open_tab(page, name)
                if name == "Live":
                    page.get_by_label("Follow this folder").check()
                    says(page, "poses")
                if name == "Plan":
                    page.get_by_role("button", name="Plan the poses").click()
                slug = name.lower().replace(" ", "_") + ("_of_scans" if dataset == "rb5_jang" else "")
                picture(page, SETTLED_S if name == "Plan" else 3.0).save(
                    folder / f"{slug}_{look}.webp", quality=70, method=6
                )


def watch(out: Path) -> None:
    """Model, Watch: fourteen daily checks of a simulated cell whose third joint drifts."""
    rng = np.random.default_rng(5)
    cell = Cell.drawn(rng)
    with tempfile.TemporaryDirectory() as folder:

        def write(dataset: Dataset, day: int) -> None:
            when = str(datetime.date(2026, 3, 1) + datetime.timedelta(days=day))
            dated = replace(dataset, about=replace(dataset.about, date=when))
            write_dataset(dated, Path(folder) / dataset.name)

        write(cell.measured(rng, 64, "march"), 0)
        q = cell.measured(rng, 8).poses.q
        for day in range(1, 15):
            later = cell.with_changes({"theta3": np.radians(0.001) * day})
            write(later.measured(rng, name=f"check {day:02d}", q=q), day)
        with page_of(folder, 1280, 1000) as page:
            page.get_by_label("Dataset", exact=True).first.click()
            page.get_by_role("option", name="march").click()
            says(page, "with calibrated links")
            open_tab(page, "Watch")
            page.get_by_label("Measured later").first.click()
            page.get_by_role("option", name="all other datasets").click()
            says(page, "Over 14 checks")
            picture(page).save(out / "watch.webp", quality=75, method=6)


LOOKS = (  # dataset, name of the look, width and height of the window
    ("rb5_jang", "light", 1280, 720),
    ("hidden_effect_b", "light", 1280, 720),
    ("hidden_effect_b", "dark", 1280, 720),
    ("hidden_effect_b", "phone", 390, 844),
)
PICTURES = {"corner": corner, "learn": learn, "tabs": tabs, "watch": watch}


def main() -> None:
    """Take those that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[[], *PICTURES], metavar="corner|learn|tabs|watch")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    arguments = parser.parse_args()
    for name in arguments.names or PICTURES:
        PICTURES[name](arguments.out)


if __name__ == "__main__":
    main()
