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
from inspector.markup.parts.palette import MODEL_COLOURS, rgb
from inspector.scene.scene_view import ROOT
from inspector.session.view import WORST
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
    assert running.worker.wait_idle(IDLE_S)
    return running


def version(app: App, name: str) -> Version:
    return next(v for v in app.state.now.versions if v.name == name)


def array(page: WireClient, node: str, prop: str, *shape: int) -> np.ndarray:
    return np.asarray(page.scene[f"{ROOT}/{node}"]["props"][prop]).reshape(-1, *shape)


def test_key_figures_are_those_of_each_version_with_the_noise(app: App, page: WireClient) -> None:
    app.add_effect("transmission_error")
    idle(app)
    page.wait(lambda p: p.value("Model shown") == EFFECTS)
    for name in (NOMINAL, LINKS, EFFECTS):
        for figures in (version(app, name).evaluation.train, version(app, name).evaluation.test):
            row = f"{numbers.column_mm(figures.rmse_mm)} {numbers.column_mm(figures.max_mm)}"
            assert row in " ".join(plain(page).split())
        error = version(app, name).pose_error_vectors_mm()[0]
        assert " ".join(numbers.signed(float(e), "+.4f") for e in error) in " ".join(plain(page).split())
    assert "noise alone" in plain(page)


def test_arrows_predicted_points_and_colours_of_the_version_on_show(app: App, page: WireClient) -> None:
    page.set("Model shown", NOMINAL)
    page.set("Residuals ×", "30")
    measured, error = app.state.now.session.dataset.points, version(app, NOMINAL).evaluation.error_mm
    tips, length_mm = measured.xyz_mm + 30.0 * error, np.linalg.norm(error, axis=1)
    page.wait(lambda p: np.allclose(1000 * array(p, "predicted/0", "points", 3), tips, atol=1e-3))
    page.wait(lambda p: f"arrows × 30, longest {numbers.length(length_mm.max())}: " in plain(p))
    arrows = 1000 * array(page, "residuals/arrows", "points", 2, 3)
    worst = np.union1d(np.argsort(-length_mm, kind="stable")[:WORST], [0])  # and the selected
    np.testing.assert_allclose(arrows[:, 0], measured.xyz_mm[worst], atol=1e-3)
    np.testing.assert_allclose(arrows[:, 1], tips[worst], atol=1e-3)
    assert (array(page, "residuals/arrows", "colors", 3) == rgb(MODEL_COLOURS[NOMINAL])).all()
    limit = error_limit_mm(app.state.now)
    assert limit / 2.51 <= np.percentile(length_mm, 90) <= limit  # one for all versions
    assert f"{limit:g} mm" in plain(page)
    drawn = array(page, "predicted/0", "colors", 3).astype(int)
    assert (np.diff(drawn[np.argsort(length_mm)][:, 2]) <= 0).all()  # from blue to orange, blue falls all the way


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
