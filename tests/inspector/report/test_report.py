"""The report: one file that stands alone, says what the commands say, and shows hostile names as text."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import markupsafe
import numpy as np
import pytest

from calib.dataset.dataset import About, Dataset, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.present.diagnosis.budget import budget_parts
from calib.present.effects import title
from calib.present.fit.errors import length
from calib.rendering import numbers
from calib.rendering.blocks import Presentation, Table
from calib.rendering.numbers import column_mm
from inspector.cli.parser import main
from inspector.report.arm_drawing import stride
from inspector.report.page import render
from inspector.report.report import versions
from inspector.session import measuring
from inspector.session import transitions as sessions
from tests.support import ROOT
from tests.support.arms import dataset_of, jang_arm
from tests.support.commands import answered, printed
from tests.support.hidden_dataset import HIDDEN, write_hidden
from tests.support.tiny_dataset import HOSTILE

BROKEN_OUT = "</script><script>window.pwned=1</script>"


def hostile(dataset: Dataset) -> Dataset:
    """The dataset with names that would be markup if they were not escaped."""
    ids = (dataset.poses.ids[0], HOSTILE, BROKEN_OUT, *dataset.poses.ids[3:])
    robot = replace(dataset.robot, name=f"arm {HOSTILE}")
    return replace(dataset, name=HOSTILE, description=BROKEN_OUT, robot=robot, poses=replace(dataset.poses, ids=ids))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    below = tmp_path_factory.mktemp("report")
    about = About("SN 0042", "A. Smith", "hall 3", "2026-03-14")
    write_dataset(replace(hostile(load_dataset(write_hidden(below))), about=about), below / "hostile")
    return below


@pytest.fixture(scope="module")
def written(folder: Path) -> Path:
    out = folder / "new" / "report.html"
    printed("report", folder / "hostile", "--out", out)
    return out


def plain(page: str) -> str:
    """The words of a page."""
    body = page[page.index("<body>") :]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def figures(page: str) -> list[str]:
    return re.findall(r'<svg class="plot".*?</svg>', page, re.DOTALL)


@pytest.mark.slow
def test_it_says_what_diagnose_says(folder: Path, written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    found = answered("diagnose", folder / "hostile")
    words = plain(written.read_text())
    for paragraph in found["explanation"].replace("Verdict: ", "").split("\n\n"):
        assert " ".join(paragraph.split()).replace(" above", " below")[:60] in words.replace(" above", " below")
    for step in found["steps"]:
        for key in ("train_rmse_mm", "test_rmse_mm", "sigma_mm"):
            assert column_mm(step[key]) in words
    for candidate in found["candidates"]:
        assert candidate["effect"] in words
    for silent in found["untestable"]:
        assert f"{silent['effect']}: {silent['why']}" in words
    assert "Jang et al. 2025" in words
    assert "Park et al. 2022" in words
    for package, version in versions():
        assert f"{package} {version}" in words


@pytest.mark.slow
def test_the_parameters_are_those_of_the_fit(folder: Path, written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    found = answered("calibrate", folder / "hostile", "--add", HIDDEN)
    words = plain(written.read_text())
    table = words[words.index("name nominal fitted change sigma unit") :]
    undetermined = [p for p in found["parameters"] if not p["known"] and "." not in p["name"]]
    assert table.count("not determined – –") == len(undetermined) > 0
    others = sum(not p["known"] for p in found["parameters"]) - len(undetermined)
    assert f"not determined: {numbers.count(others, 'further parameter')}" in table
    for p in found["parameters"]:
        if not p["known"]:
            continue
        angle = p["unit"] == "rad" and "." not in p["name"]
        value = np.degrees(p["value"]) if angle else p["value"]
        assert numbers.signed(value, "z.4f" if "." not in p["name"] else "z.3g") in table, p["name"]
    for silent in ("θTCP", "βTCP"):  # without influence, so without a value
        assert re.search(rf"No influence on the measured point: [^.]*{silent}", words)
        assert re.search(rf"{silent} [−\d.]+ not determined – – °", table)
    lengths = [p for p in found["parameters"] if p["name"] == "a2"]
    assert f"a2 {lengths[0]['nominal']:.4f} {lengths[0]['value']:.4f}" in table


@pytest.mark.slow
def test_no_name_becomes_markup_and_nothing_is_fetched_or_run(written: Path) -> None:
    page = written.read_text()
    for name in (HOSTILE, BROKEN_OUT):
        assert name not in page
        assert str(markupsafe.escape(name)) in page
    assert "<script" not in page
    assert "script-src" not in page
    assert not re.search(r"<[^>]*\b(?:src|href|on\w+)\s*=", page)
    assert "default-src 'none'" in page


@pytest.mark.slow
def test_the_first_page_tells_the_customer_what_it_is_about(written: Path, folder: Path) -> None:
    page = written.read_text()
    words = plain("<body>" + page[page.index('<div class="first">') : page.index("<section>")])
    session = sessions.with_diagnosis(measuring.open_session(folder / "hidden"))
    for stage in session.headline.stages:
        assert f"{length(session.headline, stage.error_mm)} {stage.name}" in words
    for told in ("SN 0042", "hall 3", "A. Smith", "2026-03-14"):
        assert told in words
    assert "transmission error" in words
    assert session.budget is not None
    for part in budget_parts(session.budget):
        assert f"{part.name} {part.words}" in words
    assert "times the scatter of the measurement." in words
    assert HIDDEN not in words[: words.index("mm as delivered")]  # the verdict comes first, without keys
    assert "3D error, mm as delivered with calibrated links with transmission_error" in words
    for row in ("mean", "RMS", "maximum", "noise alone, RMS"):
        assert row in words
    assert "calibrated table" in words
    assert f"Compensate {title(HIDDEN)}" in words
    assert f"sure of {title(HIDDEN)}, measure: " in words


@pytest.mark.slow
def test_no_path_of_this_machine_is_told(written: Path, folder: Path) -> None:
    page = written.read_text()
    assert str(folder) not in page
    assert folder.name not in page


@pytest.mark.parametrize("name", ["rb5_repeats", "hidden_effect_b"])
@pytest.mark.thorough
def test_it_is_small_enough_to_send(name: str, tmp_path: Path) -> None:
    printed("report", ROOT / "sample_data" / name, "--out", tmp_path / "r.html")
    assert (tmp_path / "r.html").stat().st_size < 2_000_000


def test_a_word_that_is_too_long_for_a_column_is_broken_and_others_are_not() -> None:
    table = Table(("effect",), [("x" * 60,), ("transmission_error",)])
    drawn = render(Presentation("title", [table]))
    assert drawn.count('class="wide long"') == 1
    assert drawn.count('class="wide"') == 1  # in one line where it fits
    assert drawn.count('class="wide short"') == 1  # the heading: never broken


@pytest.mark.thorough
def test_data_without_test_poses_or_declared_noise_make_a_report_too(folder: Path, tmp_path: Path) -> None:
    dataset = load_dataset(folder / "hidden")
    role = np.where(dataset.poses.role == "test", "train", dataset.poses.role)
    bare = replace(dataset, scanner=Scanner(), poses=replace(dataset.poses, role=role))
    write_dataset(bare, tmp_path / "bare")
    out = tmp_path / "report.html"
    printed("report", tmp_path / "bare", "--out", out)
    words = plain(out.read_text())
    assert "not declared" in words
    assert "nothing confirms it" in words


@pytest.mark.thorough
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


@pytest.mark.slow
def test_data_of_a_tracker_do_not_speak_of_scans_and_corners(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    tracked = replace(dataset_of(robot, robot, rng, poses=30, test=8), jig_is_declared=False, name="tracked")
    write_dataset(tracked, tmp_path / "tracked")
    out = tmp_path / "report.html"
    printed("report", tmp_path / "tracked", "--out", out)
    words = plain(out.read_text())
    assert not re.search(r"\b(scans?|corners?)\b", words)
    assert "instrument's place" in words
    assert "placements of the instrument" in words


def test_of_many_points_so_many_are_shown_that_arrows_can_be_told_apart() -> None:
    assert [stride(count) for count in (1, 120, 121, 500)] == [1, 1, 2, 5]


PAGE_PX = (695, 1016)  # A4 less the margins of style.css, at 96 px an inch


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_in_a_browser_it_follows_the_system_and_shows_values(chromium: Any, written: Path, scheme: str) -> None:
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme)
    page = context.new_page()
    problems: list[str] = []
    asked: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda said: said.type in ("error", "warning") and problems.append(said.text))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(written.as_uri())
    assert asked == [written.as_uri()]
    assert problems == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    ground, ink = (
        page.evaluate(f"getComputedStyle(document.querySelector('{what}')).{how}")
        for what, how in (("body", "backgroundColor"), (".plot text:not(.faint)", "fill"))
    )
    light = [sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in (ground, ink)]
    assert (light[0] > 600 and light[1] < 200) == (scheme == "light")
    assert (light[0] < 200 and light[1] > 600) == (scheme == "dark")
    assert any("3D RMSE" in text for text in page.locator(".plot circle title").all_text_contents())
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    context.close()


@pytest.mark.browser
def test_on_paper_nothing_is_wider_than_the_page_or_cut(chromium: Any, written: Path) -> None:
    """Also from a dark system: light paper, the first page whole, figures and rows kept together."""
    width, height = PAGE_PX
    context = chromium.new_context(viewport={"width": width, "height": height}, color_scheme="dark")
    page = context.new_page()
    page.goto(written.as_uri())
    page.emulate_media(media="print")
    wider = page.evaluate(
        """most => [...document.querySelectorAll('main, main :not(svg *)')].filter(e => {
            const box = e.getBoundingClientRect(); return box.right > most + 1 || box.left < -1; })
            .map(e => e.outerHTML.slice(0, 120))""",
        width,
    )
    assert wider == []
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("getComputedStyle(document.querySelector('.plot text:not(.faint)')).fill") == "rgb(0, 0, 0)"
    kept = page.evaluate(
        """() => [...document.querySelectorAll('figure, tr')].map(e =>
            [getComputedStyle(e).breakInside, e.getBoundingClientRect().height])"""
    )
    assert len(kept) > 20
    assert {how for how, _ in kept} == {"avoid"}
    assert max(high for _, high in kept) < height
    first_height, then = page.evaluate(
        """() => { const first = document.querySelector('.first');
            return [first.getBoundingClientRect().height, getComputedStyle(first).breakAfter]; }"""
    )
    assert first_height <= height
    assert then == "page"
    clipped = page.evaluate(
        """() => [...document.querySelectorAll('.plot text')].filter(text => {
            const box = text.getBoundingClientRect(), all = text.closest('svg').getBoundingClientRect();
            return box.left < all.left - 1 || box.right > all.right + 1 || box.bottom > all.bottom + 1
                || box.top < all.top - 1; }).map(text => text.textContent)"""
    )
    assert clipped == []  # no label runs out of its figure
    assert len(re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))) >= 3
    context.close()
