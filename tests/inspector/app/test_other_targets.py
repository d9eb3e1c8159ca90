"""A dataset whose scans show balls, on the page: found, drawn, told of, fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.rendering import numbers
from inspector.panels.measure.corner import corner_html
from inspector.panels.measure.planes import NO_PLANES, planes_html
from inspector.panels.measure.scans import corner_state
from inspector.session.measuring import open_session, with_search
from inspector.session.view import View
from tests.support.ball_dataset import write_ball_dataset

TABLE = '[[targets]]\nname = "jig"\nshape = "sphere"\ndiameter_mm = 30.0\n'


@pytest.mark.slow
def test_a_scanned_ball_is_told_of(tmp_path: Path) -> None:
    write_ball_dataset(tmp_path / "cell", TABLE, offsets={}, diameters_mm={"jig": 30.0}, poses=12, rays=6_000)
    session = with_search(open_session(tmp_path / "cell"), 0)
    view = View(session)
    assert corner_state(view, 0) == "found"
    assert "ø 30.000 mm" in corner_html(view)
    assert NO_PLANES in planes_html(view)
    assert not session.unlabelled
    np.testing.assert_array_equal(session.measured.points.target, ["jig"])


@pytest.mark.slow
def test_equal_balls_have_their_names_once_all_poses_are_searched(tmp_path: Path) -> None:
    table = "".join(f'[[targets]]\nname = "{name}"\nshape = "sphere"\ndiameter_mm = 25.0\n' for name in ("jig", "b"))
    offsets = {"b": np.array([60.0, 30.0, -60.0])}
    sizes = {"jig": 25.0, "b": 25.0}
    write_ball_dataset(tmp_path / "cell", table, offsets=offsets, diameters_mm=sizes, poses=12, rays=8_000)
    session = open_session(tmp_path / "cell")
    for pose in range(12):
        session = with_search(session, pose)
    said = corner_html(View(session, pose=3))
    measured = session.measured.points
    for row in np.flatnonzero(measured.pose == 3):
        place = " ".join(map(numbers.coordinate, measured.xyz_mm[row]))
        before = said.partition(place)[0]
        assert before.rpartition("&nbsp;")[2].startswith(f"{measured.target[row]}<")
    assert "jig, b" not in said
