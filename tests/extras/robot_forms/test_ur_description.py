"""UR calibration written into a stock ROS description: the controller's flange, and links near their nominal places.

The description is written by hand as the ROS xacro does it: base, base_link_inertia turned by half a turn, six joints
about z at the origins of the YAML, the flange and tool0 on wrist_3. The controller uses standard Denavit-Hartenberg
with theta = q + delta_theta, d, a and alpha of nominal table and deltas.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.extras.robot_forms.ur_calibration import MODELS, nominal_rows
from inspector.cli.parser import main
from tests.support.robot_texts import DELTAS, FAR_DELTAS, conf_of
from tests.support.standard_dh import exactly
from tests.support.sweeps import sweep

yaml = pytest.importorskip("yaml")

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
HALF = math.pi / 2


def stock_yaml(model: str) -> str:
    """Text of ur_description's default_kinematics.yaml: the nominal origins, metres and radians."""
    a2, a3, d1, d4, d5, d6 = MODELS[model]
    blocks = {
        "shoulder": (0, 0, d1, 0, 0, 0),
        "upper_arm": (0, 0, 0, HALF, 0, 0),
        "forearm": (a2, 0, 0, 0, 0, 0),
        "wrist_1": (a3, 0, d4, 0, 0, 0),
        "wrist_2": (0, -d5, 0, HALF, 0, 0),
        "wrist_3": (0, d6, 0, HALF, math.pi, math.pi),
    }
    lines = ["kinematics:"]
    for name, values in blocks.items():
        lines.append(f"  {name}:")
        lines += [
            f"    {key}: {value!r}" for key, value in zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True)
        ]
    return "\n".join([*lines, "  hash: calib_12788084448423163542", ""])


def origin(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()  # about fixed axes, as URDF has it
    out[:3, 3] = 1e3 * np.array(xyz)
    return out


def described(text: str, q: np.ndarray) -> np.ndarray:
    """Transforms (N, 7, 4, 4) at q (N, 6): base_link_T_link of six links, and the controller's base_T_tool0."""
    blocks = yaml.safe_load(text)["kinematics"]
    at, out = origin((0, 0, 0), (0, 0, math.pi)), []  # base_link -> base_link_inertia
    for name, values in zip(LINKS, q.T, strict=True):
        b, turned = blocks[name], np.tile(np.eye(4), (len(q), 1, 1))
        turned[:, :3, :3] = Rotation.from_euler("z", values[:, None]).as_matrix()
        at = at @ origin((b["x"], b["y"], b["z"]), (b["roll"], b["pitch"], b["yaw"])) @ turned
        out.append(at)
    tool0 = at @ origin((0, 0, 0), (0, -HALF, -HALF)) @ origin((0, 0, 0), (HALF, 0, HALF))
    base = origin((0, 0, 0), (0, 0, math.pi))  # base_link -> base, the controller's frame
    return np.stack([*out, np.linalg.inv(base) @ tool0], axis=1)


def controllers(model: str, deltas: dict[str, list[float]], q: np.ndarray) -> np.ndarray:
    """Transforms base_T_flange (N, 4, 4) by the controller's table, in extended precision, as d may be a kilometre."""
    added = np.column_stack([deltas[f"delta_{key}"] for key in ("theta", "a", "d", "alpha")])
    return np.array([exactly(nominal_rows(model) + added * [1, 1e3, 1e3, 1], values) for values in q])


def drawn(rng: np.random.Generator, *, mm: float = 0.4, mrad: float = 1.1) -> dict[str, list[float]]:
    """Random corrections of realistic size; the controller's last row has no a and no alpha."""
    out = {f"delta_{key}": rng.uniform(-1e-3 * mrad, 1e-3 * mrad, 6) for key in ("theta", "alpha")}
    out |= {f"delta_{key}": rng.uniform(-1e-3 * mm, 1e-3 * mm, 6) for key in ("a", "d")}
    out["delta_a"][5] = out["delta_alpha"][5] = 0.0
    return {key: values.tolist() for key, values in out.items()}


def converted(tmp_path: Path, model: str, deltas: dict[str, list[float]]) -> str:
    conf, template, out = tmp_path / "calibration.conf", tmp_path / "stock.yaml", tmp_path / "out.yaml"
    conf.write_text(conf_of(deltas))
    template.write_text(stock_yaml(model))
    command = ["convert", str(conf), str(out), "--model", model, "--template", str(template), "--force"]
    assert main(command) == 0
    return out.read_text()


def compared(text: str, model: str, deltas: dict[str, list[float]]) -> tuple[float, float, float, float]:
    """Largest errors of the flange, and shifts of a link from its nominal place, mm and rad, over 200 poses."""
    q = np.random.default_rng(1).uniform(-math.pi, math.pi, (200, 6))
    links, true, nominal = described(text, q), controllers(model, deltas, q), described(stock_yaml(model), q)
    flange = np.linalg.norm(links[:, 6, :3, 3] - true[:, :3, 3], axis=-1).max()
    attitude = np.abs(links[:, 6, :3, :3] - true[:, :3, :3]).max()
    place = np.linalg.norm(links[:, :6, :3, 3] - nominal[:, :6, :3, 3], axis=-1).max()
    trace = np.einsum("nkij,nkij->nk", links[:, :6, :3, :3], nominal[:, :6, :3, :3])
    turn = np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)).max()
    return float(flange), float(attitude), float(place), float(turn)


@pytest.mark.slow
@pytest.mark.parametrize("model", sweep(MODELS, every_run=["ur3", "ur10", "ur5e", "ur16e"]))
def test_a_calibration_keeps_the_flange_and_the_links_near_their_places(
    tmp_path: Path, model: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in range(5):
        deltas = drawn(np.random.default_rng(seed))
        text = converted(tmp_path, model, deltas)
        flange, attitude, place, turn = compared(text, model, deltas)
        assert flange < 1e-6
        assert attitude < 1e-9
        assert place < 6.0
        assert math.degrees(turn) < 0.5  # six angles of a milliradian add up along the arm
        blocks, stock = (yaml.safe_load(t)["kinematics"] for t in (text, stock_yaml(model)))
        for name in LINKS:
            mine, theirs = blocks[name], stock[name]
            assert max(abs(mine[key] - theirs[key]) for key in "xyz") < 2e-3
            both = (Rotation.from_euler("xyz", [b[key] for key in ("roll", "pitch", "yaw")]) for b in (mine, theirs))
            assert (next(both).inv() * next(both)).magnitude() < math.radians(0.2)
        assert "calib_12788084448423163542" in text
    assert "not on the axis" not in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("deltas", [DELTAS, *FAR_DELTAS], ids=["small", "far", "farther"])
def test_a_published_calibration_with_lengths_of_metres_has_its_links_near_their_places(
    tmp_path: Path, deltas: dict[str, list[float]]
) -> None:
    flange, attitude, place, turn = compared(converted(tmp_path, "ur10", deltas), "ur10", deltas)
    assert flange < 1e-6
    assert attitude < 1e-9
    assert place < 15.0
    assert math.degrees(turn) < 1.5


def test_what_a_kinematics_file_cannot_hold_of_the_flange_is_told_with_its_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    deltas = drawn(np.random.default_rng(0))
    deltas["delta_a"][5], deltas["delta_alpha"][5] = 0.0003, 0.001
    text = converted(tmp_path, "ur10e", deltas)
    said = capsys.readouterr().out
    assert "0.3 mm and 0.0573 deg off" in said
    flange, *_ = compared(text, "ur10e", deltas)
    assert flange == pytest.approx(0.3, abs=1e-6)
