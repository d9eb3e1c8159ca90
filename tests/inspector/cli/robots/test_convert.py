"""inspector convert: what it prints, writes and refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import load_robot_toml
from calib.kinematics.chain import nominal_chain
from inspector.cli.parser import main
from tests.support.chains import shoulder_arm
from tests.support.commands import answered, printed, refused


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(shoulder_arm())
    return path


def test_to_robot_toml_and_back_leaves_the_text_alone(urdf: Path, tmp_path: Path) -> None:
    toml, out = tmp_path / "robot.toml", tmp_path / "out.urdf"
    said = printed("convert", urdf, toml, "--tip", "tool0")
    assert "(pan, lift, elbow, slide, roll)" in said
    assert "no origin changed" in printed("convert", toml, out, "--template", urdf)
    assert out.read_bytes() == urdf.read_bytes()


def test_a_plain_urdf_is_the_same_arm(urdf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toml, out, again = tmp_path / "robot.toml", tmp_path / "out.urdf", tmp_path / "again.toml"
    main(["convert", str(urdf), str(toml), "--tip", "tool0"])
    assert main(["convert", str(toml), str(out)]) == 0
    capsys.readouterr()
    document = answered("convert", out, again)
    assert document["largest_difference_mm"] < 1e-9
    one, other = load_robot_toml(toml), load_robot_toml(again)
    q = np.random.default_rng(0).uniform(-1, 1, (5, 5))
    places = [nominal_chain(r, q).base_T_frame[:, -1] for r in (one, other)]
    assert np.abs(places[0] - places[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["arm.urdf", "robot.toml"], "several tips; choose one with --tip: flange, finger, tool0"),
        (
            ["arm.urdf", "robot.toml", "--tip", "tool9"],
            "there is no link 'tool9'; the tips are finger, tool0",
        ),
        (["arm.urdf", "robot.toml", "--tip", "tool0", "--base", "finger"], "is not on the way from"),
        (["arm.urdf", "robot.step", "--tip", "tool0"], "expected a name that ends in"),
        (["arm.urdf", "arm.urdf"], "is what this command reads"),
        (["none.urdf", "robot.toml"], "none.urdf: No such file"),
        (["arm.urdf", "there.toml", "--tip", "tool0"], "there.toml: exists; name another file, or --force"),
        (["arm.urdf", "robot.toml", "--template", "arm.urdf"], "only a .urdf or .yaml or .yml is made of one"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_nothing_is_written(
    urdf: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("")
    before = sorted(tmp_path.iterdir())
    found = refused("convert", *arguments)
    assert said in found
    assert sorted(tmp_path.iterdir()) == before
