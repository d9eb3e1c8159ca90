"""A pose left out of a session and taken in again: fits, history, undo, the session file, and the command's option."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.errors import CalibError
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.reopening import reopened
from inspector.session.session import Session, asked_out
from inspector.session.session_file import load_session
from inspector.session.transitions import with_pose_taken_in, with_poses_left_out
from inspector.session.undo import UNDO_STEPS, Undo
from tests.support.app import save_session
from tests.support.commands import answered
from tests.support.hidden_dataset import HIDDEN, write_hidden

TRAIN, TEST = "p05", "p19"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("data"), "cell")


@pytest.fixture(scope="module")
def fitted(folder: Path) -> Session:
    return sessions.with_calibration(measuring.open_session(folder))


@pytest.fixture(scope="module")
def without(fitted: Session) -> Session:
    """Without a training pose and a test pose."""
    roles = dict(zip(fitted.dataset.poses.ids, fitted.dataset.poses.role.tolist(), strict=True))
    assert (roles[TRAIN], roles[TEST]) == ("train", "test")
    return with_poses_left_out(with_poses_left_out(fitted, TRAIN), TEST)


def x(session: Session) -> np.ndarray:
    return session.calibration.fit.x


def labels(session: Session) -> list[str]:
    return [step.label for step in session.history]


def test_a_pose_that_is_left_out_is_neither_training_nor_test(fitted: Session, without: Session) -> None:
    assert without.calibration is not None
    expected = calibrate(fitted.dataset.leave_out([TRAIN, TEST]))
    assert np.array_equal(x(without), expected.fit.x)
    assert not np.array_equal(x(without), x(fitted))
    for role in ("train", "test"):
        before, after = (getattr(s.calibration.after, role) for s in (fitted, without))  # type: ignore[union-attr]
        assert after.points == before.points - 1
    assert labels(without) == ["as delivered", "calibrated links", f"− pose {TRAIN}", f"− pose {TEST}"]
    assert without.uncounted == {TRAIN, TEST}
    assert without.dataset is fitted.dataset  # so that the pose can still be looked at
    measured = without.measured.points
    assert {TRAIN, TEST}.isdisjoint(without.dataset.poses.ids[i] for i in measured.pose)


def test_taken_in_again_the_fit_is_that_of_before(fitted: Session, without: Session) -> None:
    back = with_pose_taken_in(with_pose_taken_in(without, TRAIN), TEST)
    assert np.array_equal(x(back), x(fitted))
    assert back.uncounted == frozenset()
    assert labels(back)[-2:] == [f"+ pose {TRAIN}", f"+ pose {TEST}"]


@pytest.mark.thorough
def test_what_follows_does_without_the_pose(fitted: Session, without: Session) -> None:
    """Another residual, an effect added, the ranking, redundancy, and the versions side by side."""
    pairs = sessions.with_calibration(without, "pairs")
    added = sessions.with_effect(sessions.with_screening(without), HIDDEN)
    shown = sessions.with_versions(added, added)
    for calibration in (pairs.calibration, added.calibration, *(v.calibration for v in shown.versions)):
        assert calibration.dataset.left_out == (TRAIN, TEST)
    assert labels(pairs) == labels(without)  # the last step fitted otherwise
    screened = sessions.with_screening(without)
    assert {TRAIN, TEST}.isdisjoint(screened.pose_errors.pose_ids)
    with_all, with_fewer = (measuring.with_redundancy(session).redundancy for session in (fitted, without))
    assert not np.array_equal(with_all.pearson, with_fewer.pearson, equal_nan=True)


def test_what_stands_out_can_be_taken_in_as_well(fitted: Session) -> None:
    """Poses that the search left out: one press takes them in again."""
    stands_out = sessions.search_space(fitted).without([TRAIN])
    step = replace(fitted.steps[0], calibration=stands_out.fit((), None), left_out=(TRAIN,))
    found = sessions.with_steps(fitted, [step])
    assert found.uncounted == {TRAIN}
    assert asked_out(step) == ()
    again = sessions.with_calibration(with_poses_left_out(found, TEST), "pairs")
    assert again.uncounted == {TRAIN, TEST}
    assert (again.steps[-1].left_out, asked_out(again.steps[-1])) == ((TRAIN,), (TEST,))
    back = with_pose_taken_in(with_poses_left_out(found, TEST), TRAIN)
    assert (back.uncounted, back.steps[-1].left_out) == ({TEST}, ())


@pytest.mark.parametrize(
    ("change", "pose", "message"),
    [
        (with_poses_left_out, "p005", r"no pose named 'p005'; the nearest of 45: 'p05'"),
        (with_poses_left_out, TRAIN, f"pose {TRAIN} is left out already"),
        (with_pose_taken_in, "p09", "pose p09 is not left out"),
        (with_pose_taken_in, "nix", "no pose named 'nix'"),
    ],
)
def test_what_cannot_be_is_told(without: Session, change: object, pose: str, message: str) -> None:
    with pytest.raises(CalibError, match=message):
        change(without, pose)  # type: ignore[operator]


# ---- the file --------------------------------------------------------------------------------------------------------


def opened(path: Path, folder: Path) -> Session:
    again, notes = reopened(measuring.open_session(folder), load_session(path))
    assert notes == ()
    return again


def test_the_session_file_keeps_it(without: Session, folder: Path, tmp_path: Path) -> None:
    partly = with_pose_taken_in(without, TRAIN)
    save_session(tmp_path / "s.json", partly)
    again = opened(tmp_path / "s.json", folder)
    assert np.array_equal(x(again), x(partly))
    assert labels(again) == labels(partly)
    assert again.left_out == (TEST,)
    assert list(map(asked_out, again.steps)) == list(map(asked_out, partly.steps))


# ---- undo ------------------------------------------------------------------------------------------------------------


def test_a_reopened_session_goes_back_step_by_step_and_forward(without: Session, folder: Path, tmp_path: Path) -> None:
    save_session(tmp_path / "s.json", without)
    now = opened(tmp_path / "s.json", folder)
    undo = Undo.of(now)
    before = undo.move(now, -1)
    assert before.uncounted == {TRAIN}
    assert undo.move(before, 1) is now


def test_undo_is_bounded(fitted: Session) -> None:
    undo = Undo()
    for _ in range(UNDO_STEPS + 7):
        undo.changed(fitted)
    assert len(undo.past) == UNDO_STEPS


@pytest.mark.slow
def test_a_session_keeps_so_many_steps_and_the_last_rankings_only(fitted: Session) -> None:
    """Two thousand changes hold no more than fifty."""
    ranked = sessions.with_ranking(fitted).steps[0]
    now = sessions.with_steps(fitted, [replace(ranked, label=str(k)) for k in range(70)])
    assert [step.label for step in now.steps] == ["0", *map(str, range(21, 70))]
    assert [step.screening is not None for step in now.steps] == [False] * 42 + [True] * 8
    undo, before = Undo(), sessions.with_ranking(fitted)
    for _ in range(20):
        undo.changed(replace(before))
    kept = [entry.screening is not None for entry in undo.past]
    assert kept == [False] * 12 + [True] * 8


def test_a_new_setup_starts_from_the_links_and_is_kept_in_the_file(
    fitted: Session, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = sessions.with_new_setup(sessions.with_effect(sessions.with_screening(fitted), "scanner_drift"), "p30")
    assert labels(moved) == ["as delivered", "calibrated links"]
    assert sorted(moved.calibration.after.scanner_T_base) == ["", "from p30"]
    path = folder.parent / "moved.json"
    save_session(path, moved)
    again, notes = reopened(measuring.open_session(folder), load_session(path))
    assert notes == ()
    assert np.array_equal(x(again), x(moved))
    answered("calibrate", folder, "--new-setup", "p30")
    assert "a new setup begins with pose p30, as asked" in capsys.readouterr().err
