"""What the page says of each scan's search: which filter rejected a set, doubts, looks, and what the colours mean."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from calib.corners.search import CornerSearch
from calib.rendering.blocks import plain as words
from calib.scans.scan import Scan, load_scan, write_scan
from inspector.app.app import App
from inspector.markup.legend import EMPTY, legend_html
from inspector.panels.measure.corner import corner_html
from inspector.panels.measure.planes import NOT_SEARCHED, how_html, planes_html
from inspector.panels.measure.scans import corner_state
from inspector.report.report import report_html
from inspector.session.view import VIEW_LAYERS, VIEWS, View
from tests.support.app import idle, shows
from tests.support.tiny_dataset import BROKEN, POSES, write_tiny
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running

NOISY, FEW = 6, 8  # poses whose scans are spoilt below


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_tiny(tmp_path_factory.mktemp("datasets")) / "cell"
    scans = sorted((folder / "scans").glob("*.ply"))
    _spoil(scans[NOISY], lambda points: points + np.random.default_rng(0).normal(0.0, 0.2, points.shape))
    _spoil(scans[FEW], lambda points: points[:40])
    return folder


def _spoil(path: Path, spoil) -> None:  # type: ignore[no-untyped-def]
    write_scan(path, Scan(path.stem, spoil(load_scan(path).points_mm)))


@pytest.fixture
def page(app: App) -> Iterator[WireClient]:
    app.select(0)
    app.show_view("All scans")
    idle(app)
    with WireClient(app.server.get_port()) as client:
        yield client


def view(app: App, pose: int = 0) -> View:
    return replace(app.state.now, pose=pose)


def search(app: App, pose: int) -> CornerSearch:
    found = view(app, pose).search
    assert found is not None
    return found


def test_a_scan_that_was_not_searched_for_planes_has_no_tables_of_zeros(app: App) -> None:
    assert "40 points" in search(app, FEW).failure
    said = planes_html(view(app, FEW))
    assert NOT_SEARCHED in said
    assert "<table" not in said
    assert "<table" in how_html(view(app, BROKEN))  # which was searched, in vain


def test_doubts_are_told_in_the_list_beside_the_pose_and_in_the_progress(app: App, page: WireClient) -> None:
    corner = search(app, NOISY).corner
    doubts = corner.quality.doubts()
    assert doubts
    assert f"{len(doubts)} doubt" in words(corner_state(view(app), NOISY))
    assert "failed" in words(corner_state(view(app), FEW))
    states = [words(corner_state(view(app), i)) for i in range(POSES)]
    assert states.count("found") >= POSES - 5
    doubtful = sum("doubt" in state for state in states)
    ids = view(app).session.dataset.poses.ids
    shows(page, f"{POSES - 2} of {POSES} corners found", f"2 failed ({ids[BROKEN]}, {ids[FEW]})")
    shows(page, f"{doubtful} with doubts ({ids[NOISY]}")
    told = corner_html(view(app, NOISY))
    assert told.index(doubts[0][:30]) < told.index("scanner frame")  # before the figures
    app.select(NOISY)
    shows(page, f"found, {len(doubts)} doubt", doubts[0])


@pytest.mark.parametrize("look", VIEWS)
def test_the_legend_tells_what_the_colours_of_each_view_mean(app: App, page: WireClient, look: str) -> None:
    said = {
        "All scans": ("training", "face 1"),
        "Scan": ("face 1", "this corner"),
        "Planes": ("face 1", "plane group not chosen", "sets rejected by filter"),
        "Corner": ("face 3", "this corner"),
        "All corners": ("training", "arrows ×"),
        "Distance": ("Distance to the nearest chosen face", "face 2"),
        "Arm": ("training", "arrows ×", "selected pose"),
    }
    app.show_view(look)
    idle(app)
    visible, off_mm = VIEW_LAYERS[look], app.stage.distances_mm
    said_now = legend_html(view(app), visible, off_mm, app.stage.residuals.words)
    for part in said[look]:
        assert part in said_now
    page.wait(lambda p: said_now in p.text())


def test_the_legend_leaves_out_what_is_not_there(app: App) -> None:
    assert EMPTY in legend_html(view(app), set(), None)
    nothing = legend_html(view(app, FEW), VIEW_LAYERS["Planes"] | VIEW_LAYERS["Distance"] | {"corner"}, None)
    assert nothing == ""
    arm = legend_html(view(app), VIEW_LAYERS["Arm"], None)
    assert "test" in arm
    now = view(app)
    poses = replace(now.session.dataset.poses, role=np.full_like(now.session.dataset.poses.role, "train"))
    trained = replace(now, session=replace(now.session, dataset=replace(now.session.dataset, poses=poses)))
    assert "reference" not in legend_html(trained, VIEW_LAYERS["Arm"], None)
    unfitted = replace(now, session=replace(now.session, versions=()))
    assert "arrows" not in legend_html(unfitted, VIEW_LAYERS["Arm"], None)


def test_the_corner_says_what_its_sigma_comes_from(app: App, page: WireClient) -> None:
    corner = search(app, 0).corner
    shows(page, f"{corner.quality.margin_mm:.2f} mm", f"{corner.quality.amplification:.1f} times that of the faces")


def test_the_report_tells_which_scans_have_no_corner_and_which_corners_have_doubts(app: App) -> None:
    page = html.unescape(report_html(app.state.now.session, now=datetime(2024, 5, 1, tzinfo=UTC)))
    ids = app.state.now.session.dataset.poses.ids
    corner = search(app, NOISY).corner
    assert f"is left out: {search(app, FEW).failure}" in page
    assert f"{ids[NOISY]} is doubtful: {corner.quality.doubts()[0]}" in page
    assert "Ringed" not in page  # no pose is selected on paper
    assert "Seen by" in page
