"""Poses that stand out, without a browser: a button that leaves them out stands where the page names them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from calib.dataset.files.folder import write_dataset
from calib.diagnosis.moves import AddEffect
from inspector.app.app import App
from inspector.panels.learn.measurements import leave_out_label
from tests.support.app import idle, idle_app
from tests.support.hidden_dataset import UNNAMED, arm
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow  # a whole app, running

FAR = {7: (0.0, 2.0, 0.0), 21: (1.5, 0.0, 0.5)}  # mm, by which points are off


def write_outlying(folder: Path, seed: int, *effects: tuple[str, float]) -> tuple[Path, list[str]]:
    """64 poses at `folder`, points of two of them far off; the folder, and the ids of these two."""
    dataset = arm(seed, *effects)
    xyz_mm = dataset.points.xyz_mm.copy()
    for row, by_mm in FAR.items():
        xyz_mm[row] += by_mm
    far = dataset.with_points(replace(dataset.points, xyz_mm=xyz_mm))
    write_dataset(replace(far, name=folder.name), folder)
    return folder, [dataset.poses.ids[dataset.points.pose[row]] for row in FAR]


@pytest.fixture(scope="module")
def outlying(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    return write_outlying(tmp_path_factory.mktemp("outlying") / "cell", 5)


@pytest.fixture
def app(outlying: tuple[Path, list[str]]) -> Iterator[App]:
    with idle_app(outlying[0]) as running:
        yield running


def buttons(page: WireClient, label: str) -> int:
    """Number of visible buttons with a label."""
    props = [widget["props"] for widget in page.gui.values()]
    return sum(p.get("label") == label and p.get("visible", True) for p in props)


@pytest.mark.thorough
def test_poses_that_a_diagnosis_names_are_left_out_as_one_change(tmp_path: Path) -> None:
    folder, ids = write_outlying(tmp_path / "uneven", 2004, UNNAMED)
    with idle_app(folder) as app, WireClient(app.server.get_port()) as page:
        app.find(True)
        idle(app)
        session = app.state.session
        poses = session.residual_tests.outlier_poses
        assert set(poses) <= set(ids)
        assert session.diagnosis.verdict == "unexplained"
        label = leave_out_label(poses)
        assert buttons(page, label) == 2  # in "What is missing" and "Where it fails"
        page.click(label)
        page.wait(lambda p: buttons(p, label) == 0)
        idle(app)
        assert app.state.session.asked_out == poses
        app.move(-1)
        idle(app)
        assert app.state.session.uncounted == frozenset()
        page.wait(lambda p: buttons(p, label) == 2)
        app.leave_out_poses([*ids, "no such pose"])
        idle(app)
        assert app.state.session.uncounted == set(ids)
        app.move(-1)
        idle(app)
        assert app.state.session.uncounted == frozenset()


def test_a_pose_that_an_effect_may_explain_has_no_button(tmp_path: Path) -> None:
    folder, _ = write_outlying(tmp_path / "soft", 5, ("backlash", 6.0))
    with idle_app(folder) as app, WireClient(app.server.get_port()) as page:
        session = app.state.session
        assert session.residual_tests.outlier_poses
        assert session.diagnosis is None
        assert isinstance(session.advice.move, AddEffect)
        assert buttons(page, leave_out_label(session.residual_tests.outlier_poses)) == 0


def test_a_button_names_a_few_poses() -> None:
    assert leave_out_label(["p1"]) == "Leave out p1"
    assert leave_out_label([f"p{k}" for k in range(1, 8)]) == "Leave out p1, p2, p3, p4 and 3 more"
