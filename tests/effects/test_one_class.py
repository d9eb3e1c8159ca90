"""One effect, one class: all that is said about an effect is read from its class."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import calib.effects.catalogue as catalogue
from calib import calibrate, screen
from calib.dataset.dataset import Dataset
from calib.effects.catalogue.user_file import check_effects
from calib.effects.effect import CatalogueEffect, Effect, Family, NaturalBound, Parameter, describe, exceeded_bound
from calib.effects.state import RobotState
from calib.errors import CalibError
from calib.fitting.observations import nominal_state
from calib.kinematics.chain import target_jacobian
from calib.present.diagnosis.candidates import candidate_blocks
from calib.rendering.text import block_text
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support import ROOT
from tests.support.changed import with_xyz
from tests.support.commands import answered


@dataclass(frozen=True)
class TwentyThirdHarmonic(CatalogueEffect):
    """An effect that the catalogue does not have: theta_j += A sin(23 q_j)."""

    joint: int
    name = "twenty_third_harmonic"
    noun = "the 23rd harmonic of joint"
    equation = "theta_j += A sin(23 q_j)"
    symbols = (("A", "rad"),)
    needs = "joint angles over a 23rd of a turn"
    confirm = "one joint alone in steps of a twentieth of a turn"
    bounds = ()
    linear = True
    parameters = (Parameter("sin23_rad", "rad", 3e-4, "amplitude"),)

    def apply(self, state: RobotState, *, sin23_rad: float) -> RobotState:
        return state.add_joint_error(self.joint, sin23_rad * np.sin(23.0 * state.q_rad[:, self.joint]))

    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        return f"23 waves of {1e6 * value:.0f} urad at {len(state.poses)} poses"

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        return Family(cls.name, tuple(cls(j) for j in range(dataset.robot.n_joints)), note="seen in a test")


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The class in the catalogue's list, and nothing else changed anywhere."""
    monkeypatch.setattr(catalogue, "CATALOGUE", (*catalogue.CATALOGUE, TwentyThirdHarmonic))


@pytest.fixture(scope="module")
def hidden() -> Dataset:
    """A simulated arm whose third joint has the effect; its truth is the tool's motion by theta3."""
    simulation = simulate_dataset("rb5", rng=6, poses=80, noise_mm=0.05, conditions=True)
    dataset = simulation.dataset
    q = dataset.poses.q[dataset.points.pose]
    base_to_scanner = calibrate(dataset).before.scanner_T_base[""][:3, :3]
    column = dataset.robot.parameter_names.index("theta3")
    moved = target_jacobian(dataset.robot, q)[..., column] * (5e-4 * np.sin(23 * q[:, 2]))[:, None]
    return with_xyz(dataset, dataset.points.xyz_mm + moved @ base_to_scanner.T)


