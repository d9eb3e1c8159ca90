"""The 3D view as a page of its own: it draws arm and arrows in a browser, without a server and without a network."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import pytest

from calib import calibrate, diagnose
from calib.dataset.files.folder import load_dataset
from inspector.scene.scene_page import Scene3d, scene_3d
from inspector.scene.scene_view import ROOT
from tests.support.browser import MS
from tests.support.hidden_dataset import write_hidden


@pytest.mark.thorough
def test_the_page_of_a_scene_draws_arm_and_arrows_alone(chromium: Any, tmp_path: Path) -> None:
    found = diagnose(load_dataset(write_hidden(tmp_path / "hidden")))
    path = tmp_path / "scene.html"
    path.write_text(scene_3d(found).page, encoding="utf-8")
    page = chromium.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{path.as_uri()}?fixedDpr=0.25")
    for name in ("residuals/arrows", "before/lines", "arm/cylinders", "corners/points"):
        node = f"{ROOT}/{name}"
        page.wait_for_function("name => window.__viserMutable?.nodeRefFromName?.[name] != null", arg=node, timeout=MS)
    assert not [url for url in asked if not url.startswith(("file:", "data:", "blob:"))]
    page.close()


def test_a_calibration_is_framed_for_a_notebook(tmp_path: Path) -> None:
    scene = scene_3d(calibrate(load_dataset(write_hidden(tmp_path / "hidden"))))
    assert html.escape(scene.page, quote=True) in scene._repr_html_()
    assert 'sandbox="allow-scripts"' in Scene3d("<b>").frame
    assert "<b>" not in Scene3d("<b>").frame
    assert len(repr(scene)) < 60
