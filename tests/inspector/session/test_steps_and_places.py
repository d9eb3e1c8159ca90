"""A slip as the page and the commands have it: advised with its pose, added, saved, opened again, taken out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from inspector.cli.parser import main
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.reopening import dataset_of, reopened
from inspector.session.session_file import Shown, load_session, save_session
from tests.support import ROOT

SLIPPED = ROOT / "sample_data" / "hidden_effect_c"
NOISE_MM = 0.05


@pytest.mark.thorough
@pytest.mark.slow
def test_a_slip_is_advised_added_and_opened_again(tmp_path: Path) -> None:
    before = sessions.with_screening(sessions.with_calibration(measuring.open_session(SLIPPED)))
    assert before.advice is not None
    assert before.advice.effect == "joint_step"
    session = sessions.with_screening(sessions.with_effect(before, "joint_step"))
    assert session.diagnosis is not None
    assert (session.diagnosis.verdict, session.diagnosis.missing) == ("named", ("joint_step",))
    assert session.calibration is not None
    assert session.calibration.after.test is not None
    assert session.calibration.after.test.rmse_mm < 1.3 * np.sqrt(3.0) * NOISE_MM
    save_session(tmp_path / "session.json", session, Shown())
    saved = load_session(tmp_path / "session.json")
    again, notes = reopened(measuring.open_session(dataset_of(saved, SLIPPED)), saved)
    assert notes == ()
    assert again.calibration is not None
    np.testing.assert_allclose(again.calibration.fit.x, session.calibration.fit.x, atol=1e-9)
    assert sessions.without_effect(again, "joint_step").effects == ()


@pytest.mark.thorough
def test_the_commands_name_it_with_joint_and_pose_and_correct_for_the_arm_as_it_is_now(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diagnose", str(SLIPPED)]) == 0
    assert "-0.23° from pose p37 on" in capsys.readouterr().out
    model = tmp_path / "model.json"
    assert main(["calibrate", str(SLIPPED), "--add", "joint_step", "--model-out", str(model), "--json"]) == 0
    fitted = json.loads(capsys.readouterr().out)["parameters"]
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
    assert main(["calibrate", str(SLIPPED), "--effect", "joint_step"]) == 2
    assert "--add joint_step" in capsys.readouterr().err
