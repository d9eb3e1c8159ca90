"""Damaged and hostile robot files give a one-line error that names the file, and neither hang nor show other files."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot, robot_to_toml
from calib.errors import CalibError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from inspector.cli.parser import main
from tests.support.chains import shoulder_arm
from tests.support.robot_texts import FRANKA, UR_YAML
from tests.support.scan_mutations import mutated
from tests.support.sweeps import sweep

FILES = {
    "arm.urdf": (shoulder_arm(), ReadOptions(tip="tool0")),
    "arm.yaml": (UR_YAML, ReadOptions()),
    "arm.csv": (FRANKA, ReadOptions(convention="modified")),
}
COUNTS = sweep([12, 400], every_run=[12])


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_robot_is_read_or_told_in_one_line(tmp_path: Path, name: str, count: int) -> None:
    text, reading = FILES[name]
    path, rng = tmp_path / name, np.random.default_rng(1)
    for _ in range(count):
        content = mutated(text.encode(), rng)
        path.write_bytes(content)
        said = ""
        try:
            read_robot(path, reading)
        except CalibError as error:
            said = str(error)
        assert not said or said.startswith(str(path)), said
        assert "\n" not in said
        assert len(said) < 2000


def comb(links: int) -> str:
    """URDF of a chain of links with a further link on each."""
    names = "".join(f'<link name="{kind}{i}"/>' for i in range(links) for kind in "ab")
    joints = "".join(
        f'<joint name="{kind}{i}" type="continuous"><parent link="a{i}"/><child link="{child}"/></joint>'
        for i in range(links - 1)
        for kind, child in (("j", f"a{i + 1}"), ("k", f"b{i}"))
    )
    return f"<robot>{names}{joints}</robot>"


LONG = {
    "a long line.yaml": "kinematics:\n  a" + " " * 900_000 + "\n",
    "many links.urdf": comb(20_000),
    "as many as are read.urdf": comb(2_400),
    "a long name.csv": "a" + "_" * 300_000 + "[x,theta,d,alpha\n1,2,3,4\n",
    "many levels.urdf": "<robot>" + "<link>" * 100_000,
    "a long number.urdf": '<robot><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    f'<child link="b"/><axis xyz="0 0 {"9" * 500_000}"/></joint></robot>',
}


@pytest.mark.parametrize("name", LONG)
@pytest.mark.thorough
def test_long_files_are_no_hang(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(LONG[name])
    with pytest.raises(CalibError) as caught:
        read_robot(path)
    assert len(str(caught.value)) < 2000


@pytest.mark.slow
def test_the_command_answers_with_exit_code_2_and_no_traceback(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    out = tmp_path / "robot.toml"
    for name, (text, reading) in FILES.items():
        options = [f"--{key}={value}" for key, value in vars(reading).items() if value is not None]
        path = tmp_path / name
        for _ in range(20):
            path.write_bytes(mutated(text.encode(), rng))
            said = io.StringIO()
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
                code = main(["convert", str(path), str(out), "--force", *options])
            assert code in (0, 2)
            assert "internal error" not in said.getvalue(), said.getvalue()
            assert said.getvalue().count("\n") == (1 if code else 0)


def test_a_robot_toml_that_is_converted_goes_through_the_same_checks(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(builtin_robot("rb5")).replace("425.0", "nan"))
    with pytest.raises(CalibError, match=r"robot\.toml"):
        read_robot(path)
