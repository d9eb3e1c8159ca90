"""A slip as the page and the commands have it: advised with its pose, added, saved, opened again, taken out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from inspector.cli.parser import main
from tests.support import ROOT
from tests.support.commands import answered, printed, refused

SLIPPED = ROOT / "sample_data" / "hidden_effect_c"


@pytest.mark.thorough
def test_the_commands_name_it_with_joint_and_pose_and_correct_for_the_arm_as_it_is_now(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "-0.23° from pose p37 on" in printed("diagnose", SLIPPED)
    model = tmp_path / "model.json"
    fitted = answered("calibrate", SLIPPED, "--add", "joint_step", "--model-out", model)["parameters"]
    (step,) = [p for p in fitted if p["name"].startswith("joint_step.")]
    assert step["name"] == "joint_step.J5.from_p37_rad"
    targets, out = tmp_path / "targets.csv", tmp_path / "out.csv"
    columns = ",".join(f"q{k}_deg" for k in range(1, 7))
    targets.write_text(f"{columns}\n10,20,30,40,50,60\n")
    asked = ["correct", str(SLIPPED), "--joints", str(targets), "--out", str(out), "--model", str(model)]
    assert main(asked) == 0
    assert "last measured pose (joint_step)" in capsys.readouterr().out
    assert np.degrees(step["value"]) == pytest.approx(-0.23, abs=0.01)
    assert float(out.read_text().splitlines()[1].split(",")[4]) > 50.2  # turned back by the slip; the rest is theta5
    assert "--add joint_step" in refused("calibrate", SLIPPED, "--effect", "joint_step")
