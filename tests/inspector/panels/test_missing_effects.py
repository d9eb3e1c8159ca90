"""The learning loop on the page, without a browser: add, see the error fall, undo, redo, find, many clicks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from calib.present.effects import not_testable
from calib.present.names import input_title
from calib.screening.candidates import Untestable
from inspector.app.app import App
from inspector.figures.residual_plots import SELECTED
from inspector.panels.learn.missing_effects import FIND, REDO, UNDO
from inspector.session.session import Session
from tests.support.app import ADD, idle, idle_app, plain, shows
from tests.support.commands import answered
from tests.support.hidden_dataset import HIDDEN
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture
def app(folder: Path) -> Iterator[App]:
    with idle_app(folder) as running:
        yield running


def session(app: App) -> Session:
    return app.state.now.session


def history(page: WireClient) -> dict[str, list[float]]:
    """The curves of the error history, by name."""
    for text in page.figures():
        traces = json.loads(text).get("data", []) if text else []
        if any(t.get("name") == "noise alone" for t in traces):
            return {t["name"]: t["y"] for t in traces}
    return {}


def test_find_gives_what_the_command_gives(folder: Path, app: App, page: WireClient) -> None:
    told = answered("diagnose", folder)
    page.click(FIND)
    page.wait(lambda p: "Verdict: " in plain(p), 60)
    idle(app)
    text = plain(page)
    for paragraph in told["explanation"].split("\n\n"):
        assert paragraph in text
    assert told["missing"] == [HIDDEN]
    curves = history(page)
    assert curves["test"][1:] == pytest.approx([s["test_rmse_mm"] for s in told["steps"]])
    assert curves["training"][1:] == pytest.approx([s["train_rmse_mm"] for s in told["steps"]])
    page.wait(lambda p: p.has(FIND))  # it is not looking any more
    page.press("Model", UNDO)  # the diagnosis is one change
    page.wait(lambda p: len(history(p)["test"]) == 2)
    page.wait(lambda p: "Verdict: " not in plain(p))


def test_effects_that_cannot_be_tested_for_the_same_reason_share_a_sentence() -> None:
    silent = tuple(Untestable(name, "no masses", "weigh the links") for name in ("bending", "sag", "play"))
    other = Untestable("growth", "no temperature", "write it down")
    assert not_testable((*silent[:2], other, silent[2])) == [
        "bending, sag and play: no masses. To test them: weigh the links.",
        "growth: no temperature. To test it: write it down.",
    ]


def test_what_cannot_be_fitted_leaves_nothing_of_the_dataset_before(folder: Path, tmp_path: Path) -> None:
    for name in ("all", "few"):
        shutil.copytree(folder, tmp_path / name)
    for table in ("poses.csv", "points.csv"):
        path = tmp_path / "few" / table
        path.write_text("\n".join(path.read_text().splitlines()[:3]) + "\n")
    with idle_app(tmp_path) as app, WireClient(app.server.get_port()) as page:
        app.open("all")
        page.wait(lambda p: len(p.props("Against")["options"]) > 5, 30)
        app.open("few")
        shows(page, "needs many more", "The tab Fit")
        for label in ("Against", "Show"):
            page.wait(lambda p, label=label: list(p.props(label)["options"]) == ["–"])  # type: ignore[misc]


@pytest.mark.thorough
def test_fifty_quick_clicks_add_it_once(app: App, page: WireClient) -> None:
    for _ in range(50):
        page.click(ADD)
    shows(page, f"+ {HIDDEN}: the error of the held-out test poses falls")
    idle(app)
    assert [added.name for added in session(app).effects] == [HIDDEN]
    assert session(app).screening is not None
    for _ in range(50):
        page.press("Model", UNDO)
    page.wait(lambda p: len(history(p)["test"]) == 2)
    for _ in range(50):
        page.press("Model", REDO)
    page.wait(lambda p: len(history(p)["test"]) == 3)
    idle(app)
    assert not page.notifications


@pytest.mark.thorough
def test_two_pages_that_press_at_once_end_up_alike(app: App, page: WireClient) -> None:
    with WireClient(app.server.get_port()) as other:
        for _ in range(25):
            page.trigger("Next pose")
            other.click(ADD)
            other.press("Model", UNDO)
        idle(app)
        shows(page, "26 of 45")
        shows(other, "26 of 45")
        page.click(ADD)
        shows(other, f"calibrated links + {HIDDEN}", "missing is the transmission error")
        idle(app)
        page.wait(lambda p: p.text() == other.text() and p.figures() == other.figures())
        assert not page.notifications
        assert not other.notifications


@pytest.mark.thorough
def test_a_page_that_vanishes_in_the_middle_harms_no_one(app: App, page: WireClient) -> None:
    other = WireClient(app.server.get_port())
    other.click(FIND)
    page.wait(lambda p: p.has("Stop looking"))
    other.vanish()
    page.trigger("Next pose")
    shows(page, "2 of 45")
    page.wait(lambda p: "Verdict: " in plain(p), 60)
    idle(app)
    with WireClient(app.server.get_port()) as late:
        shows(late, "Verdict: ", "2 of 45")
    assert not page.notifications


def test_the_page_goes_on_while_the_program_looks(app: App, page: WireClient) -> None:
    page.click(FIND)
    page.wait(lambda p: p.has("Stop looking"))
    page.trigger("Next pose")
    shows(page, "2 of 45")
    if page.has("Stop looking"):
        page.click("Stop looking")
    page.wait(lambda p: p.has(FIND), 30)
    idle(app)
    assert not page.notifications


@pytest.mark.thorough
def test_what_is_left_is_judged_after_each_change_without_find(app: App, page: WireClient) -> None:
    shows(page, HIDDEN, "What is left")
    page.click(ADD)
    shows(
        page,
        f"+ {HIDDEN}: the error of the held-out test poses falls",
        "noise at the training poses",
        "missing is the transmission error",
    )
    residual_tests = session(app).residual_tests
    assert not residual_tests.structured
    page.press("Model", UNDO)
    shows(page, "What is left: a systematic dependence on")


# ---- where it fails -------------------------------------------------------------------------------------------------


def left_plot(page: WireClient) -> dict[str, Any]:
    """The traces of the plot of what is left by name, and its axes' titles."""
    for text in page.figures():
        figure = json.loads(text) if text else {}
        named = {t.get("name"): t for t in figure.get("data", [])}
        if SELECTED in named:
            layout = figure["layout"]
            return {
                **named,
                "titles": (layout["xaxis"]["title"]["text"], layout["yaxis"]["title"]["text"]),
            }
    return {}


