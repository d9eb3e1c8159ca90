"""The command `where`: frames of an arm at joint values, and how two told poses differ."""

from __future__ import annotations

from calib.dataset_import.where import frames_told
from calib.present.where import frames_document, frames_text
from inspector.cli.dataset_commands import show
from inspector.cli.options.robots import WhereOptions
from inspector.cli.robots.reading import reading_of


def run_where(options: WhereOptions) -> int:
    """Tell where frames are."""
    told = frames_told(options.robot, options.poses, options.joints, options.frame, reading_of(options))
    show(options, frames_document(told), frames_text(told))
    return 0
