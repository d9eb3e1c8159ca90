"""A robot program that a page brings comes back corrected, all else byte for byte."""

from __future__ import annotations

from pathlib import Path

import pytest

from inspector.app.serving import serving
from inspector.panels.downloads import TARGETS
from tests.support.app import IDLE_S, shows, without_reflections
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running

PROGRAM = """def main():
  # pick
  movej([0.1, -1.2, 1.4, -0.3, 0.8, 0.2], a=1.0, v=0.5)
  movej([0.4, -1.0, 1.2, -0.2, 0.9, 0.1], a=1.0, v=0.5)
end
"""


def test_a_program_comes_back_with_its_joints_corrected(tmp_path: Path) -> None:
    with serving(write_hidden(tmp_path / "served"), port=0, data=tmp_path / "data") as app:
        without_reflections(app)
        assert app.worker.wait_idle(IDLE_S)
        with WireClient(app.server.get_port()) as page:
            page.upload(TARGETS, "pick.script", PROGRAM.encode())
            page.wait(lambda p: "corrected_pick.script" in p.downloads)
            before, after = PROGRAM.splitlines(), page.downloads["corrected_pick.script"].decode().splitlines()
            shows(page, "2 of 2 targets corrected")
    changed = [old != new for old, new in zip(before, after, strict=True)]
    assert changed == [False, False, True, True, False]
    assert after[2].endswith("], a=1.0, v=0.5)")
