"""Tab Compare without a browser: what is drawn and said is what the library says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.calibration.model_versions import EFFECTS, LINKS, NOMINAL, Version
from calib.corners.jig_distance import face_distances
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.rendering import numbers
from calib.scans.scan import load_scan
from inspector.app.app import App
from inspector.markup.legend import distance_limit_mm, error_limit_mm
from inspector.markup.parts.palette import MODEL_COLOURS, ROLE_COLOURS, rgb
from inspector.scene.scene_view import ROOT
from inspector.session.view import BY_ERROR, BY_ROLE, WORST
from tests.support.app import IDLE_S, idle, plain
from tests.support.hidden_dataset import write_hidden
from tests.support.tiny_dataset import BROKEN, box_stl, write_tiny
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The datasets "cell" (scans), "hidden" (an effect), "points", and "meshed" (a link with a mesh)."""
    folder = write_tiny(tmp_path_factory.mktemp("datasets"))
    hidden = load_dataset(write_hidden(folder))
    joints = list(hidden.robot.joints)
    joints[1] = replace(joints[1], mesh="link2.stl")
    joints[2] = replace(joints[2], mesh="<b>gone</b>.stl")
    meshed = replace(hidden, name="meshed", robot=replace(hidden.robot, joints=tuple(joints)))
    write_dataset(meshed, folder / "meshed")
    (folder / "meshed" / "link2.stl").write_text(box_stl((0.0, 0.0, 0.0)))
    return folder


@pytest.fixture
def app(running: App) -> App:
    """The app on the dataset with a hidden effect, the effect not in the model, at the first pose."""
    running.open("hidden")
    running.show_view("Arm")
    assert running.worker.wait_idle(IDLE_S)
    running.remove_effect("transmission_error")
    running.version(LINKS)
    running.arrows(100.0)
    running.colouring(BY_ROLE)
    for name in (NOMINAL, LINKS, EFFECTS):
        running.prediction(name, name == LINKS)
    assert running.worker.wait_idle(IDLE_S)
    return running


def version(app: App, name: str) -> Version:
    return next(v for v in app.state.now.versions if v.name == name)


def array(page: WireClient, node: str, prop: str, *shape: int) -> np.ndarray:
    return np.asarray(page.scene[f"{ROOT}/{node}"]["props"][prop]).reshape(-1, *shape)


def test_key_figures_are_those_of_each_version_with_the_noise(app: App, page: WireClient) -> None:
    app.add_effect("transmission_error")
    idle(app)
    page.wait(lambda p: f"p01, {EFFECTS}" in p.scene[f"{ROOT}/arm/label"]["props"]["text"])
    for name in (NOMINAL, LINKS, EFFECTS):
        for figures in (version(app, name).evaluation.train, version(app, name).evaluation.test):
            row = f"{numbers.column_mm(figures.rmse_mm)} {numbers.column_mm(figures.max_mm)}"
            assert row in " ".join(plain(page).split())
        error = version(app, name).pose_error_vectors_mm()[0]
        assert " ".join(numbers.signed(float(e), "+.4f") for e in error) in " ".join(plain(page).split())
    assert "noise alone" in plain(page)
    assert page.value("Model shown") == EFFECTS
    assert page.value(EFFECTS) is True  # the newest version took the place of the one before
    assert page.value(LINKS) is False


def test_arrows_and_predicted_points_of_each_ticked_version(app: App, page: WireClient) -> None:
    page.set(NOMINAL, True)
    page.wait(lambda p: f"{ROOT}/predicted/1" in p.scene)
    page.set("Residuals ×", "30")
    page.wait(lambda p: "residuals × 30, longest: nominal" in p.scene[f"{ROOT}/residuals/label"]["props"]["text"])
    page.wait(lambda p: "drawn 30 times farther" in plain(p))
    measured = app.state.now.session.dataset.points
    arrows = 1000 * array(page, "residuals/arrows", "points", 2, 3)
    colours = array(page, "residuals/arrows", "colors", 3).reshape(len(arrows), -1, 3)[:, 0]
    for number, name in enumerate((NOMINAL, LINKS)):
        error = version(app, name).evaluation.error_mm
        tips = measured.xyz_mm + 30.0 * error
        np.testing.assert_allclose(1000 * array(page, f"predicted/{number}", "points", 3), tips, atol=1e-3)
        own = arrows[(colours == rgb(MODEL_COLOURS[name])).all(axis=1)]
        worst = np.union1d(np.argsort(-np.linalg.norm(error, axis=1), kind="stable")[:WORST], [0])  # and the selected
        np.testing.assert_allclose(own[:, 0], measured.xyz_mm[worst], atol=1e-3)
        np.testing.assert_allclose(own[:, 1], tips[worst], atol=1e-3)
    page.set(NOMINAL, False)
    page.set(LINKS, False)
    page.wait(lambda p: not [n for n in p.scene if n.startswith(f"{ROOT}/residuals/")])


def test_measured_points_by_role_or_by_error_with_a_scale(app: App, page: WireClient) -> None:
    roles = app.state.now.session.dataset.poses.role
    expected = np.array([rgb(ROLE_COLOURS[str(r)]) for r in roles])
    np.testing.assert_array_equal(array(page, "corners/points", "colors", 3), expected)
    page.set("Measured points", BY_ERROR)
    page.wait(lambda p: f"3D error: {LINKS}" in plain(p))
    idle(app)
    limit = error_limit_mm(app.state.now)
    errors = version(app, LINKS).pose_errors_mm()
    assert limit / 2.51 <= np.percentile(version(app, NOMINAL).pose_errors_mm(), 90) <= limit  # one for all versions
    page.wait(lambda p: f"{limit:g} mm" in plain(p))
    page.wait(lambda p: not np.array_equal(array(p, "corners/points", "colors", 3), expected))
    drawn = array(page, "corners/points", "colors", 3).astype(int)
    order = np.argsort(errors)  # from blue to orange, blue falls all the way
    assert (np.diff(drawn[order][:, 2]) <= 0).all()
    page.set("Model shown", NOMINAL)
    page.wait(lambda p: f"3D error: {NOMINAL}" in plain(p))


def test_the_jig_lies_over_the_scan_coloured_by_distance(app: App, page: WireClient) -> None:
    app.open("cell")
    idle(app)
    app.show_view("Distance")
    idle(app)
    dataset, search = app.state.now.session.dataset, app.state.now.search
    assert search.corner is not None
    path = dataset.scan_path(0)
    assert path is not None
    scan = load_scan(path)
    distance, _ = face_distances(scan.points_mm, search.corner, dataset.jig)
    known = distance[np.isfinite(distance)]
    assert np.abs(known).max() < 3.0
    page.wait(lambda p: f"{len(known):,} of {len(distance):,}" in plain(p))
    page.wait(lambda p: f"{ROOT}/distance/points" in p.scene)
    assert len(array(page, "distance/points", "points", 3)) == len(known)
    assert f"+{distance_limit_mm(distance):g} mm" in plain(page)
    assert {n for n in page.scene if n.startswith(f"{ROOT}/jig/")} == {
        *(f"{ROOT}/jig/face{i}" for i in range(3)), f"{ROOT}/jig/outline",
    }  # fmt: skip
    page.wait(lambda p: p.scene[f"{ROOT}/jig"]["visible"] and not p.scene[f"{ROOT}/arm"]["visible"])
    app.select(BROKEN)
    idle(app)
    page.wait(lambda p: "no place for the jig's model" in plain(p))
    page.wait(lambda p: not [n for n in p.scene if n.startswith((f"{ROOT}/jig/", f"{ROOT}/distance/"))])
