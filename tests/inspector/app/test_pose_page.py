"""Full poses on the page: names of the jig's faces from its scans, worked out aside, once; or why there are none."""

from __future__ import annotations

import io
import json
import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib import calibrate
from calib.dataset.dataset import Orientations
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.effect_selection import GEOMETRY
from calib.errors import FitError
from calib.measurement.face_labels import FaceLabels
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions
from calib.present.fit.corners import face_labelling
from calib.rendering import numbers
from calib.simulation.measured_dataset import write_simulation
from calib.simulation.simulate import simulate_dataset
from inspector.app.app import App
from inspector.app.serving import serving
from inspector.cli.parser import main
from inspector.export.csv_and_png import corners_csv
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.reopening import opening, reopened
from inspector.session.session import Session
from inspector.session.session_file import load_session, save_session
from tests.support.app import IDLE_S, idle_app, shows
from tests.support.tiny_dataset import scanned_cell
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running

POSES = 14


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`cell` has scans; `contradicted` the same ones with joint 6 turning the wrong way; `points` places only."""
    folder = tmp_path_factory.mktemp("datasets")
    made = scanned_cell(POSES)
    write_simulation(made, folder / "cell", truth_path=folder / "truth.json")
    shutil.copytree(folder / "cell", folder / "contradicted")
    poses = pd.read_csv(folder / "cell" / "poses.csv")
    poses["q6_deg"] *= -1.0  # the corner lies on joint 6's axis: places stay, attitudes do not
    poses.to_csv(folder / "contradicted" / "poses.csv", index=False)
    toml = folder / "contradicted" / "dataset.toml"
    toml.write_text(toml.read_text().replace('"cell"', '"contradicted"'))
    measured = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(3), poses=20, name="points")
    write_dataset(measured.dataset, folder / "points")
    return folder


@pytest.fixture
def app(folder: Path) -> Iterator[App]:
    with idle_app(folder / "cell") as app:
        yield app


def session(app: App) -> Session:
    assert app.state.view is not None
    return app.state.view.session


def fit(page: WireClient, residual: str) -> None:
    page.set("Fit", residual)
    page.wait(lambda p: not p.props("Calibrate")["disabled"])  # where it would change something
    page.click("Calibrate")


class Gate:
    """Naming that counts its calls and waits until it may go on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls = 0
        self.begun = threading.Event()
        self.open, self._name = threading.Event(), measuring.find_face_labels
        monkeypatch.setattr(measuring, "find_face_labels", self)

    def __call__(self, session: Session) -> FaceLabels:
        self.calls += 1
        self.begun.set()
        assert self.open.wait(IDLE_S)
        return self._name(session)


# ---- full poses from scans ------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_scans_are_fitted_as_full_poses_as_the_command_fits_them(
    app: App, page: WireClient, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shows(page, f"nominal robot at {POSES} poses, margin 1")
    plain_points = session(app).measured.points
    assert plain_points is not None
    assert plain_points.orientations is None  # a fit of positions takes no more than it did
    fit(page, "pose")
    shows(page, "pose, ", "attitude of the jig")
    assert app.worker.wait_idle(IDLE_S)
    ours = session(app).calibration
    assert ours is not None
    assert main(["calibrate", str(folder / "cell"), "--residual", "pose", "--json"]) == 0
    theirs = json.loads(capsys.readouterr().out)
    assert ours.face_labelling is not None
    assert theirs["faces_named"] == face_labelling(ours.face_labelling)
    np.testing.assert_allclose(ours.to_frame()["value"], [p["value"] for p in theirs["parameters"]], atol=1e-9)
    for role in ("train", "test"):
        before, after = (theirs["attitudes"][when][role]["rmse_rad"] for when in ("before", "after"))
        assert after < before
        shows(page, f"{1e3 * before:.4f}", f"{1e3 * after:.4f}", numbers.reduction(before, after))
    assert [step.calibration.residual for step in session(app).steps] == ["pose"]
    assert session(app).history[-1].label == GEOMETRY

    page.click("Measured points (CSV)")
    page.wait(lambda p: p.downloads, 30.0)
    (content,) = page.downloads.values()
    searches = session(app).searches
    full = with_corners(load_dataset(folder / "cell"), searches, orientation=True)  # as `corners --orientation` does
    pd.testing.assert_frame_equal(pd.read_csv(io.BytesIO(content)), pd.read_csv(io.StringIO(corners_csv(full))))


