"""The whole app without a browser: what a page is sent, what its widgets do, and that all places agree."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.errors import DatasetError
from calib.rendering.numbers import parameter_label
from inspector.app.app import App
from inspector.app.page.dataset_list import names_of
from inspector.app.page.tabs import STEPS
from inspector.app.serving import serving
from inspector.scene.scene_view import OVERVIEW_POINTS, ROOT
from inspector.session import measuring
from inspector.session.session import Session
from tests.support.app import IDLE_S, idle, idle_app, plain, shows
from tests.support.tiny_dataset import POSES, write_tiny
from tests.support.wire_client import WireClient

SEARCH_S = 0.12  # a scan's, beyond what it takes: a page draws some thirty times a second

pytestmark = pytest.mark.slow  # a whole app, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("datasets"))


@pytest.fixture
def app(running: App) -> App:
    """The app on the dataset with scans, all of them searched, at its first pose."""
    running.open("cell")
    running.show_view("All scans")
    assert running.worker.wait_idle(IDLE_S)
    return running


def session(app: App) -> Session:
    return app.state.view.session


def figure(page: WireClient, kind: str) -> list[dict[str, object]]:
    """The traces of the figure whose traces are of this kind."""
    drawn = [json.loads(f).get("data", []) for f in page.figures() if f]
    return next(traces for traces in drawn if traces and traces[-1]["type"] == kind)


def drawn_figures(page: WireClient) -> list[str]:
    """The figures that have something in them."""
    return [f for f in page.figures() if json.loads(f or "{}").get("data")]


# ---- opening --------------------------------------------------------------------------------------------------------


def test_a_folder_of_datasets_opens_at_the_first_and_works_through_it(app: App, page: WireClient) -> None:
    assert set(page.tabs()) == {"Review", *STEPS, *(name for inside in STEPS.values() for name in inside)}
    assert list(STEPS) == [name for name in page.tabs() if name in STEPS]
    assert page.props("Dataset")["options"] == ["cell", "points"]
    assert len(session(app).searches) == POSES
    shows(page, f"{POSES - 1} of {POSES} corners found", "1 failed")
    assert session(app).redundancy is not None
    assert session(app).calibration is not None
    assert len(drawn_figures(page)) >= 5


def test_a_single_dataset_opens_too_and_a_wrong_path_is_one_clear_error(folder: Path, tmp_path: Path) -> None:
    with idle_app(folder / "points") as app:
        assert session(app).calibration is not None
    for wrong in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(DatasetError), serving(wrong, port=0):
            pass


@pytest.fixture
def slow_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches as long as those of large scans, so that a page sees each of them go by."""
    read = measuring.read_scan

    def slow(*arguments: Any, search: bool) -> object:
        time.sleep(SEARCH_S)
        return read(*arguments, search=search)

    monkeypatch.setattr(measuring, "read_scan", slow)


@pytest.mark.thorough
@pytest.mark.usefixtures("slow_searches")
def test_the_search_can_be_stopped_and_goes_on_where_it_was(folder: Path) -> None:
    with serving(folder, port=0) as app, WireClient(app.server.get_port()) as page:
        page.wait(lambda p: "Searching corners: 2" in plain(p), 30)
        page.click("Stop the search")
        page.wait(lambda p: "Stopped:" in plain(p))
        idle(app)
        stopped_at = dict(session(app).searches)
        assert 0 < len(stopped_at) < POSES
        assert session(app).calibration is None
        page.wait(lambda p: p.has("Go on searching"))
        page.click("Go on searching")
        page.wait(lambda p: f"of {POSES} corners found" in plain(p), 30)
        idle(app)
        # Every further scan tells of the jig's angles, and so of each corner: what was searched stays.
        assert all(session(app).searches[pose].sets is search.sets for pose, search in stopped_at.items())
        assert session(app).calibration is not None


# ---- one selection everywhere ---------------------------------------------------------------------------------------


