"""What is carried off: every file against the numbers that it is made of, from the command and from the page."""

from __future__ import annotations

import html
import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calib.calibration.residual_table import residual_table
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml
from calib.diagnosis.search_space import add_in_turn
from calib.models.exported_table import exported_table
from calib.models.model_file import load_model
from calib.rendering import numbers
from calib.robot_formats.robots import load_robot, save_robot
from calib.simulation.simulate import simulate_dataset
from calib.statistics import rms
from inspector.app.app import App
from inspector.export import csv_files as exports
from inspector.panels.downloads import ITEMS, OWN_FILE
from inspector.server.viser_server import url_of
from inspector.session.reopening import dataset_of, opening
from inspector.session.session_file import load_session
from tests.support.app import idle, idle_app
from tests.support.browser import open_page
from tests.support.commands import answered, printed
from tests.support.hidden_dataset import HIDDEN, write_hidden
from tests.support.tiny_dataset import HOSTILE
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    below = tmp_path_factory.mktemp("exports")
    plain = load_dataset(write_hidden(below, "plain"))
    names = ["new" if i % 2 else "=old" for i in range(len(plain.poses))]
    extra = pd.DataFrame({"batch": names, "error_mm": np.arange(len(names), dtype=float)})
    poses = replace(plain.poses, extra=extra)
    write_dataset(replace(plain, name=HOSTILE, poses=poses), below / "cell")
    return below / "cell"


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return load_dataset(folder)


@pytest.fixture(scope="module")
def fitted(dataset: Dataset) -> Calibration:
    return add_in_turn(dataset, [HIDDEN])[-1].calibration


# ---- tables ---------------------------------------------------------------------------------------------------------


def test_residuals_have_a_row_a_pose_and_give_the_figures_of_the_fit(dataset: Dataset, fitted: Calibration) -> None:
    table = pd.read_csv(io.StringIO(exports.residuals_csv(fitted)))
    assert table["pose"].tolist() == list(dataset.poses.ids)
    assert table["role"].tolist() == dataset.poses.role.tolist()
    error = table[[f"error_{axis}_mm" for axis in "xyz"]].to_numpy()
    predicted = table[[f"predicted_{axis}_mm" for axis in "xyz"]].to_numpy()
    measured = table[[f"measured_{axis}_mm" for axis in "xyz"]].to_numpy()
    np.testing.assert_allclose(predicted - measured, error, atol=2e-6)  # six decimals
    np.testing.assert_allclose(table["error_mm"], np.linalg.norm(error, axis=1), atol=2e-6)
    np.testing.assert_allclose(measured, dataset.points.xyz_mm, atol=1e-6)  # one point a pose here
    for of, rows in (
        (fitted.after.test, table["role"] == "test"),
        (fitted.after.train, table["role"] != "test"),
    ):
        assert rms(table["error_mm"][rows]) == pytest.approx(of.rmse_mm, abs=1e-6)
        assert table["error_mm"][rows].max() == pytest.approx(of.max_mm, abs=1e-6)


def test_repeats_of_a_pose_are_one_row(dataset: Dataset, fitted: Calibration) -> None:
    twice = np.repeat(np.arange(len(dataset.points)), 2)
    points = dataset.points.select(twice)
    shift = np.tile([[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0]], (len(dataset.points), 1))
    doubled = dataset.with_points(replace(points, xyz_mm=points.xyz_mm + shift))
    table = residual_table(add_in_turn(doubled, [])[-1].calibration)
    assert (table["points"] == 2).all()
    measured = table[[f"measured_{axis}_mm" for axis in "xyz"]].to_numpy()
    np.testing.assert_allclose(measured, dataset.points.xyz_mm, atol=1e-6)
    assert len(residual_table(fitted)) == len(table)


@pytest.mark.parametrize(
    ("dataset_name", "name"),
    [
        ("cell", "cell_report.html"),
        ("../../etc/passwd", "etc_passwd_report.html"),
        (HOSTILE, "img_src_x_onerror_window_pwned_1_b_p2_b_report.html"),
        ("", "dataset_report.html"),
        ("...", "dataset_report.html"),
        ("机器人", "dataset_report.html"),
        ("a" * 500, "a" * 60 + "_report.html"),
    ],
)
def test_file_names_are_harmless(dataset_name: str, name: str) -> None:
    assert exports.file_name(dataset_name, "report.html") == name


# ---- commands -------------------------------------------------------------------------------------------------------


def test_one_command_writes_them_all_and_another_opens_the_session(
    folder: Path, fitted: Calibration, tmp_path: Path
) -> None:
    files = {name: tmp_path / "new" / name for name in ("robot.toml", "r.csv", "s.json")}
    flags = ("--out", "--residuals", "--session")
    given = [str(part) for pair in zip(flags, files.values(), strict=True) for part in pair]
    document = answered("calibrate", folder, "--add", HIDDEN, *given)
    table = exported_table(fitted)  # best without the effect, which no table can hold
    assert load_robot_toml(files["robot.toml"]).table == pytest.approx(table.robot.table, rel=1e-12)
    assert files["robot.toml"].read_text() == table.to_toml()
    alone = document["table_alone"]
    assert alone["without_effects"] == [HIDDEN]
    assert f"test RMSE {numbers.length(alone['test']['rmse_mm'])}" in files["robot.toml"].read_text().splitlines()[0]
    assert files["r.csv"].read_text() == exports.residuals_csv(fitted)
    read = load_session(files["s.json"])
    assert dataset_of(read, folder.parent) == folder
    assert [step.label for step in read.history] == ["as delivered", "calibrated links", f"+ {HIDDEN}"]
    assert read.history[-1].test_rmse_mm == pytest.approx(document["test"]["rmse_mm"], rel=1e-12)
    assert opening(read, folder)[1] == ()