@pytest.mark.thorough
def test_an_effect_and_the_way_back_keep_the_full_poses(app: App, page: WireClient) -> None:
    fit(page, "pose")
    page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pose", 30.0)
    assert app.worker.wait_idle(IDLE_S)
    names, screening = session(app).face_labels, session(app).screening
    assert screening is not None
    effect = next(c.name for c in screening.candidates if c.members)
    app.add_effect(effect)
    assert app.worker.wait_idle(IDLE_S)
    assert [added.name for added in session(app).effects] == [effect]
    assert session(app).calibration.residual == "pose"  # type: ignore[union-attr]
    for residual in ("pose", "position"):
        app.move(-1)
        assert app.worker.wait_idle(IDLE_S)
        now = session(app)
        assert now.calibration is not None
        assert now.calibration.residual == residual
        assert now.face_labels is names
    points = session(app).measured.points
    assert points is not None
    assert points.orientations is None


# ---- nobody waits for names that he did not ask for -----------------------------------------------------------------


@pytest.mark.thorough
def test_the_page_does_not_wait_for_names_and_they_are_worked_out_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch)
    with serving(folder / "cell", port=0) as app, WireClient(app.server.get_port()) as page:
        page.wait(lambda p: app.state.view is not None and session(app).residual_tests is not None, 60.0)
        shows(page, "faces named")
        fit(page, "pose")
        page.wait(lambda p: p.has("Calibrating …"), 30.0)
        assert gate.begun.wait(IDLE_S)  # the button says so before the work is handed to its thread
        assert gate.calls == 1
        page.trigger("Next pose")  # the page goes on meanwhile
        shows(page, f"2 of {POSES}")
        assert session(app).calibration.residual == "position"  # type: ignore[union-attr]
        gate.open.set()
        shows(page, "pose, ", "pose can be fitted")
        assert app.worker.wait_idle(IDLE_S)
        assert session(app).calibration.residual == "pose"  # type: ignore[union-attr]
        before = session(app).calibration
        page.wait(lambda p: p.has("Calibrate"))
        assert page.props("Calibrate")["disabled"]  # the same once more would change nothing
        app.calibrate("pose")
        page.wait(lambda p: session(app).calibration is not before, 30.0)
        assert app.worker.wait_idle(IDLE_S)
        assert gate.calls == 1


