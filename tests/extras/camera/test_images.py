"""Tab Scans where a camera measured: the photograph, its corners, and arrows of the reprojection by the model."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calib import calibrate, load_dataset, write_dataset
from calib.calibration.model_versions import LINKS, NOMINAL
from calib.extras.camera.board import board_of
from calib.extras.camera.observed import camera_of, image_path
from calib.extras.camera.reprojection import reprojected_views
from calib.present.fit.calibration import camera_sections
from inspector.figures import reprojection, to_svg
from tests.extras.camera.camera_dataset import simulated_dataset
from tests.support.app import IDLE_S
from tests.support.camera_scene import SIZE_PX, Scene

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Dataset of a camera on the flange; the images of all poses but p2 are in its folder."""
    rng = np.random.default_rng(6)
    scene = Scene.draw(rng, on_flange=True, poses=16, link_mm=0.5, link_deg=0.05)
    made, kept = tmp_path_factory.mktemp("made"), tmp_path_factory.mktemp("kept") / "cell"
    dataset = simulated_dataset(scene, board_of("charuco:8x6:30:22"), rng, sigma_px=0.1)
    (made / "images").mkdir()
    for name in dataset.poses.ids:
        if name != "p2":
            Image.new("L", SIZE_PX, 90).save(made / "images" / f"{name}.png")
    write_dataset(
        replace(dataset, folder=made, attachments={"camera": replace(camera_of(dataset), images="images")}), kept
    )
    return kept


def _images(figure) -> list:
    return list(figure.to_dict()["layout"].get("images", ()))


def _lines(figure) -> list:
    return [trace for trace in figure.to_dict()["data"] if trace["mode"] == "lines"]


def test_a_copied_dataset_keeps_its_images(folder):
    dataset = load_dataset(folder)
    assert image_path(dataset, 0) == folder / "images" / "p1.png"
    assert image_path(dataset, 1) is None


@pytest.mark.thorough
def test_the_image_is_shown_with_arrows_of_the_model_on_show(app):
    def seen(pose: int):
        app.select(pose)
        assert app.worker.wait_idle(IDLE_S)
        return app.panels.scans._image, app.panels.scans._scan.content

    def show(version: str) -> None:
        app.version(version)
        assert app.worker.wait_idle(IDLE_S)

    image, facts = seen(0)
    assert image.visible
    assert "p1.png" in facts
    calibration = app.state.session.calibration
    assert calibration.residual == "pose"
    fitted = {one.view.pose: one for one in reprojected_views(calibration)}
    assert f"{fitted['p1'].rms_px:.3f} pixels" in facts
    assert f"{fitted['p7'].rms_px:.3f}" in app.panels.scans._all.content
    (photograph,) = _images(image.figure)
    assert photograph["source"].startswith("data:image/jpeg;base64,")
    (arrows,) = _lines(image.figure)
    factor = float(arrows["name"].rpartition(" ")[2])
    tail = np.array([arrows["x"][0], arrows["y"][0]])
    assert (fitted["p1"].view.pixels[0] - tail) / factor == pytest.approx(fitted["p1"].error_px[0])
    show(NOMINAL)
    assert not _lines(image.figure)
    assert _images(image.figure)
    show(LINKS)
    assert _lines(image.figure)
    image, facts = seen(1)
    assert image.visible
    assert not _images(image.figure)
    assert "not kept" in facts


def test_a_saved_figure_has_the_photograph_too(app):
    calibration = app.state.session.calibration
    assert to_svg(reprojection(calibration, "p3")).count("<image ") == 1
    assert to_svg(reprojection(calibration, "p2")).count("<image ") == 0


def test_a_diagnosis_tells_where_the_camera_is(app):
    calibration = app.state.session.calibration
    (section,) = camera_sections(calibration)
    facts, figure = section.blocks
    told = dict(facts.pairs)
    assert "camera on the flange" in told
    assert "pixels at the fitted poses" in told["reprojection"]
    assert figure.figure == "reprojection"
    assert camera_sections(calibrate(calibration.dataset, residual="position")) == []


def test_a_saved_photograph_has_its_own_proportions(app):
    (place,) = re.findall(
        r'<image [^>]*width="([\d.]+)" height="([\d.]+)"', to_svg(reprojection(app.state.session.calibration, "p3"))
    )
    assert float(place[0]) / float(place[1]) == pytest.approx(SIZE_PX[0] / SIZE_PX[1], rel=0.01)
