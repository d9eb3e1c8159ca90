"""What was chosen for one dataset is not the next one's; what was found is selected; idle buttons are off."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from inspector.app.app import App
from inspector.panels.learn.missing_effects import FIND, REDO, REMOVE, UNDO
from inspector.server.worker import LongWork
from inspector.session.session import Session
from inspector.session.view import BY_ERROR, BY_ROLE
from tests.support.app import ADD, IDLE_S, idle_app, plain
from tests.support.hidden_dataset import HIDDEN, write_hidden
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
    assert app.worker.wait_idle(IDLE_S)
    assert app.state.name == name


def buttons(page: WireClient) -> tuple[str, ...]:
    """Those beside Model, as far as they are there."""
    props = page.props("Model")
    return tuple(props["options"]) if props["visible"] else ()


def other_effect(page: WireClient) -> str:
    return str(page.props("Effect")["options"][3])


@pytest.mark.thorough
def test_choices_are_one_datasets(app: App, page: WireClient) -> None:
    """Effect, residual, arrows, ellipsoids, colours, version, redundancy, and what is plotted against what."""
    defaults = {
        label: page.value(label)
        for label in (
            "Effect",
            "Fit",
            "Residuals ×",
            "Ellipsoids ×",
            "Measured",
            "Measured points",
            "Model shown",
        )
    }
    against = [page.value("Show"), app.panels.residuals.against.value]
    chosen = {
        "Effect": other_effect(page), "Fit": "pairs", "Residuals ×": "3", "Ellipsoids ×": "3",
        "Measured": "distance", "Measured points": BY_ERROR, "Model shown": "nominal", "Show": "x",
    }  # fmt: skip
    chosen["Show"] = next(o for o in page.props("Show")["options"] if o != page.value("Show"))
    for label, value in chosen.items():
        assert page.value(label) != value
        page.set(label, value)
    page.wait(lambda p: not p.props("Calibrate")["disabled"])
    page.click("Calibrate")
    page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pairs")
    assert app.worker.wait_idle(IDLE_S)

    open_(app, "two")
    assert session(app).calibration.residual == "position"  # type: ignore[union-attr]
    with WireClient(app.server.get_port()) as other:
        assert {label: other.value(label) for label in defaults} == defaults
        assert [other.value("Show"), app.panels.residuals.against.value] == against
    assert app.state.now.colouring == BY_ROLE

    open_(app, "one")
    with WireClient(app.server.get_port()) as other:
        assert {label: other.value(label) for label in defaults} == {label: chosen[label] for label in defaults}
        assert other.value("Measured") == "distance"
    assert app.state.now.colouring == BY_ERROR
    assert app.state.now.arrows == 3.0


def test_a_search_that_began_before_the_first_fit_is_not_the_next_datasets(app: App) -> None:
    """Both have no calibration yet: that alone does not make them the same."""
    started = Session(session(app).dataset)
    app.state.keep(started)
    came = []

    def work() -> LongWork:
        came.append((yield from app.model._shown.beside(lambda: "found", started)))

    running = work()
    next(running)
    app.state.open("two", Session(session(app).dataset.leave_out(["p02"])))
    assert list(running) == []
    assert came == [None]


@pytest.mark.thorough
def test_what_was_found_is_what_is_selected(app: App, page: WireClient) -> None:
    page.set("Effect", other_effect(page))
    page.click(FIND)
    page.wait(lambda p: "Verdict: " in plain(p), 60.0)
    assert app.worker.wait_idle(IDLE_S)
    found = session(app).effects[-1].name
    assert found == HIDDEN
    page.wait(lambda p: p.value("Effect") == found)
    page.wait(lambda p: "It is in the model. Fitted together" in plain(p))  # is drawn after the choice


@pytest.mark.thorough
def test_buttons_that_would_do_nothing_are_off(app: App, page: WireClient) -> None:
    assert buttons(page) == ()  # nothing to undo, and the effect that is chosen is not in the model
    assert page.props("Calibrate")["disabled"]
    assert not page.props(FIND)["disabled"]
    page.click(ADD)
    page.wait(lambda p: buttons(p) == (REMOVE, UNDO))
    assert page.props(ADD)["disabled"]
    page.set("Effect", other_effect(page))
    page.wait(lambda p: buttons(p) == (UNDO,))
    assert app.worker.wait_idle(IDLE_S)
    page.press("Model", UNDO)
    page.wait(lambda p: buttons(p) == (REDO,))
    page.set("Fit", "pairs")
    page.wait(lambda p: not p.props("Calibrate")["disabled"])
    page.click("Calibrate")
    page.wait(lambda p: buttons(p) == (UNDO,) and p.props("Calibrate")["disabled"])
    assert app.worker.wait_idle(IDLE_S)
    page.press("Model", UNDO)  # goes back through another residual, too
    page.wait(lambda p: p.value("Fit") == "position")
    assert app.worker.wait_idle(IDLE_S)
    page.click(FIND)
    page.wait(lambda p: p.has(FIND) and p.props(FIND)["disabled"], 60.0)
    assert app.worker.wait_idle(IDLE_S)
    assert not page.notifications


def test_points_without_orientations_are_offered_no_full_poses(page: WireClient) -> None:
    for label in ("Fit", "Measured"):
        assert list(page.props(label)["options"]) == ["position", "distance", "pairs"]


@pytest.mark.thorough
def test_measured_points_speak_of_no_scans_and_corners(page: WireClient) -> None:
    """But for the names of tabs, which serve all datasets of a folder, and the command that has such a name."""
    said = plain(page).replace("inspector corners", "")
    assert not re.findall(r"\b(?:scans?|corners?|jig)\b[^.]*", said, re.IGNORECASE)
    assert list(page.props("3D view")["options"]) == ["Arm", "All points", "Point"]
    for label in ("This corner", "All corners"):
        assert not page.has(label)


@pytest.mark.thorough
def test_the_figures_of_the_dataset_before_are_gone_at_once(app: App, page: WireClient) -> None:
    page.wait(lambda p: "as delivered" in plain(p))
    seen: list[str] = []
    headline = app.panels.headline
    shown, headline.opening = headline.opening, lambda name: (shown(name), seen.append(headline._sent))[0]  # type: ignore[method-assign]
    open_(app, "two")
    (opening,) = seen
    assert "Opening two" in opening
    assert "mm" not in opening
    page.wait(lambda p: "as delivered" in plain(p))