@pytest.mark.usefixtures("listed")
def test_the_command_lists_a_class_that_is_in_the_catalogue(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    line = "twenty_third_harmonic: theta_j += A sin(23 q_j)  [A rad]; needs joint angles over a 23rd of a turn"
    assert line in capsys.readouterr().out.splitlines()
    assert answered("effects")["effects"][-1] == {
        "name": "twenty_third_harmonic",
        "equation": "theta_j += A sin(23 q_j)",
        "parameters": [{"name": "A", "unit": "rad"}],
        "needs": "joint angles over a 23rd of a turn",
    }


@pytest.mark.parametrize("kind", catalogue.CATALOGUE, ids=lambda kind: kind.name)
def test_every_class_of_the_catalogue_tells_all_about_itself(kind: type[CatalogueEffect]) -> None:
    assert re.fullmatch(r"[a-z_]+", kind.name)
    assert kind.equation
    assert kind.needs
    assert kind.noun
    assert describe(kind).title
    assert all(bound.size > 0 and bound.unit and bound.source for bound in kind.bounds)
    assert kind.notes.count("$") % 2 == 0
    assert all(name and unit for name, unit in kind.symbols)
    assert bool(kind.confirm) == kind.testable
    assert kind.__doc__


EFFECT = '''"""Pneumatics: a hose under pressure stiffens the wrist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.dataset.dataset import Dataset
from calib.effects.effect import CatalogueEffect, Family, NaturalBound, Parameter
from calib.effects.state import RobotState


@dataclass(frozen=True)
class WrappedHose(CatalogueEffect):
    """A hose that is wrapped round a joint: theta += k q^3."""

    joint: int
    name = "wrapped_hose"
    noun = "the hose round joint"
    equation = "theta_j += k_j q_j^3"
    symbols = (("k_j", "rad/rad^3"),)
    needs = "joint angles over a good range"
    confirm = "the same poses without the hose"
    bounds = (NaturalBound(1e-2, "rad/rad^3", "a hose that turns a drive so far tears"),)
    linear = True
    parameters = (Parameter("k", "rad/rad^3", 3e-5, "turn at one radian"),)

    def apply(self, state: RobotState, *, k: float) -> RobotState:
        return state.add_joint_error(self.joint, k * state.q_rad[:, self.joint] ** 3)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        return Family(cls.name, tuple(cls(j) for j in range(dataset.robot.n_joints)))
'''
LAW = '''"""The exact law of a wrapped hose."""

from __future__ import annotations

from calib.array_types import Array
from calib.simulation.truth.mechanism import Arm
from calib.simulation.truth.sampling import JointError, Rng, SampledEffect, SimulatedCell, one_joint


class WrappedHose(JointError):
    """A hose round a joint: dq_j = k_j q_j^3."""

    name = "wrapped_hose"
    magnitude_fields = ("k",)
    k: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return self.k * arm.commanded**3

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return one_joint(cell, rng, cls)
'''


COMMANDS = """
import contextlib, io, json, sys
from inspector.cli.parser import main

said = []
for arguments in json.loads(sys.argv[1]):  # one process for all, which loads the copy of the package once
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(arguments) == 0, arguments
    said.append(out.getvalue())
print(json.dumps(said))
"""


@pytest.mark.thorough
def test_a_class_and_its_law_are_all_that_an_effect_takes(tmp_path: Path) -> None:
    """Two new files in a copy of the package: listed, simulated, found, named, and kept in a model file."""
    shutil.copytree(ROOT / "calib", tmp_path / "calib", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "calib/effects/catalogue/pneumatics.py").write_text(EFFECT)
    (tmp_path / "calib/simulation/truth/pneumatics.py").write_text(LAW)

    commands = [
        ["effects", "--json"],
        ["simulate", "cell", "--robot", "rb5", "--effect", "wrapped_hose", "--seed", "1"],
        ["diagnose", "cell", "--model-out", "model.json", "--json"],
        ["diagnose", "cell"],
        ["validate", "cell", "--model", "model.json"],
    ]
    around = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, json.dumps(commands)],
        cwd=tmp_path,
        env=around,
        capture_output=True,
        text=True,
        check=True,
    )
    effects, _, found, told, validated = json.loads(done.stdout)
    assert json.loads(effects)["effects"][-1]["name"] == "wrapped_hose"
    assert (json.loads(found)["verdict"], json.loads(found)["missing"]) == ("named", ["wrapped_hose"])
    assert "hose round joint " in told
    assert "wrapped_hose" in (tmp_path / "model.json").read_text()
    assert "wrapped_hose" in validated


@dataclass(frozen=True)
class Lean:
    """As in a user's file: parameters and `apply`, and some of the texts."""

    parameters = (Parameter("x_mm", unit="mm", scale=0.1),)
    equation = "x += c q_1"
    confirm = "the first joint alone"
    noun = "the lean of the post"
    needs = 3  # no text: as if it said nothing
    bounds = (NaturalBound(2.0, "mm", "it would be seen"),)

    def apply(self, state: RobotState, *, x_mm: float) -> RobotState:
        return state.displace(x_mm * state.q_rad[:, :1] * [1.0, 0.0, 0.0])


class Curt(Lean):
    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        return 1 / 0 if value else ""  # type: ignore[return-value]


class Unbounded(Lean):
    bounds = (2.0,)  # type: ignore[assignment]


class Mute(Lean):
    def meaning(self, parameter: Parameter, value: float, state: RobotState) -> str:
        return None  # type: ignore[return-value]


def test_a_users_class_may_carry_the_same_texts(hidden: Dataset) -> None:
    (family,) = check_effects((Lean(),), nominal_state(hidden))
    said = family.description
    assert (said.name, said.title, said.noun) == ("lean", "lean", "the lean of the post")
    assert (said.equation, said.needs) == ("x += c q_1", "")
    assert exceeded_bound(Lean(), Lean.parameters[0], 3.0, 0.1) == Lean.bounds[0]
    ranking = screen(calibrate(hidden), (family,))
    page = block_text(*candidate_blocks("lean", ranking.candidates[0], calibrate(hidden), ranking.cv_rmse_mm, own=True))
    assert "x += c q_1" in page
    assert "the first joint alone" in page
    assert "needs" not in page


def test_a_users_bounds_that_are_none_are_refused(hidden: Dataset) -> None:
    with pytest.raises(CalibError, match=r"mine.py: effect Unbounded: `bounds` is \(2.0,\); a tuple of NaturalBound"):
        check_effects((Unbounded(),), nominal_state(hidden), "mine.py")


@pytest.mark.parametrize(
    ("effect", "says"), [(Curt(), "fails with ZeroDivisionError"), (Mute(), "returns NoneType; return text")]
)
def test_a_users_meaning_that_fails_is_one_line_when_the_file_is_read(
    hidden: Dataset, effect: Effect, says: str
) -> None:
    with pytest.raises(CalibError, match=rf"mine.py: effect \w+: `meaning` {says}") as caught:
        check_effects((effect,), nominal_state(hidden), "mine.py")
    assert "\n" not in str(caught.value)
