"""A ball that the URDF does not know: from the user's files to corrected targets, judged by kinematics of its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.statistics import rms_length
from inspector.cli.parser import main
from tests.support import unknown_ball
from tests.support.commands import answered, printed
from tests.support.unknown_ball import Measured

ARMS = {"like a UR": unknown_ball.UR_LIKE, "seven axes": unknown_ball.SEVEN_AXES}


@pytest.fixture(scope="module", params=ARMS)
def cell(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Measured]:
    folder = tmp_path_factory.mktemp("ball")
    seen = unknown_ball.measured(ARMS[request.param], folder)
    files = [f"--robot={folder / 'robot.urdf'}", f"--joints={folder / 'joints.csv'}"]
    printed("import", folder / "data", *files, f"--points={folder / 'points.csv'}")
    return folder, seen


@pytest.mark.slow
def test_the_tip_keeps_its_attitude_and_the_ball_is_a_point_of_its_own(
    cell: tuple[Path, Measured], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, seen = cell
    out, toml = tmp_path / "out.urdf", tmp_path / "robot.toml"
    template = ["--urdf-out", str(out), "--template", str(folder / "robot.urdf"), "--out", str(toml)]
    capsys.readouterr()
    document = answered("calibrate", folder / "data", *template)

    ball_mm = np.array(document["tool_found_in_tip_mm"])
    np.testing.assert_allclose(ball_mm, seen.ball_mm, atol=3.0)  # 1 mm and 2 mrad of the arm's own errors
    names = {p["name"] for p in document["parameters"]}
    assert {"jig.x", "jig.y", "jig.z"} <= names
    assert not {"thetaTCP", "alphaTCP", "betaTCP"} & names  # of which the points tell nothing

    arm = unknown_ball.read_urdf(out.read_text())
    np.testing.assert_allclose(arm.tip, seen.nominal.tip, atol=1e-9)
    off_rad, nominal_off_rad = unknown_ball.tip_off(arm, seen)
    assert np.degrees(off_rad) < 0.6
    assert off_rad < 1.1 * nominal_off_rad
    assert unknown_ball.held_out_mm(arm, seen) < 0.15
    assert unknown_ball.held_out_mm(arm, seen, ball_mm) < 0.15
    assert document["test"]["rmse_mm"] == pytest.approx(unknown_ball.held_out_mm(arm, seen, ball_mm), rel=0.02)

    as_delivered_mm = unknown_ball.held_out_mm(seen.nominal, seen)
    assert document["before"]["test"]["rmse_mm"] == pytest.approx(as_delivered_mm, rel=0.15)
    assert document["iterations"][0]["rmse_mm"] > 50.0  # robot.toml's own tool, before the ball is found

    anew = tmp_path / "anew.urdf"
    assert main(["convert", str(toml), str(anew), "--template", str(folder / "robot.urdf")]) == 0
    again = unknown_ball.read_urdf(anew.read_text())
    np.testing.assert_allclose(again.tip, arm.tip, atol=1e-9)
    assert unknown_ball.held_out_mm(again, seen, ball_mm) == pytest.approx(
        unknown_ball.held_out_mm(arm, seen, ball_mm), abs=1e-6
    )
    assert '<link name="tool_point"/>' in out.read_text()
    assert '<link name="tool_point"/>' in anew.read_text()


@pytest.mark.slow
def test_corrected_joints_bring_the_true_tip_there_by_small_moves(
    cell: tuple[Path, Measured], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, seen = cell
    model, out = tmp_path / "model.json", tmp_path / "corrected.csv"
    assert main(["calibrate", str(folder / "data"), "--model-out", str(model)]) == 0
    capsys.readouterr()
    files = ["--model", str(model), "--joints", str(folder / "targets.csv"), "--out", str(out)]
    code = main(["correct", str(folder / "data"), *files, "--json"])
    document = json.loads(capsys.readouterr().out)
    assert document["what"] == "position"
    assert (code == 0) == (not document["not_reached"])

    wanted, got = (_joints(path) for path in (folder / "targets.csv", out))
    reached = ~np.isnan(got).any(axis=1)
    assert reached.sum() == document["reached"] >= 0.95 * len(wanted)
    assert len(document["not_reached"]) == (~reached).sum()
    moved_deg = np.degrees(np.abs(got - wanted)).max(axis=1)
    assert (moved_deg[reached] < 3.0).sum() >= 0.95 * len(wanted)
    assert document["largest_move_deg"] == pytest.approx(moved_deg[reached].max())
    off_mm = [_off_mm(seen, wanted[reached], joints[reached]) for joints in (wanted, got)]
    assert off_mm[1] < 0.4 * off_mm[0]


def _joints(path: Path) -> np.ndarray:
    return np.radians(pd.read_csv(path).filter(regex="_deg$").to_numpy())


def _off_mm(seen: Measured, wanted: np.ndarray, commanded: np.ndarray) -> float:
    """3D RMS of the true tip from where the nominal one was meant to be, up to one motion of the base."""
    meant = np.array([seen.nominal.tip_at(q)[:3, 3] for q in wanted])
    stands = np.array([seen.true.tip_at(q)[:3, 3] for q in commanded])
    base = unknown_ball.rigid(stands, meant)
    off = stands @ base[:3, :3].T + base[:3, 3] - meant
    return rms_length(off)
