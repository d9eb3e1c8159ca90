"""`mount` in dataset.toml: the scanner in the room or on the flange."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from tests.support.arms import flange_dataset_of, random_arm


def _written(folder: Path, **options) -> Path:
    rng = np.random.default_rng(0)
    arm = random_arm(rng, 5)
    write_dataset(flange_dataset_of(arm, arm, rng, poses=20, **options), folder)
    return folder


def test_a_scanner_on_the_flange_is_written_and_read(tmp_path: Path) -> None:
    folder = _written(tmp_path / "d", targets=("jig", "by the door"))
    assert 'mount = "flange"' in (folder / "dataset.toml").read_text()
    again = load_dataset(folder)
    assert again.robot.carries_scanner
    assert again.robot.targets == ()
    assert set(again.points.target) == {"jig", "by the door"}
    assert again.warnings == ()
    write_dataset(again, tmp_path / "e")
    for name in ("dataset.toml", "robot.toml", "points.csv"):
        assert (tmp_path / "e" / name).read_text() == (folder / name).read_text()


def test_another_mount_is_refused(tmp_path: Path) -> None:
    folder = _written(tmp_path / "d")
    text = (folder / "dataset.toml").read_text()
    (folder / "dataset.toml").write_text(text.replace('"flange"', '"ceiling"'))
    with pytest.raises(DatasetError, match=r"mount: found 'ceiling'; expected 'room' or 'flange'"):
        load_dataset(folder)


def test_a_target_on_the_arm_is_not_seen_from_the_flange(tmp_path: Path) -> None:
    folder = _written(tmp_path / "d", targets=("jig", "smr2"))
    robot = folder / "robot.toml"
    robot.write_text(robot.read_text() + '\n[[targets]]\nname = "smr2"\nxyz_mm = [1.0, 2.0, 3.0]\n')
    with pytest.raises(DatasetError, match=r"line 3, column target: found 'smr2', which robot.toml has on the arm"):
        load_dataset(folder)
