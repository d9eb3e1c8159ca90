"""The learning loop on the page, without a browser: add, see the error fall, undo, redo, find, many clicks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.verdict import ConfoundedSet
from calib.planning.discrimination import discriminating_poses, nearest_alternative
from calib.present.effects import not_testable, title
from calib.present.fit.residuals import input_title
from calib.rendering import numbers
from calib.screening.candidates import Untestable
from inspector.app.app import App
from inspector.figures.residual_plots import SELECTED
from inspector.markup.learn.effects import verdict_html
from inspector.panels.learn.missing_effects import FIND, REDO, REMOVE, UNDO
from inspector.panels.learn.residuals import PLACES
from inspector.scene.scene_view import ROOT
from inspector.session.session import Session
from tests.support.app import ADD, IDLE_S, command, idle_app, plain, shows
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


@pytest.mark.thorough
def test_add_undo_redo_and_remove(app: App, page: WireClient) -> None:
    start = history(page)
    assert len(start["test"]) == 2
    assert page.value("Effect") == HIDDEN  # the best comes first
    page.click(ADD)
    shows(page, f"+ {HIDDEN}: the test error fell", f"link errors + {HIDDEN}")
    page.wait(lambda p: len(history(p)["test"]) == 3)
    fallen = history(page)
    assert fallen["test"][2] < 0.5 * fallen["test"][1]
    assert fallen["test"][:2] == start["test"]
    assert numbers.column_mm(session(app).history[-1].test_rmse_mm) in plain(page)
    shows(page, "Fitted together")
    result = session(app).calibration
    assert result is not None
    fitted = [row for row in result.to_frame().to_dict("records") if row["name"].startswith(HIDDEN)]
    assert fitted
    shows(page, *(numbers.with_sigma(row["value"], row["sigma"], row["unit"]) for row in fitted))
    page.press("Model", UNDO)
    page.wait(lambda p: history(p) == start)
    page.press("Model", REDO)
    page.wait(lambda p: history(p) == fallen)
    page.set("Effect", HIDDEN)
    page.press("Model", REMOVE)
    shows(page, f"\u2212 {HIDDEN}: the test error rose", "It was needed")
    assert not page.notifications


def test_find_gives_what_the_command_gives(folder: Path, app: App, page: WireClient) -> None:
    told = command("diagnose", folder)
    page.click(FIND)
    page.wait(lambda p: "Verdict: " in plain(p), 60)
    assert app.worker.wait_idle(IDLE_S)
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


@pytest.mark.thorough
def test_an_open_verdict_names_the_effects_that_it_leaves_open(folder: Path) -> None:
    found = diagnose(load_dataset(folder))
    said = verdict_html(replace(found, confounded_sets=(ConfoundedSet("backlash", ("joint_scale",), ()),)), None)
    assert "joint_scale</a>" in said
    assert "above" not in said  # on the page the reasons come below


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
        for label in ("Against", "Show", "Worst poses"):
            page.wait(lambda p, label=label: list(p.props(label)["options"]) == ["–"])  # type: ignore[misc]


@pytest.mark.thorough
def test_the_ranking_is_the_commands_too(folder: Path, page: WireClient) -> None:
    candidates = command("diagnose", folder, "--max-steps", 0)["candidates"]
    shows(page, "What could be missing")
    assert set(page.props("Effect")["options"]) == {c["effect"] for c in candidates}
    assert page.props("Effect")["options"][0] == candidates[0]["effect"] == HIDDEN
    text = plain(page)
    assert f"{candidates[0]['log_evidence']:.1f}" in text
    assert numbers.column_mm(candidates[0]["cv_rmse_mm"]) in text
    for parameter in candidates[0]["parameters"]:
        assert parameter["name"].partition(".")[2] in text
    assert "scanner_scale: a scale error" in text


def test_the_residual_against_what_the_candidate_makes_of_it(app: App, page: WireClient) -> None:
    screening = session(app).screening
    assert screening is not None
    best = screening.candidates[0]
    figures = [json.loads(text) for text in page.figures() if text]
    points = next(f["data"][0] for f in figures if [t.get("name") for t in f["data"]][1:] == ["agreement"])
    assert points["x"] == pytest.approx(best.explained.tolist())
    assert points["y"] == pytest.approx(screening.projected.residual.tolist())
    assert np.corrcoef(points["x"], points["y"])[0, 1] > 0.9


@pytest.mark.thorough
def test_fifty_quick_clicks_add_it_once(app: App, page: WireClient) -> None:
    for _ in range(50):
        page.click(ADD)
    shows(page, f"+ {HIDDEN}: the test error fell")
    assert app.worker.wait_idle(IDLE_S)
    assert [added.name for added in session(app).effects] == [HIDDEN]
    assert session(app).screening is not None
    for _ in range(50):
        page.press("Model", UNDO)
    page.wait(lambda p: len(history(p)["test"]) == 2)
    for _ in range(50):
        page.press("Model", REDO)
    page.wait(lambda p: len(history(p)["test"]) == 3)
    assert app.worker.wait_idle(IDLE_S)
    assert not page.notifications


@pytest.mark.thorough
def test_two_pages_see_one_session_and_one_may_leave(app: App, page: WireClient) -> None:
    with WireClient(app.server.get_port()) as other:
        other.click(ADD)
        page.click(ADD)
        for seen in (page, other):
            shows(seen, f"link errors + {HIDDEN}")
        assert app.worker.wait_idle(IDLE_S)
        other.click(FIND)
    page.wait(lambda p: "Verdict: " in plain(p), 60)
    assert [added.name for added in session(app).effects] == [HIDDEN]
    with WireClient(app.server.get_port()) as late:
        shows(late, "Verdict: ", f"link errors + {HIDDEN}")


@pytest.mark.thorough
def test_two_pages_that_press_at_once_end_up_alike(app: App, page: WireClient) -> None:
    with WireClient(app.server.get_port()) as other:
        for _ in range(25):
            page.trigger("Next pose")
            other.click(ADD)
            other.press("Model", UNDO)
        assert app.worker.wait_idle(IDLE_S)
        shows(page, "26 of 45")
        shows(other, "26 of 45")
        page.click(ADD)
        shows(other, f"link errors + {HIDDEN}", "missing is the transmission error")
        assert app.worker.wait_idle(IDLE_S)
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
    assert app.worker.wait_idle(IDLE_S)
    with WireClient(app.server.get_port()) as late:
        shows(late, "Verdict: ", "2 of 45")
    assert not page.notifications


@pytest.mark.thorough
def test_an_effect_that_does_not_help_is_shown_as_such(app: App, page: WireClient) -> None:
    page.click(ADD)
    shows(page, f"+ {HIDDEN}: the test error fell")
    assert app.worker.wait_idle(IDLE_S)
    screening = session(app).screening
    assert screening is not None
    useless = next(c.name for c in screening.candidates if c.members)
    page.set("Effect", useless)
    shows(page, f"Effect {useless}")
    page.click(ADD)
    page.wait(lambda p: len(history(p)["test"]) == 4)
    old, new = (step.test_rmse_mm for step in session(app).history[-2:])
    helped = new < 0.99 * old
    page.wait(lambda p: ("It does not help" in plain(p)) != helped)


def test_the_page_goes_on_while_the_program_looks(app: App, page: WireClient) -> None:
    page.click(FIND)
    page.wait(lambda p: p.has("Stop looking"))
    page.trigger("Next pose")
    shows(page, "2 of 45")
    if page.has("Stop looking"):
        page.click("Stop looking")
    page.wait(lambda p: p.has(FIND), 30)
    assert app.worker.wait_idle(IDLE_S)
    assert not page.notifications


@pytest.mark.thorough
def test_unlisted_effects_are_told_or_ignored(app: App, page: WireClient) -> None:
    before = session(app)
    page.send(type="GuiUpdateMessage", uuid=page.find("Effect"), updates={"value": "<b>none</b>"})
    app.add_effect("<b>none</b>")
    page.wait(lambda p: p.notifications)
    assert "not among the candidates" in page.notifications[-1]["props"]["body"]
    assert "<b>none" not in page.text()
    app.remove_effect("no such effect")
    assert app.worker.wait_idle(IDLE_S)
    assert session(app) is before


@pytest.mark.thorough
def test_what_is_left_is_judged_after_each_change_without_find(app: App, page: WireClient) -> None:
    shows(page, HIDDEN, "What is left")
    page.click(ADD)
    shows(
        page,
        f"+ {HIDDEN}: the test error fell",
        "noise at the training poses",
        "missing is the transmission error",
    )
    residual_tests = session(app).residual_tests
    assert residual_tests is not None
    assert not residual_tests.structured
    page.press("Model", UNDO)
    shows(page, "What is left: a systematic dependence on")


@pytest.mark.thorough
def test_the_ranking_names_gains_parameters_and_what_tells_it_from_the_nearest(app: App, page: WireClient) -> None:
    screening, result = session(app).screening, session(app).calibration
    assert screening is not None
    assert result is not None
    best = screening.candidates[0]
    fall = round(100 * (1 - best.cv_rmse_mm / screening.cv_rmse_mm))
    rival = nearest_alternative(screening, HIDDEN)
    assert rival is not None
    shows(
        page,
        f"✓\N{NO-BREAK SPACE}{title(HIDDEN)} ",
        f"−{fall}\N{NO-BREAK SPACE}%",
        f"To tell {HIDDEN} from {rival.name}, measure here",
    )
    poses = discriminating_poses(result, (best, rival), count=3)
    text = plain(page)
    for pose in poses:
        assert ", ".join(numbers.signed(v, "z.0f") for v in np.degrees(pose.q)) in text
    for value in best.values:
        assert numbers.with_sigma(value.value, value.sigma, value.unit) in text
    other = next(c.name for c in screening.candidates[1:] if c.members)
    page.set("Effect", other)
    shows(page, f"Effect {other}", f"To tell {other} from {HIDDEN}, measure here")


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


def visible_places(page: WireClient) -> list[dict[str, Any]]:
    """The traces of the work space, where it is on show."""
    for message in page.gui.values():
        props = message.get("props", {})
        figure = json.loads(props.get("_plotly_json_str") or "{}")
        if props.get("visible") and any(t.get("yaxis") == "y2" for t in figure.get("data", [])):
            return list(figure["data"])
    return []


def ring(page: WireClient) -> tuple[float, float]:
    selected = left_plot(page)[SELECTED]
    return selected["x"][0], selected["y"][0]


def test_the_residual_is_drawn_against_what_is_chosen_test_poses_apart(app: App, page: WireClient) -> None:
    pose_errors = session(app).pose_errors
    assert pose_errors is not None
    residual_tests = session(app).residual_tests
    assert residual_tests is not None
    first = residual_tests.inputs[0]
    assert residual_tests.structured  # so it opens there
    assert page.value("Against") == input_title(first.input, session(app).dataset.robot)
    assert first.channel.name in page.value("Show")  # "joint 2" in "apparent motion of joint 2, millidegrees"
    page.set("Against", "joint 1 angle, °")
    page.set("Show", "error length")
    page.wait(lambda p: left_plot(p).get("titles") == ("joint 1 angle, °", "error length, mm"))
    for name, rows in (("training", ~pose_errors.is_test), ("test", pose_errors.is_test)):
        assert left_plot(page)[name]["y"] == pytest.approx(pose_errors.error_length_mm[rows].tolist())
    assert len(page.props("Against")["options"]) == len(pose_errors.inputs) + 1
    page.set("Against", "temperature, °C")
    page.set("Show", "apparent motion of joint 3, millidegrees")
    page.wait(lambda p: left_plot(p)["titles"] == ("temperature, °C", "apparent motion of joint 3, millidegrees"))
    degrees = 1000 * 180 / 3.141592653589793
    for name, rows in (("training", ~pose_errors.is_test), ("test", pose_errors.is_test)):
        drawn = left_plot(page)[name]
        assert drawn["x"] == pytest.approx(pose_errors.inputs["temperature_c"][rows].tolist())
        assert drawn["y"] == pytest.approx((degrees * pose_errors.apparent_joint_error[rows, 2]).tolist())


@pytest.mark.thorough
def test_the_work_space_is_a_choice_and_follows_the_selection(app: App, page: WireClient) -> None:
    pose_errors = session(app).pose_errors
    assert pose_errors is not None
    assert not visible_places(page)
    page.set("Against", PLACES)
    page.set("Show", "error length")
    page.wait(lambda p: any("error length" in t.get("hovertemplate", "") for t in visible_places(p)))
    above = next(t for t in visible_places(page) if t["name"] == "test" and t["yaxis"] == "y")
    assert above["x"] == pytest.approx(pose_errors.place_mm[pose_errors.is_test, 0].tolist())
    assert above["marker"]["color"] == pytest.approx(pose_errors.error_length_mm[pose_errors.is_test].tolist())
    page.trigger("Next pose")
    page.wait(
        lambda p: (
            next(t for t in visible_places(p) if t["name"] == SELECTED)["x"]
            == pytest.approx([pose_errors.place_mm[1, 0]])
        )
    )
    page.set("Against", "joint 1 angle, °")
    page.wait(lambda p: not visible_places(p))


def test_a_pose_chosen_among_the_worst_is_selected_everywhere(app: App, page: WireClient) -> None:
    pose_errors = session(app).pose_errors
    assert pose_errors is not None
    worst = pose_errors.worst(1)[0]
    page.set("Against", "joint 1 angle, °")
    page.set("Show", "error length")
    page.wait(lambda p: left_plot(p).get("titles") == ("joint 1 angle, °", "error length, mm"))
    page.set("Worst poses", page.props("Worst poses")["options"][1])
    page.wait(lambda p: p.value("Pose").startswith(f"{worst} "))
    page.wait(lambda p: ring(p)[1] == pytest.approx(pose_errors.error_length_mm.max()))
    page.trigger("Previous pose")
    page.wait(lambda p: not p.value("Worst poses").startswith(f"{worst} "))
    page.wait(lambda p: ring(p)[1] < pose_errors.error_length_mm.max())


@pytest.mark.thorough
def test_arrows_go_from_measured_to_predicted_and_say_how_far_they_exaggerate(app: App, page: WireClient) -> None:
    result = session(app).calibration
    assert result is not None
    assert result.dataset.points is not None
    factor = float(page.value("Residuals ×"))
    name = f"{ROOT}/residuals"
    page.wait(lambda p: f"{name}/arrows" in p.scene and p.scene[name]["visible"])
    drawn = np.asarray(page.scene[f"{name}/arrows"]["props"]["points"]).reshape(-1, 2, 3) * 1000
    np.testing.assert_allclose(drawn[:, 0], result.dataset.points.xyz_mm, atol=1e-2)
    np.testing.assert_allclose((drawn[:, 1] - drawn[:, 0]) / factor, result.after.error_mm, atol=1e-3)
    assert f"residuals × {factor:g}, longest" in page.scene[f"{name}/label"]["props"]["text"]
    page.click(ADD)
    shows(page, f"+ {HIDDEN}: the test error fell")
    assert app.worker.wait_idle(IDLE_S)
    assert float(page.value("Residuals ×")) == factor  # so that arrows shrink
    page.set("Residuals ×", "10")
    page.wait(lambda p: "residuals × 10," in p.scene[f"{name}/label"]["props"]["text"])


@pytest.mark.thorough
def test_datasets_of_points_come_with_the_model_first(page: WireClient) -> None:
    assert page.tabs()[:4] == ["Review", "Learn", "Model", "Measure"]