def test_fifty_quick_presses_end_at_the_last_pose_and_stay_there(app: App, page: WireClient) -> None:
    for _ in range(50):
        page.trigger("Next pose")
    shows(page, f"{POSES} of {POSES}")
    page.trigger("Previous pose")
    shows(page, f"{POSES - 1} of {POSES}")


# ---- the scene ------------------------------------------------------------------------------------------------------


def _points(message: dict[str, object]) -> np.ndarray:
    return np.asarray(message["props"]["points"]).reshape(-1, 3)  # type: ignore[index]


def test_the_selected_scan_is_drawn_in_full_and_exact_and_the_others_lightly(app: App, page: WireClient) -> None:
    from calib.scans.scan import load_scan

    path = session(app).dataset.scan_path(0)
    assert path is not None
    scan = load_scan(path).points_mm
    drawn = [page.scene[f"{ROOT}/{name}/points"] for name in ("scan", "faces")]
    assert all(m["props"]["precision"] == "float32" for m in drawn)
    got = np.concatenate([_points(m) for m in drawn])
    assert len(got) == len(scan)
    order_got, order = np.lexsort(got.T), np.lexsort((scan / 1000).T.astype(np.float32))
    np.testing.assert_allclose(got[order_got] * 1000, scan[order], atol=1e-3)
    overview = {n: m for n, m in page.scene.items() if n.startswith(f"{ROOT}/overview/")}
    assert len(overview) == POSES
    assert not overview[f"{ROOT}/overview/0"]["visible"]  # it is drawn in full
    assert all(overview[f"{ROOT}/overview/{i}"]["visible"] for i in range(1, POSES))
    assert sum(len(_points(m)) for m in overview.values()) <= OVERVIEW_POINTS * POSES


def test_the_faces_on_show_are_the_inliers_of_the_search(app: App, page: WireClient) -> None:
    corner = session(app).searches[session(app).dataset.poses.ids[0]].corner
    faces = page.scene[f"{ROOT}/faces/points"]["props"]
    colours = np.asarray(faces["colors"]).reshape(-1, 3)
    assert sorted(np.unique(colours, axis=0, return_counts=True)[1]) == sorted(f.points for f in corner.faces)


def test_views_choose_layers_and_layers_can_be_switched(app: App, page: WireClient) -> None:
    def visible(name: str) -> bool:
        return bool(page.scene[f"{ROOT}/{name}"]["visible"])

    page.wait(lambda p: visible("overview") and not visible("sets"))
    page.set("3D view", "Planes")
    page.wait(lambda p: visible("sets") and visible("groups") and not visible("overview"))
    page.wait(lambda p: p.value("Sets passed") is True and p.value("All scans") is False)
    page.wait(lambda p: f"{ROOT}/sets/lines" in p.scene and f"{ROOT}/groups/discs" in p.scene)
    page.set("Sets passed", False)
    page.wait(lambda p: not visible("sets"))
    page.trigger("Look at: Corner")
    page.wait(lambda p: visible("corner") and not visible("groups"))


# ---- the tabs say what was found ------------------------------------------------------------------------------------


def test_the_exaggeration_changes_picture_and_words(app: App, page: WireClient) -> None:
    def scales(page: WireClient) -> np.ndarray:
        return np.asarray(page.scene[f"{ROOT}/corner/ellipsoid"]["props"]["batched_scales"]).ravel()

    expected = scales(page) * 30 / float(page.value("Ellipsoids ×"))
    page.set("Ellipsoids ×", "30")
    shows(page, "1σ × 30")
    page.wait(lambda p: np.allclose(scales(p), expected, rtol=1e-5))


