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
    is_motion: bool = False  # whether it moves the arm through all targets: of planned poses, never of corrected ones


def form_of_targets(path: Path, *, motions: bool = False) -> TargetForm | None:
    """Form of a file of joint targets by its suffix, or None; `motions`: those that move the arm, too."""
    found = (form for form in contributions(TargetForm) if path.suffix.lower() in form.suffixes)
    return next((form for form in found if motions or not form.is_motion), None)
