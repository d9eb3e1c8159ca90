"""A box drawn over the 3D view: what it holds, and what can be done with the poses in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.present.diagnosis.candidates import explained_at
from calib.screening.candidates import explained_shares_at
from inspector.app.app import App
from inspector.scene.scene_view import Sight
from tests.support.app import idle_app
from tests.support.hidden_dataset import HIDDEN, write_hidden


def sight(rotation: Array | None = None, position: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Sight:
    return Sight(np.array(position), np.eye(3) if rotation is None else rotation, np.pi / 2, 2.0)


def test_the_screen_begins_left_above_and_what_lies_behind_is_not_seen() -> None:
    seen = sight().on_screen(np.array([[0.0, 0, 1], [2, 1, 1], [-2, -1, 1], [0, 0, -1]]))
    np.testing.assert_allclose(seen[:3], [[0.5, 0.5], [1, 1], [0, 0]], atol=1e-12)
    assert np.isnan(seen[3]).all()
    assert sight().in_box(np.array([[0.0, 0, 1], [2, 1, 1], [0, 0, -1]]), (0.6, 0.6), (0.4, 0.4)).tolist() == [1, 0, 0]


@given(st.integers(0, 2**31))
def test_a_turn_of_camera_and_points_together_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3)
    points = rng.normal(size=(9, 3))
    moved = sight(turn, tuple(shift)).on_screen(points @ turn.T + shift)
    np.testing.assert_allclose(moved, sight().on_screen(points), atol=1e-9)


@pytest.fixture
def app(tmp_path: Path) -> object:
    with idle_app(write_hidden(tmp_path / "hidden")) as running:
        yield running


@pytest.mark.slow
def test_the_hidden_effect_explains_most_at_any_poses(app: App) -> None:
    screening = app.state.now.session.screening
    ids = tuple(dict.fromkeys(screening.projected.row_poses))[:8]
    shares = explained_shares_at(screening, ids)
    assert max(shares, key=shares.__getitem__) == HIDDEN
    every = explained_shares_at(screening, screening.projected.row_poses)
    best = next(c for c in screening.candidates if c.name == HIDDEN)
    assert every[HIDDEN] == pytest.approx(best.explained_share, abs=0.05)
    assert explained_shares_at(screening, ["nobody"]) == {}
    assert len(explained_at(screening, ["nobody"])) == 1
