"""The tab Plan gives programs that measure the planned poses, for KUKA both of their files."""

from __future__ import annotations

from pathlib import Path

import pytest

from inspector.panels.learn.plan import MAKE, plan_files
from tests.support.app import IDLE_S, idle_app, shows
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


def test_programs_are_downloaded_for_each_language(tmp_path: Path) -> None:
    with idle_app(write_hidden(tmp_path)) as app, WireClient(app.server.get_port()) as page:
        app.calibrate("position")
        assert app.worker.wait_idle(IDLE_S)
        page.set("Poses", 3)
        page.click(MAKE)
        shows(page, "3 poses for")
        page.wait(lambda p: p.props("Program")["visible"])
        programs = [each for each in plan_files() if each.group == "Program"]
        assert len(programs) == 3
        for program in programs:
            page.press("Program", program.name)
            page.wait(lambda p, program=program: program.file in p.downloads)
        page.wait(lambda p: "measure.dat" in p.downloads)
        assert b"DEF measure( )" in page.downloads["measure.src"]
        assert page.downloads["measure.script"].count(b'measure_here("') == 3
