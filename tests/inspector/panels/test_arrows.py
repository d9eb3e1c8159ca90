"""Residuals as arrows: whose they are, how long they are drawn, and who decides that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.calibration.model_versions import LINKS, NOMINAL
from calib.rendering import numbers
from inspector.app.app import App
from inspector.panels.model.compare import AUTOMATIC
from inspector.scene.residual_arrows import LONGEST_SHARE, drawn_as, field_mm, longest_words
from inspector.scene.scene_view import ROOT
from inspector.session.view import WORST
from tests.support.app import IDLE_S, idle
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture
def app(running: App) -> App:
    """The link errors with their arrows alone, as long as suits them."""
    running.version(LINKS)
    running.arrows(None)
    assert running.worker.wait_idle(IDLE_S)
    return running


def array(page: WireClient, name: str) -> np.ndarray:
    return np.asarray(page.scene[f"{ROOT}/residuals/arrows"]["props"][name])


def arrow_lengths_mm(page: WireClient) -> np.ndarray:
    drawn = 1000 * array(page, "points").reshape(-1, 2, 3)
    return np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)


def drawn_mm(app: App) -> np.ndarray:
    """Lengths of all arrows of the version on show, as long as they would be drawn."""
    version = app.state.now.version
    return np.linalg.norm(drawn_as(version.evaluation.error_mm, app.state.now, 1e6)[0], axis=1)


def worst(app: App, lengths_mm: np.ndarray, of_mm: np.ndarray) -> np.ndarray:
    """Those of the arrows that are drawn: of the worst poses, and of the selected one."""
    return lengths_mm[np.union1d(np.argsort(-of_mm, kind="stable")[:WORST], [app.state.now.pose])]


def longest_told(app: App, step: int) -> str:
    """How long the longest arrow of a version is, as the legend has it."""
    return f"longest {numbers.length(np.linalg.norm(app.state.now.versions[step].evaluation.error_mm, axis=1).max())}"


def test_the_factor_suits_what_is_drawn_until_one_is_chosen(app: App, page: WireClient) -> None:
    points = app.state.now.session.dataset.points
    field = field_mm(points.xyz_mm)
    app.arrows(None)
    for name in (NOMINAL, LINKS):
        app.version(name)
        idle(app)
        assert not app.state.now.arrows_chosen
        longest = arrow_lengths_mm(page).max()
        assert 0.005 * field < longest <= LONGEST_SHARE * field * 1.001
        page.wait(lambda p: p.value("Residuals ×") == f"{app.state.now.arrows:g}")
    page.set("Residuals ×", "3000")
    page.wait(lambda _: app.state.now.arrows_chosen)
    for name in (NOMINAL, LINKS):
        app.version(name)
        app.step(1)
        idle(app)
        assert app.state.now.arrows == 3000
    page.set("Residuals ×", AUTOMATIC)
    page.wait(lambda p: not app.state.now.arrows_chosen and p.value("Residuals ×") != AUTOMATIC)


def test_a_wild_arrow_is_cut_and_its_length_told(app: App) -> None:
    view = replace(app.state.now, arrows=100.0, arrows_chosen=False)
    error = np.array([[0.1, 0, 0], [0, 9.0, 0], [0, 0, 0.0]])
    arrows, cut = drawn_as(error, view, 1000.0)
    np.testing.assert_allclose(arrows, [[10, 0, 0], [0, 600, 0], [0, 0, 0]])
    assert cut.tolist() == [False, True, False]
    assert longest_words(9.0, 1) == "longest 9.00 mm; 1 cut"


def test_arrows_have_one_scale_and_fall_from_the_model_before(app: App, page: WireClient) -> None:
    app.show_step(0)
    idle(app)
    page.wait(lambda p: f"{ROOT}/before/lines" not in p.scene)
    scale, nominal_mm = app.state.now.arrows, drawn_mm(app)
    page.wait(lambda _: np.allclose(arrow_lengths_mm(page), worst(app, nominal_mm, nominal_mm), rtol=1e-3), 30.0)
    app.show_step(1)
    idle(app)
    assert app.state.now.arrows == scale
    links_mm = drawn_mm(app)
    expected_mm, nominal_mm = worst(app, links_mm, links_mm), worst(app, nominal_mm, links_mm)
    page.wait(lambda _: np.allclose(arrow_lengths_mm(page), expected_mm, rtol=1e-3), 30.0)
    assert np.median(expected_mm) < np.median(nominal_mm)
    lines = 1000 * np.asarray(page.scene[f"{ROOT}/before/lines"]["props"]["points"]).reshape(-1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1), nominal_mm, rtol=1e-3)
    app.stage.between(0.0)
    page.wait(lambda p: np.allclose(arrow_lengths_mm(page), nominal_mm, rtol=1e-3) and longest_told(app, 0) in p.text())
    app.stage.between(1.0)
    page.wait(lambda _: np.allclose(arrow_lengths_mm(page), expected_mm, rtol=1e-3))
