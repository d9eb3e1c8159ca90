"""Undo and redo of a dataset's model, and what of a model is worked out before it is shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calib.calibration.model_versions import LINKS
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from inspector.session.undo import Undo
from inspector.session.view import View
from tests.support.hidden_dataset import HIDDEN, write_hidden


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = write_hidden(tmp_path_factory.mktemp("data"), "cell")
    return sessions.with_ranking(sessions.with_calibration(measuring.open_session(folder)))


def test_each_change_is_taken_back_and_made_again_as_far_as_there_are_any(fitted: Session) -> None:
    models = [replace(fitted) for _ in range(3)]
    undo = Undo()
    for before in models[:-1]:
        undo.changed(before)
    assert undo.move(models[2], -1) is models[1]
    assert undo.move(models[1], -5) is models[0]
    assert undo.move(models[0], -1) is models[0]
    assert undo.move(models[0], 2) is models[2]
    assert undo.move(models[2], -2) is models[0]
    undo.changed(models[0])  # another change: what was taken back is gone
    assert undo.future == []


def test_a_view_shows_the_versions_that_its_session_holds_and_fits_nothing(
    fitted: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = sessions.with_versions(fitted, fitted)
    with_effect = sessions.with_versions(sessions.with_effect(first, HIDDEN), first)
    links = next(version for version in with_effect.versions if version.name == LINKS)
    assert links.calibration is first.calibration  # the fit that there was, not another

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a fit inside the view")

    for module in ("calib.calibration.calibrate", "calib.calibration.model_versions"):
        monkeypatch.setattr(f"{module}.fit_measured", refused)
    view = View(Session(fitted.dataset)).with_session(first).with_session(with_effect)
    assert view.versions is with_effect.versions
    assert view.version is with_effect.versions[-1]
    assert view.compared == {with_effect.versions[-1].name}
    assert not replace(view, session=Session(fitted.dataset)).versions
