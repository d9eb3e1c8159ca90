"""The page's server as a user starts it, with what it says, takes and writes; and an honest page on it."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import shutil
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

from soaking.inputs.commands import files_below
from tests.support.wire_client import WireClient

ROOT = Path(__file__).resolve().parents[3]
OPEN_FILES = 1024
START_S = 300.0
ASKS_AGAIN_S, GIVES_UP_S = 10.0, 60.0


def _usual_files() -> None:
    """Limit the open files to what a user's shell allows; more connections than that are part of what is tried."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))


class LiveServer:
    """`inspector serve FOLDER/served --data FOLDER/data`; home, temporary and working folder lie below FOLDER too."""

    def __init__(self, dataset: Path, folder: Path) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        for name in ("home", "tmp", "cwd", "served"):
            (folder / name).mkdir(parents=True)
        shutil.copytree(dataset, folder / "served" / dataset.name)
        self.folder, self.log = folder, folder.parent / f"{folder.name}.log"
        environment = {
            **os.environ,
            "HOME": str(folder / "home"),
            "TMPDIR": str(folder / "tmp"),
            "PYTHONPATH": str(ROOT),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-m", "inspector", "serve", str(folder / "served"), "--port", "0",
             "--data", str(folder / "data")],
            stdout=self.log.open("wb"), stderr=subprocess.STDOUT, cwd=folder / "cwd", env=environment,
            preexec_fn=_usual_files,
        )  # fmt: skip
        end = time.monotonic() + START_S
        while not (found := re.search(r"Open http://127\.0\.0\.1:(\d+)", self.said())):
            assert time.monotonic() < end, self.said()
            assert self.process.poll() is None, self.said()
            time.sleep(0.1)
        self.port = int(found[1])
        self.before = files_below(folder)

    def said(self) -> str:
        """Everything that the server printed."""
        return self.log.read_text("utf-8", "replace")

    def rss_mb(self) -> float:
        """Resident memory."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1024

    def answer_s(self) -> float:
        """Seconds until the page itself is delivered."""
        began = time.monotonic()
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/", timeout=60.0) as answer:
            answer.read()
        return time.monotonic() - began

    def written(self) -> list[str]:
        """Files that are new, gone or changed since it started."""
        now = files_below(self.folder)
        return sorted(name for name in {*now, *self.before} if now.get(name) != self.before.get(name))

    def close(self) -> None:
        """End the process."""
        self.process.terminate()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()


class HonestPage:
    """Somebody who turns to the next pose again and again, and how long each answer takes."""

    def __init__(self, port: int) -> None:
        self._page = WireClient(port)
        self._page.wait(lambda p: p.has("Pose") and len(p.props("Pose")["options"]) > 1, 120.0)
        self._poses: list[str] = list(self._page.props("Pose")["options"])
        self._page.wait(lambda p: "What could be missing:" in p.text(), 180.0)
        self.seconds: list[float] = []
        self.repeats = 0  # how often it had to ask again
        self.failure = ""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        k = 0
        while not self._over.is_set():
            k = (k + 1) % len(self._poses)
            began = time.monotonic()
            while not self._over.is_set() and not self._turned_to(k):
                self.repeats += 1
                if time.monotonic() - began > GIVES_UP_S or self._page.log[-1].startswith("connection ended"):
                    shown = re.search(rf"(\d+) of {len(self._poses)}", self._page.text())
                    self.failure = (
                        f"asked for pose {k + 1}, shown {shown and shown[1]}, {self._page.value('Pose')} chosen, "
                        f"last messages {self._page.log[-3:]}"
                    )
                    return
            self.seconds.append(time.monotonic() - began)
            self._over.wait(0.1)

    def _turned_to(self, k: int) -> bool:
        """Whether the pose is shown soon after it was asked for; another page may ask for another in between."""
        with contextlib.suppress(Exception):
            self._page.set("Pose", self._poses[k])
            self._page.wait(lambda p: f"{k + 1} of {len(self._poses)}" in p.text(), ASKS_AGAIN_S)
            return True
        return False

    def slowest_s(self) -> float:
        """The slowest answer since it was last asked."""
        now, self.seconds = self.seconds, []
        return max(now, default=0.0)

    def close(self) -> None:
        """Leave."""
        self._over.set()
        self._thread.join(70)
        self._page.close()
