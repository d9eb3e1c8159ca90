"""The advised model is judged while its advice is read: the verdict is the same as one that was waited for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from inspector.app.app import App
from inspector.session import transitions as sessions
from tests.support.app import idle, idle_app

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def running(folder: Path) -> Iterator[App]:
    with idle_app(folder, ahead=True) as app:
        yield app


def test_a_verdict_that_was_ready_is_the_one_that_would_be_found(app: App) -> None:
    before = app.state.session
    name = before.advice.effect
    expected = sessions.with_residual_tests(sessions.with_ranking(sessions.with_effect(before, name)))
    app.add_effect(name)
    idle(app)
    now = app.state.session
    assert [effect.name for effect in now.effects] == [name]
    assert [(c.name, c.log_evidence) for c in now.screening.candidates] == [
        (c.name, c.log_evidence) for c in expected.screening.candidates
    ]
    assert now.steps[-1].screening is now.screening
    assert now.versions
    assert (now.advice is None) == (expected.advice is None)
    assert (now.diagnosis and now.diagnosis.verdict) == (expected.diagnosis and expected.diagnosis.verdict)
    app.move(-1)  # and again, from the model before
    idle(app)
    assert app.state.session.effects == ()
    assert app.state.session.advice is not None