@pytest.mark.thorough
def test_another_dataset_meanwhile_is_not_touched(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = Gate(monkeypatch)
    with serving(folder, port=0) as app, WireClient(app.server.get_port()) as page:
        app.open("cell")
        page.wait(lambda p: app.state.name == "cell" and session(app).residual_tests is not None, 60.0)
        fit(page, "pose")
        assert gate.begun.wait(IDLE_S)
        page.set("Dataset", "points")
        page.wait(lambda p: app.state.name == "points" and session(app).calibration is not None, 60.0)
        gate.open.set()
        assert app.worker.wait_idle(IDLE_S)
        assert session(app).dataset.name == "points"
        assert session(app).face_labels is None
        assert session(app).calibration.residual == "position"  # type: ignore[union-attr]
        page.wait(lambda p: p.has("Calibrate"))
        assert page.value("Fit") == "position"
        assert "pose" not in page.props("Fit")["options"]


# ---- where there are no full poses ----------------------------------------------------------------------------------


@pytest.mark.thorough
def test_faces_that_the_robot_contradicts_are_told_and_full_poses_refused(folder: Path) -> None:
    with idle_app(folder / "contradicted") as app, WireClient(app.server.get_port()) as page:
        first = session(app).calibration
        assert first is not None
        said = "training poses, and full poses need half of them: the nominal robot predicts another orientation"
        shows(
            page,
            "pose cannot be fitted: the jig's faces can be told apart at ",
            said,
            "of the last joint above all",
            "or fit positions",
        )
        assert "pose" not in page.props("Fit")["options"]
        app.calibrate("pose")
        page.wait(lambda p: p.notifications, 30.0)
        reason = page.notifications[-1]["props"]["body"]
        assert said in reason
        assert app.worker.wait_idle(IDLE_S)
        assert session(app).calibration is first
        dataset, searches = load_dataset(folder / "contradicted"), session(app).searches
    with pytest.raises(FitError) as refusal:  # as the command does it
        calibrate(with_corners(dataset, searches, orientation=True), FitOptions("pose"))
    assert str(refusal.value) == reason


@pytest.mark.thorough
def test_poses_that_were_chosen_for_one_dataset_are_not_the_next_ones(folder: Path) -> None:
    with idle_app(folder) as app, WireClient(app.server.get_port()) as page:
        app.open("cell")
        assert app.worker.wait_idle(IDLE_S)
        fit(page, "pose")
        page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pose", 30.0)
        assert app.worker.wait_idle(IDLE_S)
        page.set("Dataset", "points")
        page.wait(lambda p: app.state.name == "points", 30.0)
        assert app.worker.wait_idle(IDLE_S)
        assert session(app).calibration.residual == "position"  # type: ignore[union-attr]
        page.wait(lambda p: p.value("Fit") == "position")
        shows(page, "(qw, qx, qy, qz)")
        assert page.props("Fit")["options"] == page.props("Measured")["options"]
        assert "pose" not in page.props("Fit")["options"]  # full poses only where there are any
        assert not page.notifications
        page.set("Dataset", "cell")
        page.wait(lambda p: p.value("Fit") == "pose", 30.0)
        assert "pose" in page.props("Measured")["options"]


def test_points_with_orientations_need_no_names(folder: Path, tmp_path: Path) -> None:
    made = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(4), poses=20, orientation_sigma_rad=1e-4)
    write_dataset(replace(made.dataset, name="full"), tmp_path / "full")
    with idle_app(tmp_path / "full") as app, WireClient(app.server.get_port()) as page:
        shows(page, "points.csv has orientations")
        fit(page, "pose")
        page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pose", 30.0)
        assert app.worker.wait_idle(IDLE_S)
        assert session(app).face_labels is None
        assert session(app).calibration.face_labelling is None  # type: ignore[union-attr]


# ---- sessions -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def searched(folder: Path) -> Session:
    opened = measuring.open_session(folder / "cell")
    for pose in range(POSES):
        opened = measuring.with_search(opened, pose)
    return opened


def test_a_new_corner_makes_old_names_stale(searched: Session) -> None:
    named = measuring.with_face_labels(searched)
    assert named.face_labels is not None
    assert measuring.with_face_labels(named) is named
    again = measuring.with_search(named, 3)
    assert again.face_labels is None
    assert again.unlabelled


def test_a_session_names_what_a_fit_of_full_poses_needs_and_nothing_else(searched: Session) -> None:
    assert sessions.with_calibration(searched).face_labels is None
    full = sessions.with_calibration(searched, "pose")
    assert full.face_labels is not None
    points = full.measured.points
    assert points is not None
    assert isinstance(points.orientations, Orientations)
    assert points.orientations.known.all()
    assert measuring.no_full_poses(full) == ""
    assert "found no orientation" in measuring.no_full_poses(searched)


@pytest.mark.thorough
def test_a_saved_fit_of_full_poses_from_scans_opens_again(searched: Session, folder: Path) -> None:
    full = sessions.with_calibration(searched, "pose")
    path = folder / "session.json"
    save_session(path, full)
    saved = load_session(path)
    found, notes = opening(saved, folder)
    assert notes == ()
    fresh = replace(searched, dataset=load_dataset(found.folder), searches=dict(searched.searches))
    again, notes = reopened(fresh, saved)
    assert notes == ()
    assert again.face_labels is not None
    assert again.calibration is not None
    assert full.calibration is not None
    np.testing.assert_array_equal(again.calibration.fit.x, full.calibration.fit.x)
    with idle_app(folder / "cell", saved=found) as app, WireClient(app.server.get_port()) as page:
        shows(page, "pose, ", "attitude of the jig", "pose can be fitted")
        assert session(app).face_labels is not None
        np.testing.assert_array_equal(session(app).calibration.fit.x, full.calibration.fit.x)  # type: ignore[union-attr]
        assert page.value("Fit") == "pose"
