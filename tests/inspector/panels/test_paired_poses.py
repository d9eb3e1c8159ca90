"""Paired poses in the 3D view: the errors before and after the change, and what the change moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array, IndexArray
from calib.dataset.files.folder import write_dataset
from calib.simulation.simulate import simulate_dataset
from inspector.app.app import App
from inspector.scene.scene_view import ROOT
from inspector.session.view import AFTER, ALL_POSES, BEFORE, DIFFERENCE
from tests.support.app import idle
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = simulate_dataset(
        "rb5", rng=0, effects=[("joint_compliance", 12.0)], poses=24, payloads_kg=[0.0, 2.5], every_payload=True
    )
    folder = tmp_path_factory.mktemp("pairs")
    write_dataset(made.dataset, folder)
    return folder


def drawn(page: WireClient, name: str) -> np.ndarray:
    """Arrows or lines (K, 2, 3), mm, of a node of the scene."""
    return 1000.0 * np.asarray(page.scene[f"{ROOT}/{name}"]["props"]["points"]).reshape(-1, 2, 3)


@pytest.mark.thorough
def test_arrows_before_and_after_a_change_and_of_what_it_moved(app: App, page: WireClient) -> None:
    assert app.state.now.pair_choices == {}  # until a diagnosis has judged them
    app.find(True)
    idle(app)
    pairs = app.state.now.pair_choices[DIFFERENCE][1]
    assert np.any(pairs.explained_mm)
    app.version("calibrated links")
    points = app.state.now.session.dataset.points

    def starts_at(page: WireClient, poses: IndexArray) -> bool:
        arrows = drawn(page, "residuals/arrows")
        return len(arrows) == 24 and np.allclose(arrows[:, 0], points.xyz_mm[np.isin(points.pose, poses)], atol=0.01)

    page.set("Paired poses", BEFORE)
    page.wait(lambda p: starts_at(p, pairs.before))
    page.set("Paired poses", AFTER)
    page.wait(lambda p: starts_at(p, pairs.after))
    page.set("Paired poses", DIFFERENCE)

    def along(page: WireClient, name: str, expected_mm: Array) -> bool:
        vectors_mm = np.diff(drawn(page, name), axis=1)[:, 0]
        return len(vectors_mm) == 24 and np.allclose(vectors_mm, app.state.now.arrows * expected_mm, atol=0.1)

    page.wait(lambda p: along(p, "residuals/arrows", pairs.moved_mm))
    page.wait(lambda p: along(p, "before/lines", pairs.explained_mm))
    app.pairs("of no such name")
    app.pairs(ALL_POSES)
    page.wait(lambda p: len(drawn(p, "residuals/arrows")) == 48)
