"""What was chosen for one dataset is not the next one's; what was found is selected; idle buttons are off."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inspector.app.app import App
from inspector.scene.scene_view import ROOT
from inspector.server.worker import LongWork
from inspector.session.session import Session
from tests.support.app import idle, idle_app
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twice the same arm, by two names, so that only what leaks can differ."""
    folder = tmp_path_factory.mktemp("two")
    write_hidden(folder, "one")
    shutil.copytree(folder / "one", folder / "two")
    return folder


@pytest.fixture
def app(folder: Path) -> Iterator[App]:
    with idle_app(folder) as running:
        open_(running, "one")
        yield running


def session(app: App) -> Session:
    return app.state.now.session


def open_(app: App, name: str) -> None:
    app.open(name)
    idle(app)
    assert app.state.name == name


def buttons(page: WireClient) -> tuple[str, ...]:
    """Those beside Model, as far as they are there."""
    props = page.props("Model")
    return tuple(props["options"]) if props["visible"] else ()


def other_effect(page: WireClient) -> str:
    return str(page.props("Effect")["options"][3])


@pytest.mark.thorough
def test_choices_are_one_datasets(app: App, page: WireClient) -> None:
    """Effect, residual, arrows, ellipsoids, version, redundancy, and what is plotted against what."""
    defaults = {
        label: page.value(label)
        for label in (
            "Effect",
            "Fit",
            "Residuals ×",
            "Ellipsoids ×",
            "Measured",
            "Model shown",
        )
    }
    against = [page.value("Show"), app.panels.residuals.against.value]
    chosen = {
        "Effect": other_effect(page), "Fit": "pairs", "Residuals ×": "3", "Ellipsoids ×": "3",
        "Measured": "distance", "Model shown": "as delivered", "Show": "x",
    }  # fmt: skip
    chosen["Show"] = next(o for o in page.props("Show")["options"] if o != page.value("Show"))
    for label, value in chosen.items():
        assert page.value(label) != value
        page.set(label, value)
    page.wait(lambda p: not p.props("Calibrate")["disabled"])
    page.click("Calibrate")
    page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pairs")
    idle(app)

    open_(app, "two")
    assert session(app).calibration.residual == "position"  # type: ignore[union-attr]
    with WireClient(app.server.get_port()) as other:
        assert {label: other.value(label) for label in defaults} == defaults
        assert [other.value("Show"), app.panels.residuals.against.value] == against

    open_(app, "one")
    with WireClient(app.server.get_port()) as other:
        assert {label: other.value(label) for label in defaults} == {label: chosen[label] for label in defaults}
        assert other.value("Measured") == "distance"
    assert app.state.now.arrows == 3.0


def test_a_box_and_rays_of_a_plan_end_with_what_they_belong_to(app: App) -> None:
    app.box(lambda places: np.ones(len(places), dtype=bool))
    idle(app)
    assert len(app.state.now.boxed) > 30
    open_(app, "two")
    open_(app, "one")
    assert (app.state.now.boxed, app.panels.review._boxed.content) == ((), "")
    with WireClient(app.server.get_port()) as page:
        app.plan()
        page.wait(lambda p: f"{ROOT}/plan/rays" in p.scene)
        app.tabs("Review/Model/Compare")
        page.wait(lambda p: f"{ROOT}/plan/rays" not in p.scene)
        app.tabs("Review/Learn/Plan")
        page.wait(lambda p: f"{ROOT}/plan/rays" in p.scene)


def test_a_search_that_began_before_the_first_fit_is_not_the_next_datasets(app: App) -> None:
    """Both have no calibration yet: that alone does not make them the same."""
    started = Session(session(app).dataset)
    app.state.keep(started)
    came, over = [], threading.Event()

    def work() -> LongWork:
        came.append((yield from app.model._beside(lambda: over.wait(60.0), started)))

    running = work()
    next(running)
    app.state.open("two", Session(session(app).dataset.leave_out(["p02"])))
    assert list(running) == []
    over.set()
    assert came == [None]