def test_redundancy_tab_shows_all_pairs_and_names_groups(app: App, page: WireClient) -> None:
    analysis = session(app).redundancy
    page.wait(lambda p: len(figure(p, "heatmap")[-1]["x"]) == len(analysis.units))
    for group in analysis.groups:
        assert parameter_label(group[-1]) + " are indistinguishable: only " in plain(page)
    assert "a6 and aTCP are indistinguishable: only a6 + aTCP can be known; keep a6." in plain(page)
    page.set("Measured", "distance")
    page.wait(lambda p: session(app).redundancy is not analysis)
    other = session(app).redundancy
    assert other.rank < analysis.rank  # d1 and theta1 are invisible to distances
    shows(page, "d1, θ1, β1")
    page.set("Measured", "position")
    page.wait(lambda p: session(app).redundancy is not other)


# ---- other datasets, hostile names, errors --------------------------------------------------------------------


def test_switching_datasets_and_back_searches_nothing_again(app: App, page: WireClient) -> None:
    searches = session(app).searches
    page.set("Dataset", "points")
    page.wait(lambda _: session(app).dataset.points is not None)
    idle(app)
    page.wait(lambda p: not [n for n in p.scene if n.startswith(f"{ROOT}/overview/")])
    page.wait(lambda p: f"{ROOT}/corners/dots" in p.scene)
    page.set("Dataset", "cell")
    shows(page, f"{POSES - 1} of {POSES} corners found, 1 failed")  # in no time
    idle(app)
    assert session(app).searches is searches


def test_a_dataset_that_cannot_be_read_is_told_and_the_old_one_stays(folder: Path, app: App, page: WireClient) -> None:
    app._folders["gone"] = folder / "gone"
    app.open("gone")
    page.wait(lambda p: p.notifications)
    assert "gone" in page.notifications[-1]["props"]["body"]
    shows(page, page.notifications[-1]["props"]["body"])
    idle(app)
    assert session(app).dataset.name == "cell"
    page.trigger("Next pose")
    shows(page, f"2 of {POSES}")


def test_where_no_dataset_can_be_opened_the_page_says_so(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "points", tmp_path / "only")
    (tmp_path / "only" / "poses.csv").write_text("pose,role\n")
    with idle_app(tmp_path) as app, WireClient(app.server.get_port()) as page:
        shows(page, "poses.csv", "No dataset is open")


def test_our_own_bug_is_told_too(app: App, page: WireClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(app.dataset, "select", broken)
    page.trigger("Next pose")
    page.wait(lambda p: p.notifications)
    assert "ZeroDivisionError: oops" in page.notifications[-1]["props"]["body"]
    monkeypatch.undo()
    page.trigger("Previous pose")
    shows(page, f"1 of {POSES}")


def test_requests_that_no_widget_makes_are_ignored(app: App) -> None:
    before = app.state.view
    app.open("no such dataset")
    app.show_view("nowhere")
    app.layer("no such layer", True)
    app.redundancy("no such residual")
    app.calibrate("no such residual")
    app.version("no such version")
    app.select(10**9)
    app.select(-(10**9))
    idle(app)
    assert app.state.view.session is before.session
    assert app.state.view.pose == 0


def test_garbage_for_every_widget_changes_nothing(app: App, page: WireClient) -> None:
    before = app.state.view
    garbage: list[object] = [
        None,
        -1e300,
        10**9,
        float("nan"),
        "no such option",
        "x" * 10_000,
        [],
        {},
        [1, 2, 3],
    ]
    for uuid in list(page.gui):
        for value in garbage:
            page.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
        for field in ("removed", "update_cb", "sync_cb", "props", "gui_api", "uuid"):
            page.send(type="GuiUpdateMessage", uuid=uuid, updates={field: None})
    page.trigger("Next pose")
    shows(page, f"2 of {POSES}")
    idle(app)
    assert app.state.view.session is before.session
    assert not page.notifications


def test_names_of_datasets_tell_them_apart(tmp_path: Path) -> None:
    one, two, same = tmp_path / "a" / "cell", tmp_path / "b" / "other", tmp_path / "c" / "cell"
    assert names_of([one, two]) == ["cell", "other"]
    names = names_of([one, two, same])
    assert len(set(names)) == 3
    assert names[1] == "other"
