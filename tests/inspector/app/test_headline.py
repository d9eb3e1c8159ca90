"""The headline over the 3D view: what it says at each stage of the work, and what its parts ask for."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from calib.present.diagnosis.budget import budget_parts
from calib.present.fit.errors import length
from inspector.app.app import App
from inspector.panels.headline import TO_FIND, headline_html
from inspector.session.loop import FIND, FIT, MEASURE, TAKE, Progress, TaskStatus
from inspector.session.session import Session
from inspector.session.view import View
from tests.support.app import IDLE_S, plain
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture
def app(running: App) -> App:
    """With the link errors alone in the model, seen as it opens."""
    while running.state.session.effects:
        running.move(-1)
        assert running.worker.wait_idle(IDLE_S)
    return running


def steps_of(html: str) -> dict[str, str]:
    """The state of each step of the work, by its name."""
    return {name: state for state, name in re.findall(r'data-state="(\w+)" aria-label="([\w ]+), \w+"', html)}


def test_the_stages_stand_over_the_view_with_their_units(app: App) -> None:
    told = app.state.session.headline
    with WireClient(app.server.get_port()) as page:
        said = plain(page)
        for stage in told.stages:
            assert length(told, stage.error_mm) in said
            assert stage.name in said
        assert re.search(r"\(noise [\d.]+ (mm|µm)\)", said)
        assert TO_FIND in said
        assert 'data-over-view="headline"' in page.text()


def test_the_next_step_is_lit_and_starts_to_find(app: App) -> None:
    html = headline_html(app.state.now, TaskStatus())
    assert steps_of(html) == {MEASURE: "done", FIT: "done", FIND: "next", TAKE: "later"}
    assert 'data-ask="find"' in html
    assert 'data-tab="Learn/What is missing"' in html
    assert 'data-ask="find"' not in headline_html(app.state.now, TaskStatus(finding=True, words="Looking …"))
    assert "Looking …" in headline_html(app.state.now, TaskStatus(finding=True, words="Looking …"))


def test_measure_is_done_with_a_point_alone(app: App) -> None:
    dataset = replace(app.state.session.dataset, points=None, scan_folder=Path())
    failed: Any = SimpleNamespace(failure="seen from behind")
    searches = dict.fromkeys(dataset.poses.ids, failed)
    assert Progress.of(Session(dataset, searches)).next == MEASURE


def test_the_bar_divides_the_error_between_the_causes_of_the_model_on_show(app: App) -> None:
    session = app.state.session
    html = headline_html(app.state.now, TaskStatus())
    bar = html[html.index('class="headline-budget"') : html.index('class="headline-note"')]
    for part in budget_parts(session.budget):
        assert f"{part.name} {part.words}: " in unescape(bar)
        assert bar.count(part.colour) == 2  # in the bar and in its legend
    assert len(re.findall(r"<i style=.flex-grow", bar)) == len(session.budget.shares)
    assert session.budget.shares[0].cause == "geometry"
    assert "headline-budget" not in headline_html(View(Session(session.dataset)), TaskStatus())
