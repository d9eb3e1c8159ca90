"""Forms of files of joint targets, which plug-ins write, found by the suffix."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.plugins import contributions


@dataclass(frozen=True)
class TargetForm:
    """A form of a file of joint targets; its functions are named as "module:name" and imported when they are used."""

    name: str  # of its language: "URScript"
    suffixes: tuple[str, ...]
    writer: str  # (path, robot, targets, heading) -> text; the heading's lines are comments
    check: str = ""  # (path, robot) -> None, or CalibError for an arm that it cannot hold; "" where it holds any


def form_of_targets(path: Path) -> TargetForm | None:
    """Form of a file of joint targets by its suffix, or None."""
    return next((form for form in contributions(TargetForm) if path.suffix.lower() in form.suffixes), None)
