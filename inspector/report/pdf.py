"""A report's page printed as PDF by a Chromium or Chrome that is installed on this machine."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

from calib.errors import CalibError

BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "chrome.exe", "msedge.exe",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)  # fmt: skip
VARIABLE = "CHROMIUM"  # of the environment: the browser's path or name
TIMEOUT_S = 120.0
_FLAGS = (
    "--headless", "--no-pdf-header-footer", "--disable-gpu", "--disable-dev-shm-usage", "--disable-extensions",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
    "--no-default-browser-check", "--no-pings", "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
_START, _SIGNED = b"%PDF", b"\n% made by robot-calibration-inspector\n"  # a comment of ours after the PDF's end
_HOW_ELSE = "or open the page that --out report.html writes in any browser and print it: it prints the same"


def find_browser() -> str | None:
    """Path of the browser that prints: the one that the variable CHROMIUM names, else the first of the usual names."""
    named = os.environ.get(VARIABLE)
    return shutil.which(named) if named else next((path for name in BROWSERS if (path := shutil.which(name))), None)


def require_browser() -> str:
    """Path of the browser that prints. Raises CalibError where there is none."""
    path = find_browser()
    if path is not None:
        return path
    named = os.environ.get(VARIABLE)
    missing = f"{VARIABLE}={named} is no program" if named else "no Chromium or Chrome is installed"
    raise CalibError(
        f"a PDF is printed by a browser, and {missing}; install Chromium or Chrome (apt-get install chromium) or set "
        f"{VARIABLE} to its path, {_HOW_ELSE}"
    )


def pdf_of(html: str, *, timeout_s: float = TIMEOUT_S) -> bytes:
    """PDF of a page, on A4. Raises CalibError where no browser is installed or it prints nothing in time."""
    browser = require_browser()
    with tempfile.TemporaryDirectory(prefix="report-", ignore_cleanup_errors=True) as folder:
        page, out = Path(folder, "page.html"), Path(folder, "page.pdf")
        page.write_text(html, encoding="utf-8")
        _run([browser, *_FLAGS, *_sandbox(), f"--user-data-dir={folder}/profile", f"--print-to-pdf={out}",
              page.as_uri()], browser, timeout_s)  # fmt: skip
        content = out.read_bytes() if out.is_file() else b""
    if not content.startswith(_START):
        raise CalibError(f"{browser}: printed no PDF; name another browser by {VARIABLE}, {_HOW_ELSE}")
    return content + _SIGNED


def is_report_pdf(path: Path) -> bool:
    """Whether a file is a PDF that this program made, or empty, so that it may be replaced."""
    content = path.read_bytes()
    return not content or (content.startswith(_START) and content.endswith(_SIGNED))


def _sandbox() -> tuple[str, ...]:
    # Chromium refuses to run as root with its sandbox. The page has no script and may load nothing.
    return ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()


def _run(command: list[str], browser: str, timeout_s: float) -> None:
    """Run a browser to its end, and end it with all processes that it started if it takes too long."""
    quiet = subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    except OSError as error:
        raise CalibError(f"{browser}: cannot be started ({error.strerror or error}); {_HOW_ELSE}") from None
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        raise CalibError(f"{browser}: printed no PDF within {timeout_s:g} s; {_HOW_ELSE}") from None
    finally:
        if process.poll() is None:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)  # its own session, so its own group
    else:
        process.kill()
    process.wait()