def test_the_residual_is_drawn_against_what_is_chosen_test_poses_apart(app: App, page: WireClient) -> None:
    pose_errors = session(app).pose_errors
    residual_tests = session(app).residual_tests
    first = residual_tests.inputs[0]
    assert residual_tests.structured  # so it opens there
    assert page.value("Against") == input_title(first.input, session(app).dataset.robot)
    assert first.channel.name in page.value("Show")  # "joint 2" in "apparent motion of joint 2, millidegrees"
    page.set("Against", "joint 1 (q1), °")
    page.set("Show", "error length")
    page.wait(lambda p: left_plot(p).get("titles") == ("joint 1 (q1), °", "error length, mm"))
    for name, rows in (("training", ~pose_errors.is_test), ("test", pose_errors.is_test)):
        assert left_plot(page)[name]["y"] == pytest.approx(pose_errors.error_length_mm[rows].tolist())
    assert len(page.props("Against")["options"]) == len(pose_errors.inputs)
    page.set("Against", "temperature, °C")
    page.set("Show", "apparent motion of joint 3, millidegrees")
    page.wait(lambda p: left_plot(p)["titles"] == ("temperature, °C", "apparent motion of joint 3, millidegrees"))
    degrees = 1000 * 180 / 3.141592653589793
    for name, rows in (("training", ~pose_errors.is_test), ("test", pose_errors.is_test)):
        drawn = left_plot(page)[name]
        assert drawn["x"] == pytest.approx(pose_errors.inputs["temperature_c"][rows].tolist())
        assert drawn["y"] == pytest.approx((degrees * pose_errors.apparent_joint_error[rows, 2]).tolist())


@pytest.mark.thorough
def test_datasets_of_points_come_with_the_model_first(page: WireClient) -> None:
    assert page.tabs()[:4] == ["Review", "Learn", "Model", "Measure"]
