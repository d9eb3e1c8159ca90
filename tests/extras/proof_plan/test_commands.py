"""`plan --for prove` on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.dataset.files.folder import write_dataset
from inspector.cli.parser import main
from tests.support.few_joints import ends_well, few_joints


def test_what_cannot_be_planned_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "rb5", "--for", "prove"]) == 2
    captured = capsys.readouterr()
    assert "settles what a dataset's diagnosis left open; give its folder" in captured.err
    assert captured.err.count("\n") == 1
    (tmp_path / "offered.csv").write_text("pose\n")
    assert main(["plan", "rb5", "--for", "prove", "--candidates", str(tmp_path / "offered.csv")]) == 2
    assert "leave out --candidates" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(("joints", "poses"), [(1, 20), (2, 20), (3, 3)])
def test_few_joints_and_few_poses_end_well(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, joints: int, poses: int
) -> None:
    write_dataset(few_joints(joints, "plain", poses=poses), tmp_path / "cell")
    ends_well(capsys, tmp_path, "plan", "--for", "prove")
