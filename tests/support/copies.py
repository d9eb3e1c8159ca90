"""A copy of the checkout without its extras, or without one of them, in which the rest is tried.

    python -m tests.support.copies FOLDER [EXTRA ...]

writes to a new or an empty folder all files of the project except those of the named extras; without a name all of
`calib/extras` and `inspector/extras`, and their tests.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("calib", "inspector")
_NOT_KEPT = re.compile(r"(^|/)(\.(?!ci/|github/|gitignore|pre-commit)|__pycache__|build/|dist/|my_data/)|\.egg-info/")


def tracked_files() -> list[Path]:
    """Files of the repository; where git cannot tell (not installed, an unpacked archive) every file that is kept."""
    try:
        said = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        listing = subprocess.run(said, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        listing = ""
    if not listing:
        names = (path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*") if path.is_file())
        listing = "\0".join(name for name in names if not _NOT_KEPT.search(name))
    return [ROOT / name for name in sorted(listing.split("\0")) if name and (ROOT / name).is_file()]


def extras() -> list[str]:
    """Names of the extras that are here."""
    folders = (path for package in PACKAGES for path in (ROOT / package / "extras").glob("*/plugin.py"))
    return sorted({path.parent.name for path in folders})


def copy_without(target: Path, names: Sequence[str] = ()) -> None:
    """Write the project to a folder without these extras; where none is named, without all of them and their tests."""
    gone = [Path(package, "extras", name) for package in PACKAGES for name in names]
    gone = gone or [*(Path(package, "extras") for package in PACKAGES), Path("tests", "extras")]
    if target.exists() and any(target.iterdir()):
        raise SystemExit(f"{target}: exists and is not empty; name a new folder")
    for source in tracked_files():
        name = source.relative_to(ROOT)
        if not any(name.is_relative_to(folder) for folder in gone):
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target / name)


if __name__ == "__main__":
    copy_without(Path(sys.argv[1]), sys.argv[2:])