def test_the_redundancy_matrix_is_that_of_the_json(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    document = answered("redundancy", folder, "--out", out)
    table = pd.read_csv(out, index_col="parameter")
    assert table.index.tolist() == table.columns.tolist() == document["parameters"]
    np.testing.assert_allclose(table.to_numpy(), np.array(document["pearson"], dtype=float), atol=1e-12)


# ---- the page -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def running(folder: Path) -> Iterator[App]:
    before = {path: path.read_bytes() for path in folder.parent.rglob("*") if path.is_file()}
    with idle_app(folder) as app:
        app.add_effect(HIDDEN)
        idle(app)
        yield app
    after = {path: path.read_bytes() for path in folder.parent.rglob("*") if path.is_file()}
    assert before == after  # nothing was written where the server runs


def taken(page: WireClient, what: str) -> bytes:
    page.downloads.clear()
    page.click(what)
    page.wait(lambda p: p.downloads, 30.0)
    (name, content), *more = page.downloads.items()
    assert not more
    assert name.startswith("img_src_x_onerror_")
    return content


def test_the_page_gives_what_the_commands_give(app: App, fitted: Calibration, dataset: Dataset, tmp_path: Path) -> None:
    with WireClient(app.server.get_port()) as page:
        assert taken(page, "Residuals (CSV)").decode() == exports.residuals_csv(fitted)
        assert taken(page, "Measured points (CSV)").decode() == exports.corners_csv(dataset)
        path = tmp_path / "robot.toml"
        path.write_bytes(taken(page, "Calibrated robot (TOML)"))
        alone = exported_table(fitted)
        assert load_robot_toml(path).table == pytest.approx(alone.robot.table, rel=1e-12)
        words = "What robot.toml can hold, the table alone, fitted without "
        assert alone.comment in path.read_text()
        assert words in html.unescape(page.text())
        (tmp_path / "model.json").write_bytes(taken(page, "Full model (JSON)"))
        np.testing.assert_array_equal(load_model(tmp_path / "model.json").x, fitted.fit.x)
        table = pd.read_csv(io.BytesIO(taken(page, "Redundancy (CSV)")), index_col="parameter")
        assert table.shape == (35, 35)
        report = taken(page, "Report (HTML)").decode()
        assert f"calibrated links + {HIDDEN}" in report
        assert words in html.unescape(report)
        assert HOSTILE not in report


def test_every_item_has_a_button_that_says_what_it_holds(app: App) -> None:
    with WireClient(app.server.get_port()) as page:
        for name, item in ITEMS.items():
            offered = name != OWN_FILE  # no URDF was kept with these data
            assert page.props(name)["visible"] == offered
            assert item.holds in html.unescape(page.text()) or not offered


@pytest.mark.thorough
def test_a_session_from_the_page_opens_in_the_same_state(app: App, folder: Path, tmp_path: Path) -> None:
    app.select(7)
    app.show_view("Corner")
    app.arrows(300.0)
    idle(app)
    path = tmp_path / "session.json"
    with WireClient(app.server.get_port()) as page:
        path.write_bytes(taken(page, "Session (JSON)"))
    saved, notes = opening(load_session(path), folder)
    assert notes == ()
    with idle_app(folder, saved=saved) as again:
        before, now = app.state.now, again.state.now
        assert str(now.session.history) == str(before.session.history)
        assert now.session.effects == before.session.effects
        assert (now.pose, now.arrows, now.factor) == (7, 300.0, before.factor)
        assert again.stage.view_name == "Corner"
        assert now.session.screening is not None
        with WireClient(again.server.get_port()) as page:
            assert HIDDEN in page.text()


@pytest.mark.thorough
@pytest.mark.browser
def test_a_browser_downloads_the_session(chromium: Any, app: App, tmp_path: Path) -> None:
    with open_page(chromium, url_of(app.server), 1000, 700, dpr=1) as page:
        page.set_default_timeout(120_000)
        page.get_by_role("tab", name="Take away").click()
        with page.expect_download() as download:
            page.get_by_role("button", name="Session (JSON)").click()
        download.value.save_as(tmp_path / "session.json")
        assert download.value.suggested_filename.endswith("session.json")
        assert load_session(tmp_path / "session.json").shown.view is not None


def test_a_urdf_comes_back_as_a_urdf(tmp_path: Path) -> None:
    urdf, log = tmp_path / "my_arm.urdf", tmp_path / "log.csv"
    save_robot(builtin_robot("rb5"), urdf)
    made = simulate_dataset(load_robot(urdf), rng=2, poses=40, noise_mm=0.02).dataset
    rows = np.hstack([made.poses.q, 1e-3 * made.points.xyz_mm])
    np.savetxt(log, rows, delimiter=",", header="q1,q2,q3,q4,q5,q6,x,y,z", comments="")
    printed("import", tmp_path / "cell", "--robot", urdf, "--joints", log)
    with idle_app(tmp_path / "cell") as app, WireClient(app.server.get_port()) as page:
        page.click(OWN_FILE)
        page.wait(lambda p: p.downloads, 30.0)
        (name, content), *_ = page.downloads.items()
    assert name == "cell_calibrated.urdf"
    out = tmp_path / "calibrated.urdf"
    out.write_bytes(content)
    before, after = load_robot(urdf), load_robot(out)
    assert [joint.name for joint in after.joints] == [joint.name for joint in before.joints]
    assert b"origins calibrated by" in content
    assert any(a != b for a, b in zip(after.joints, before.joints, strict=True))
