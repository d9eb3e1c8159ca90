"""The origin of models and sessions: hashes of the dataset's files, the command, the time."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

from tests.support import ROOT
from tests.support.commands import printed


def test_model_and_session_carry_hashes_that_any_tool_computes_and_the_command(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "sample_data" / "hidden_effect_a", tmp_path / "arm")
    made = {"--model-out": tmp_path / "model.json", "--session": tmp_path / "session.json"}
    printed("calibrate", tmp_path / "arm", *(word for pair in made.items() for word in pair))
    for path in made.values():
        told = json.loads(path.read_text())
        assert set(told["dataset"]["files"]) == {"dataset.toml", "robot.toml", "poses.csv", "points.csv"}
        for name, found in told["dataset"]["files"].items():
            assert found == hashlib.sha256((tmp_path / "arm" / name).read_bytes()).hexdigest()
        # Of an absolute path the name alone.
        assert told["origin"]["command"][:3] == ["inspector", "calibrate", "arm"]
        assert told["origin"]["made"].endswith("+00:00")
        assert told["program_version"]
