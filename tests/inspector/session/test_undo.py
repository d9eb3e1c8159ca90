"""Undo and redo of a dataset's model, and what of a model is worked out before it is shown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from inspector.session.undo import Undo
from tests.support.hidden_dataset import write_hidden


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
