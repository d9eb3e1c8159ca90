"""Waiting for a click on the page to select a pose or a joint in the program."""

from __future__ import annotations

from typing import Any

from inspector.app.app import App

TRIES, PAUSE_MS = 200, 50


def selected(page: Any, app: App, pose_id: str) -> None:
    """Wait until this pose is selected."""
    for _ in range(TRIES):
        if app.state.now.pose_id == pose_id:
            return
        page.wait_for_timeout(PAUSE_MS)
    raise AssertionError(f"{app.state.now.pose_id} is selected, not {pose_id}")


def joint_selected(page: Any, app: App, joint: int | None) -> None:
    """Wait until this joint, counted from 1, is selected, everywhere on the page."""
    wanted = None if joint is None else joint - 1
    for _ in range(TRIES):
        if app.state.now.joint == wanted and app.worker.wait_idle(10):
            return
        page.wait_for_timeout(PAUSE_MS)
    raise AssertionError(f"joint {app.state.now.joint} (from 0) is selected, not {wanted}")
