"""The tab Live follows the folder of the dataset on show while it is being measured."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.extras.follow.present.campaign import outlook_sentences
from inspector.extras.follow.live_panel import FOLLOW, SHOW
from tests.support.app import IDLE_S, idle_app, plain, shows
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


def test_a_campaign_is_opened_half_measured_followed_and_shown(tmp_path: Path) -> None:
    folder = write_hidden(tmp_path)
    header, *lines = (folder / "points.csv").read_text().splitlines(keepends=True)
    (folder / "points.csv").write_text("".join([header, *lines[:3]]) + lines[3][:9])  # a writer in the middle of a line
    with idle_app(folder) as app, WireClient(app.server.get_port()) as page:
        shows(page, "still being measured?", "points.csv: line 5")
        page.set(FOLLOW, True)
        shows(page, "3 of 3 poses good", "No error is predicted yet: 3 of at least 9 poses")
        strange = "shot 9" + lines[3][lines[3].index(",") :]
        (folder / "points.csv").write_text("".join([header, *lines[:3], strange]))
        shows(page, "of no pose that poses.csv has (yet): shot 9")
        (folder / "points.csv").write_text("".join([header, *lines]))
        shows(page, f"{len(lines)} of {len(lines)} poses good", "Predicted error at")
        assert page.has(SHOW)
        campaign = app.contributed["Live"].campaign
        assert campaign is not None
        shows(page, *outlook_sentences(campaign))
        page.set(FOLLOW, False)
        page.click(SHOW)
        page.wait(lambda p: "still being measured?" not in plain(p))
        assert app.worker.wait_idle(IDLE_S)
        assert app.state.session.calibration is not None
