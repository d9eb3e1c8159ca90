"""Sessions: each change of the model gives a new session that agrees with the functions behind it."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import pytest

from calib.errors import CalibError
from calib.present.fit.errors import last_change
from calib.rendering.blocks import plain
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.scan_cache import ScanCache
from inspector.session.session import Session, StepErrors
from tests.support.copies import ROOT
from tests.support.hidden_dataset import HIDDEN, write_hidden


@pytest.fixture(scope="module")
def ranked(tmp_path_factory: pytest.TempPathFactory) -> Session:
    opened = measuring.open_session(write_hidden(tmp_path_factory.mktemp("hidden")))
    return sessions.with_screening(sessions.with_calibration(opened))


@pytest.fixture(scope="module")
def added(ranked: Session) -> Session:
    return sessions.with_effect(ranked, HIDDEN)


def labels(session: Session) -> list[str]:
    return [step.label for step in session.history]


def test_taking_the_effect_out_gives_the_old_fit_back(ranked: Session, added: Session) -> None:
    without = sessions.without_effect(added, HIDDEN)
    assert without.effects == ()
    assert without.calibration.fit.x == pytest.approx(ranked.calibration.fit.x, rel=1e-9)
    assert labels(without)[-1] == f"\u2212 {HIDDEN}"
    assert len(without.history) == 4


@pytest.mark.parametrize("name", [HIDDEN, "no_such_effect"])
def test_wrong_names_are_refused_in_words(ranked: Session, added: Session, name: str) -> None:
    with pytest.raises(CalibError, match=name):
        sessions.with_effect(replace(added, screening=ranked.screening), name)
    with pytest.raises(CalibError, match=name):
        sessions.without_effect(ranked, name)


@pytest.mark.slow
def test_a_ranking_is_there_before_its_judgement_and_is_not_judged_twice(ranked: Session) -> None:
    early = sessions.with_ranking(replace(ranked, screening=None, pose_errors=None, residual_tests=None))
    assert early.screening is not None
    assert early.pose_errors is not None
    assert early.residual_tests is None
    assert early.advice is None
    tested = sessions.with_residual_tests(early)
    assert tested.residual_tests is not None
    assert tested.residual_tests == ranked.residual_tests
    assert tested.advice.effect == ranked.advice.effect == HIDDEN
    assert sessions.with_residual_tests(ranked) is ranked
    unranked = replace(ranked, screening=None, residual_tests=None)
    assert sessions.with_residual_tests(unranked) is unranked


def test_nothing_can_be_added_before_it_is_ranked(ranked: Session) -> None:
    with pytest.raises(CalibError, match="none is ranked yet"):
        sessions.with_effect(replace(ranked, screening=None), HIDDEN)


def test_calibrating_again_keeps_the_effects(added: Session) -> None:
    again = sessions.with_calibration(added)
    assert again.effects == added.effects
    assert labels(again) == labels(added)
    assert HIDDEN in again.calibration.model.family_names


def test_what_a_listener_raises_ends_the_diagnosis(ranked: Session) -> None:
    def no_more(words: str) -> None:
        raise KeyboardInterrupt(words)

    with pytest.raises(KeyboardInterrupt, match="fitting"):
        sessions.with_diagnosis(ranked, no_more)


@pytest.mark.parametrize(
    ("before", "after", "label", "words"),
    [
        (0.4, 0.1, "+ backlash", "falls by 75 %, from 0.40 to 0.10 mm."),
        (0.4, 0.6, "+ backlash", "rises by 50 %, from 0.40 to 0.60 mm. It does not help"),
        (0.4, 0.401, "+ backlash", "hardly changes, from 0.40 to 0.40 mm. It does not help"),
        (0.1, 0.4, "\u2212 backlash", "rises by 300 %, from 0.10 to 0.40 mm. It was needed"),
        (0.1, 0.1, "\u2212 backlash", "It was not needed"),
    ],
)
def test_whether_a_change_helped_is_said(before: float, after: float, label: str, words: str) -> None:
    history = (StepErrors("calibrated links", 0.1, before, 0.1), StepErrors(label, 0.05, after, 0.1))
    change = last_change(history)
    sentence = plain(change.words)
    assert words in sentence
    assert sentence.startswith(label)
    assert "held-out test poses" in sentence


def test_without_test_poses_the_training_error_speaks() -> None:
    nan = math.nan
    history = (StepErrors("calibrated links", 0.4, nan, 0.1), StepErrors("+ backlash", 0.2, nan, 0.1))
    change = last_change(history)
    assert "falls by 50 %" in plain(change.words)


def test_points_have_no_scans_to_search(added: Session) -> None:
    with pytest.raises(CalibError, match="no scans"):
        measuring.with_search(added, 0)


def test_no_file_of_a_dataset_is_opened_in_the_server() -> None:
    folder, opened = ROOT / "sample_data" / "rb5_jang", list[str]()
    sys.addaudithook(lambda event, told: opened.append(str(told[0])) if event == "open" and not ended else None)
    ended = False
    session = measuring.with_search(measuring.open_session(folder), 0)
    scans = ScanCache()
    scans.open(session.dataset)
    assert scans.load(0, keep=True) is not None
    ended = True
    assert session.searches[session.dataset.poses.ids[0]].corner is not None
    assert not [path for path in opened if path.startswith(str(folder))]
