"""Take the tutorials' pictures anew from the page and the report on sample data, in a headless Chromium.

    python benchmarks/tutorial_pictures.py [NAME ...] [--out docs/pictures]

Without names all are taken, in some minutes where there is no GPU. They are WebP, each below 200 kB.
"""

from __future__ import annotations

import argparse
import base64
import io
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from inspector.app.serving import serving  # noqa: E402
from inspector.cli.parser import main as command  # noqa: E402
from inspector.panels.learn.missing_effects import FIND  # noqa: E402
from inspector.panels.learn.plan import MAKE  # noqa: E402
from inspector.server.viser_server import url_of  # noqa: E402
from tests.support.app import IDLE_S, idle_app  # noqa: E402
from tests.support.browser import MS, browser, open_page, open_tab, says  # noqa: E402
from tests.support.code_blocks import Reader, blocks_of  # noqa: E402

SAMPLE_ARM = ROOT / "sample_data" / "rb5_jang"
WIDTH, HEIGHT = 1500, 850
LEFT_PANEL = 292
SETTLED_S = 10.0  # fonts, camera and plots, on a machine without a GPU
MOST_BYTES = 200_000
QUALITIES = (85, 75, 65, 50)  # of WebP, the first that is small enough

Take = Callable[[Any], dict[str, bytes]]  # from a running browser to PNGs by name


def sample_arm(running: Any) -> dict[str, bytes]:
    """The page on the arm with scans: as it opens, a scan's corner, the fit, what is missing, the next poses."""
    taken = {}
    with opened(running, SAMPLE_ARM) as (app, page):
        open_tab(page, "Compare")
        taken["first_sight"] = settled(page)
        open_tab(page, "Corner")
        page.get_by_label("Pose", exact=True).first.click()
        page.get_by_role("option", name="p12 ·").click()
        says(page, "Pose p12")
        taken["corner"] = settled(page, LEFT_PANEL)
        open_tab(page, "Fit")
        taken["fit"] = settled(page, LEFT_PANEL)
        open_tab(page, "What is missing")
        page.get_by_role("button", name=FIND, exact=True).click(timeout=4 * MS)
        says(page, "Verdict")
        assert app.worker.wait_idle(IDLE_S)
        taken["missing"] = settled(page)
        open_tab(page, "Plan")
        page.get_by_role("button", name=MAKE, exact=True).click(timeout=4 * MS)
        page.locator('tr[data-ask="planned"]').nth(4).wait_for(timeout=4 * MS)
        taken["plan"] = settled(page, LEFT_PANEL)
    return taken


def report(running: Any) -> dict[str, bytes]:
    """The first page of the sample arm's report."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        command(["report", str(SAMPLE_ARM), "--out", str(file)])
        page = running.new_page(viewport={"width": 1000, "height": 1250})
        page.goto(file.as_uri())
        time.sleep(1.0)
        return {"report": page.screenshot()}


def dropped_files(running: Any) -> dict[str, bytes]:
    """The window that opens where the files of the tutorial `your_points` are dropped on the page."""
    page_of_files = ROOT / "docs" / "tutorials" / "your_points.md"
    blocks = blocks_of(page_of_files)
    last = next(i for i, block in enumerate(blocks) if block.file == "shop/robot.csv")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        Reader(folder).run(blocks[: last + 1])
        files = [
            [file.name, base64.b64encode(file.read_bytes()).decode()] for file in sorted((folder / "shop").iterdir())
        ]
        with (
            serving(folder / "measured", port=0, data=folder / "my_data") as app,
            open_page(running, url_of(app.server), WIDTH, HEIGHT, dpr=1.0) as page,
        ):
            assert app.worker.wait_idle(IDLE_S)
            page.evaluate(DROP, files)
            says(page, "other way round")
            settled(page)
            return {"import": page.get_by_role("dialog").locator("visible=true").last.screenshot()}


TAKES: dict[str, Take] = {"sample_arm": sample_arm, "report": report, "import": dropped_files}
DROP = """(files) => {
  const transfer = new DataTransfer();
  for (const [name, text] of files)
    transfer.items.add(new File([Uint8Array.from(atob(text), c => c.charCodeAt(0))], name));
  const how = { dataTransfer: transfer, bubbles: true, cancelable: true };
  for (const kind of ["dragenter", "dragover", "drop"])
    document.querySelector("canvas").dispatchEvent(new DragEvent(kind, how));
}"""


@contextmanager
def opened(running: Any, folder: Path) -> Iterator[tuple[Any, Any]]:
    """The app on a dataset, and its page."""
    with (
        idle_app(folder, as_users_see_it=True) as app,
        open_page(running, url_of(app.server), WIDTH, HEIGHT, dpr=1.0) as page,
    ):
        yield app, page


def settled(page: Any, left: int = 0) -> bytes:
    """A PNG of the page from `left` on, once it stands still, without its notices."""
    page.add_style_tag(content=".mantine-Notifications-root { display: none; }")  # such as that there is no GPU
    time.sleep(SETTLED_S)
    picture: bytes = page.screenshot(clip={"x": left, "y": 0, "width": WIDTH - left, "height": HEIGHT})
    return picture


def small(png: bytes) -> bytes:
    """The picture as WebP of at most MOST_BYTES."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    for quality in QUALITIES:
        out = io.BytesIO()
        image.save(out, "WEBP", quality=quality, method=6)
        if out.tell() <= MOST_BYTES:
            return out.getvalue()
    raise AssertionError(f"{out.tell()} bytes at quality {quality}: take a smaller part of the page")


def main() -> None:
    """Take them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[*TAKES, []], metavar="NAME", help=", ".join(TAKES))
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with browser() as running:
        for name in arguments.names or TAKES:
            for picture, png in TAKES[name](running).items():
                (arguments.out / f"{picture}.webp").write_bytes(small(png))
                print(f"{picture}.webp  {len(small(png)) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
