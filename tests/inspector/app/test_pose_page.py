"""Full poses on the page: names of the jig's faces from its scans, worked out aside, once; or why there are none."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.calibration.model_versions import LINKS
from calib.dataset.dataset import Orientations
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.measurement.measured_points import with_corners
from calib.present.fit.corners import face_labelling
from calib.rendering import numbers
from calib.simulation.simulate import simulate_dataset, write_simulation
from inspector.app.app import App
from inspector.export.csv_files import corners_csv
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from tests.support.app import idle, idle_app, shows
from tests.support.commands import answered
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
    measured = simulate_dataset("rb5", rng=3, poses=20, name="points")
    write_dataset(measured.dataset, folder / "points")
    return folder


@pytest.fixture
def app(folder: Path) -> Iterator[App]:
    with idle_app(folder / "cell") as app:
        yield app


def session(app: App) -> Session:
    return app.state.view.session


def fit(page: WireClient, residual: str) -> None:
    page.set("Fit", residual)
    page.wait(lambda p: not p.props("Calibrate")["disabled"])  # where it would change something
    page.click("Calibrate")


# ---- full poses from scans ------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_scans_are_fitted_as_full_poses_as_the_command_fits_them(app: App, page: WireClient, folder: Path) -> None:
    shows(page, f"nominal robot at {POSES} poses, margin 1")
    plain_points = session(app).measured.points
    assert plain_points.orientations is None  # a fit of positions takes no more than it did
    fit(page, "pose")
    shows(page, "pose, ", "attitude of the jig")
    idle(app)
    ours = session(app).calibration
    theirs = answered("calibrate", folder / "cell", "--residual", "pose")
    assert ours.face_labelling is not None
    assert theirs["faces_named"] == face_labelling(ours.face_labelling)
    np.testing.assert_allclose(ours.to_frame()["value"], [p["value"] for p in theirs["parameters"]], atol=1e-9)
    for role in ("train", "test"):
        before, after = (theirs["attitudes"][when][role]["rmse_rad"] for when in ("before", "after"))
        assert after < before
        shows(page, f"{1e3 * before:.4f}", f"{1e3 * after:.4f}", numbers.reduction(before, after))
    assert [step.calibration.residual for step in session(app).steps] == ["pose"]
    assert session(app).history[-1].label == LINKS

    page.click("Measured points (CSV)")
    page.wait(lambda p: p.downloads, 30.0)
    (content,) = page.downloads.values()
    searches = session(app).searches
    full = with_corners(load_dataset(folder / "cell"), searches, orientation=True)  # as `corners --orientation` does
    pd.testing.assert_frame_equal(pd.read_csv(io.BytesIO(content)), pd.read_csv(io.StringIO(corners_csv(full))))


# ---- nobody waits for names that he did not ask for -----------------------------------------------------------------


# ---- where there are no full poses ----------------------------------------------------------------------------------


def test_points_with_orientations_need_no_names(folder: Path, tmp_path: Path) -> None:
    made = simulate_dataset("rb5", rng=4, poses=20, orientation_sigma_rad=1e-4)
    write_dataset(replace(made.dataset, name="full"), tmp_path / "full")
    with idle_app(tmp_path / "full") as app, WireClient(app.server.get_port()) as page:
        shows(page, "points.csv has orientations")
        fit(page, "pose")
        page.wait(lambda p: (c := session(app).calibration) is not None and c.residual == "pose", 30.0)
        idle(app)
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
    assert isinstance(points.orientations, Orientations)
    assert points.orientations.known.all()
    assert measuring.no_full_poses(full) == ""
    assert "found no orientation" in measuring.no_full_poses(searched)
