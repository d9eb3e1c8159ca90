"""The report: one file that stands alone, says what the commands say, and shows hostile names as text."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import markupsafe
import numpy as np
import pytest

from calib.dataset.dataset import Dataset, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from inspector.cli.parser import main
from inspector.markup.parts.numbers import millimetres
from inspector.report.blocks import Table
from inspector.report.content import report_of
from inspector.report.page import render_page
from inspector.report.report import report_html, versions
from inspector.session import measuring
from inspector.session import transitions as sessions
from tests.support.hidden_dataset import HIDDEN, write_hidden
from tests.support.tiny_dataset import HOSTILE

BROKEN_OUT = "</script><script>window.pwned=1</script>"


def hostile(dataset: Dataset) -> Dataset:
    """The dataset with names that would be markup if they were not escaped."""
    ids = (dataset.poses.ids[0], HOSTILE, BROKEN_OUT, *dataset.poses.ids[3:])
    robot = replace(dataset.robot, name=f"arm {HOSTILE}")
    return replace(
        dataset, name=HOSTILE, description=BROKEN_OUT, robot=robot, poses=replace(dataset.poses, ids=ids)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    below = tmp_path_factory.mktemp("report")
    write_dataset(hostile(load_dataset(write_hidden(below))), below / "hostile")
    return below


@pytest.fixture(scope="module")
def written(folder: Path) -> Path:
    out = folder / "new" / "report.html"
    assert main(["report", str(folder / "hostile"), "--out", str(out)]) == 0
    return out


def plain(page: str) -> str:
    """The words of a page, its scripts left out."""
    body = page[page.index("<body>") : page.index('<script type="application/json"')]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def figures(page: str) -> list[dict[str, Any]]:
    found = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


@pytest.mark.slow
def test_it_says_what_diagnose_says(folder: Path, written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["diagnose", str(folder / "hostile"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    words = plain(written.read_text())
    for paragraph in found["explanation"].split("\n\n"):
        assert " ".join(paragraph.split()).replace(" above", " below")[:60] in words.replace(
            " above", " below"
        )
    for step in found["steps"]:
        for key in ("train_rmse_mm", "test_rmse_mm", "sigma_mm"):
            assert millimetres(step[key]) in words
    for candidate in found["candidates"]:
        assert candidate["effect"] in words
    for silent in found["untestable"]:
        assert f"{silent['effect']}: {silent['why']}" in words
    assert "Jang et al. 2025" in words
    assert "Park et al. 2022" in words
    for package, version in versions():
        assert f"{package} {version}" in words


@pytest.mark.slow
def test_the_parameters_are_those_of_the_fit(
    folder: Path, written: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["calibrate", str(folder / "hostile"), "--add", HIDDEN, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    words = plain(written.read_text())
    table = words[words.index("name nominal fitted change sigma unit") :]
    for p in found["parameters"]:
        angle = p["unit"] == "rad" and "." not in p["name"]
        value = np.degrees(p["value"]) if angle else p["value"]
        assert (f"{value:z.4f}" if "." not in p["name"] else f"{value:z.3g}") in table, p["name"]
    lengths = [p for p in found["parameters"] if p["name"] == "a2"]
    assert f"a2 {lengths[0]['nominal']:.4f} {lengths[0]['value']:.4f}" in table


@pytest.mark.slow
def test_figures_are_there_twice_and_hold_the_history(folder: Path, written: Path) -> None:
    drawn = figures(written.read_text())
    assert len(drawn) >= 5
    session = sessions.with_diagnosis(measuring.open_session(folder / "hostile"))
    for figure in drawn:
        assert figure["light"]["data"]
        assert figure["light"]["layout"]["font"]["color"] != figure["dark"]["layout"]["font"]["color"]
    history = drawn[0]["light"]["data"]
    assert history[0]["y"] == pytest.approx([s.train_rmse_mm for s in session.history], rel=1e-9)
    assert history[1]["y"] == pytest.approx([s.test_rmse_mm for s in session.history], rel=1e-9)
    assert history[2]["name"] == "noise alone"


def test_no_name_becomes_markup_and_nothing_is_fetched(written: Path) -> None:
    page = written.read_text()
    own = page[: page.index("<script>/**")] + page[page.rindex("<script>") :]  # without plotly.js itself
    for name in (HOSTILE, BROKEN_OUT):
        assert name not in own
        assert str(markupsafe.escape(name)) in own
    assert "pwned=1</script>" not in own
    assert not re.search(r"<[^>]*\b(?:src|href)\s*=", own)
    assert "default-src 'none'" in own


def test_a_word_that_is_too_long_for_a_column_is_broken_and_others_are_not() -> None:
    table = Table(("effect",), [("x" * 60,), ("transmission_error",)])
    drawn = render_page("title", [table], [])
    assert drawn.count('class="wide long"') == 1
    assert drawn.count('class="wide"') == 2  # the heading and the short one


@pytest.mark.slow
def test_a_model_put_together_by_hand_is_told_as_such(folder: Path) -> None:
    ranked = sessions.with_screening(sessions.with_calibration(measuring.open_session(folder / "hidden")))
    assert ranked.screening is not None
    other = next(c.name for c in ranked.screening.candidates[1:] if c.members)
    unfinished, finished = (
        sessions.with_screening(sessions.with_effect(ranked, name)) for name in (other, HIDDEN)
    )
    now = datetime(2026, 3, 4, 5, 6)
    page = plain(report_html(report_of(unfinished), now=now))
    assert f"the model (link errors + {other}) was put together by hand" in page
    assert f"+ {other}: the test error" in page
    page = plain(report_html(report_of(finished), now=now))
    assert f"({HIDDEN}): " in page
    assert "2026-03-04 05:06" in page


@pytest.mark.slow
def test_effects_that_are_given_stand_in_the_first_step(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    assert main(["report", str(folder / "hidden"), "--out", str(out), "--effect", HIDDEN]) == 0
    labels = figures(out.read_text())[0]["light"]["data"][0]["customdata"]
    assert labels[:2] == ["nominal", f"link errors + {HIDDEN}"]
    assert f"held against what the model of link errors + {HIDDEN} leaves over" in plain(out.read_text())


@pytest.mark.slow
def test_data_without_test_poses_or_declared_noise_make_a_report_too(folder: Path, tmp_path: Path) -> None:
    dataset = load_dataset(folder / "hidden")
    role = np.where(dataset.poses.role == "test", "train", dataset.poses.role)
    bare = replace(dataset, scanner=Scanner(), poses=replace(dataset.poses, role=role))
    write_dataset(bare, tmp_path / "bare")
    out = tmp_path / "report.html"
    assert main(["report", str(tmp_path / "bare"), "--out", str(out)]) == 0
    words = plain(out.read_text())
    assert "not declared" in words
    assert "Test poses, 3D RMSE" not in words


@pytest.mark.slow
def test_only_a_report_is_replaced(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "robot.toml"
    out.write_text("precious")
    arguments = ["report", str(folder / "hidden"), "--out", str(out)]
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "--force" in captured.err
    assert out.read_text() == "precious"
    assert main([*arguments, "--force"]) == 0
    assert main(arguments) == 0  # it is a report now
    assert main(["report", str(tmp_path / "nowhere"), "--out", str(tmp_path / "new.html")]) == 2
    assert main([*arguments, "--effect", "rust"]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.toml"]


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_in_a_browser_it_draws_hovers_follows_the_system_and_prints_light(
    chromium: Any, written: Path, scheme: str
) -> None:
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme)
    page = context.new_page()
    problems: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda message: problems.append(message.text))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(written.as_uri())
    count = len(figures(written.read_text()))
    page.wait_for_function(f"document.querySelectorAll('.js-plotly-plot .main-svg').length >= {count}")
    assert asked == [written.as_uri()]
    assert problems == []
    assert page.evaluate("window.pwned") is None
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    ink = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", ink)[:3])) < 200) == (scheme == "dark")
    box = page.locator("#figure1 .scatterlayer .point").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.locator("#figure1 .hoverlayer .hovertext").first.wait_for(timeout=10_000)
    assert "3D RMSE" in str(page.locator("#figure1 .hoverlayer").text_content())
    page.evaluate("addEventListener('beforeprint', () => { window.inks = [...document.querySelectorAll("
                  "'.ytitle')].map(title => title.style.fill); })")  # fmt: skip
    page.pdf(format="A4")
    assert set(page.evaluate("inks")) == {"rgb(36, 41, 47)"}  # the light version's, in both
    context.close()
