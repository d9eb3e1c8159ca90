"""An extra that was taken away takes its tests with it."""

from __future__ import annotations

from pathlib import Path

_ROOT = Path(__file__).parents[2]
collect_ignore = [
    folder.name
    for folder in sorted(Path(__file__).parent.iterdir())
    if folder.is_dir()
    and not any((_ROOT / package / "extras" / folder.name).is_dir() for package in ("calib", "inspector"))
]
