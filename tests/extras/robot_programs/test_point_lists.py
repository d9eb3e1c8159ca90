"""Point lists for controllers, read back by a reader of each language's own form."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import calibrate, corrected_joints
from calib.compensation.correction import Correction
from calib.compensation.target_files import corrected_points
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.extras.robot_programs.point_lists import LONGEST, require_point_list
from calib.extras.robot_programs.program_templates import identifiers
from calib.robot_formats.target_form import form_of_targets
from tests.support.hidden_dataset import arm

IDS = ("p01", "p-02", "3", "P01", "über\n; HALT")


@pytest.fixture(scope="module")
def correction() -> Correction:
    dataset = arm(1)
    result = calibrate(dataset)
    found = corrected_joints(dataset.robot, result.model, dataset.poses.q[:5], x=result.fit.x, kind="position")
    reached, reasons = found.reached.copy(), list(found.reasons)
    assert reached.all()
    reached[3], reasons[3] = False, "joint 2 would stand\nbeyond its limit"
    return replace(found, reached=reached, reasons=tuple(reasons))


FORMS = {
    ".script": (r"^(\w+) = \[([^\]]*)\]", 1.0),
    ".dat": (r"^DECL GLOBAL AXIS (\w+)=\{([^}]*)\}", np.pi / 180.0),
    ".mod": (r"^  CONST jointtarget (\w+):=\[\[([^\]]*)\],\[9E9,9E9,9E9,9E9,9E9,9E9\]\];", np.pi / 180.0),
}


def written(name: str, correction: Correction) -> str:
    """Text of the point list of that name."""
    form = form_of_targets(Path(name))
    assert form is not None
    return corrected_points(form, Path(name), correction, IDS)


@pytest.mark.parametrize("suffix", LONGEST)
def test_what_a_controller_reads_is_what_was_corrected(correction: Correction, suffix: str) -> None:
    text = written(f"my targets{suffix}", correction)
    assert text.isascii()
    code = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith(("#", ";", "!")))
    names = identifiers(IDS, LONGEST[suffix])
    pattern, unit = FORMS[suffix]
    rows = re.findall(pattern, code, re.MULTILINE)
    assert [name for name, _ in rows] == [names[k] for k in (0, 1, 2, 4)]  # what is not reached is no target
    for k, (_, values) in zip((0, 1, 2, 4), rows, strict=True):
        q = [unit * float(value.split()[-1]) for value in values.split(",")]
        assert q == pytest.approx(correction.q[k], abs=2e-9)
    left_out = next(line for line in text.splitlines() if "left out" in line)
    assert names[3] in left_out
    assert "joint 2 would stand beyond its limit" in left_out


@pytest.mark.slow
@given(st.lists(st.text(min_size=1, max_size=60), min_size=1, max_size=30), st.sampled_from([24, 32, 64]))
def test_names_are_valid_and_distinct_without_regard_to_case(ids: list[str], longest: int) -> None:
    names = identifiers(ids, longest)
    assert len({name.lower() for name in names}) == len(ids)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) and len(name) <= longest for name in names)


@pytest.mark.parametrize(
    "word",
    ["end", "def", "movej", "p", "True", "sec", "ENDDAT", "E6POS", "Decl", "PTP", "ENDMODULE", "jointtarget", "v100",
     "z10", "fine", "tool0", "for", "Var", "atan2"],
)  # fmt: skip
@pytest.mark.parametrize("longest", sorted(LONGEST.values()))
def test_no_target_is_called_what_a_language_keeps_for_itself(word: str, longest: int) -> None:
    (name,) = identifiers([word], longest)
    assert name == f"p_{word}"[:longest]
    assert identifiers([word, f"p_{word}"], longest) == [name, f"{name[: longest - 2]}_2"]


@pytest.mark.parametrize("suffix", LONGEST)
def test_a_target_and_its_module_have_two_names(correction: Correction, suffix: str) -> None:
    text = written(f"p01{suffix}", correction)
    names = re.findall(r"(?m)^(?:DEFDAT|MODULE) (\w+)|^ *(?:DECL GLOBAL AXIS |CONST jointtarget )?(\w+) ?:?=", text)
    flat = [name.lower() for pair in names for name in pair if name]
    assert len(flat) == len(set(flat)) >= 4


@pytest.mark.parametrize(("robot", "reason"), [("panda", "this arm has 7"), ("gantry", "this arm has 3 and 3 sliding")])
def test_other_arms_are_refused(robot: str, reason: str) -> None:
    arm = builtin_robot("rb5" if robot == "gantry" else robot)
    if robot == "gantry":
        sliding = [replace(joint, type="prismatic", min=0.0, max=500.0) for joint in arm.joints[:3]]
        arm = replace(arm, joints=(*sliding, *arm.joints[3:]))
    with pytest.raises(CalibError, match=reason):
        require_point_list(Path("targets.mod"), arm)
