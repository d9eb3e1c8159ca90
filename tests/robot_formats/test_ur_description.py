"""A controller's calibration in a stock ROS description: links near their places, the flange as the controller has it.

The description is written by hand as the ROS xacro does it: base, base_link_inertia turned by half a turn, six joints
about z at the origins of the YAML, the flange and tool0 on wrist_3. The controller's law is standard Denavit-Hartenberg
with theta = q + delta_theta, d, a and alpha of nominal table and deltas.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from calib.robot_formats.robot_file import Reading, read_robot
from calib.robot_formats.ur_calibration import MODELS, nominal_rows
from inspector.cli.parser import main
from tests.support.robot_texts import DELTAS, FAR_DELTAS, conf_of

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
HALF = math.pi / 2


def stock_yaml(model: str) -> str:
    """default_kinematics.yaml of ur_description: the nominal origins, metres and radians."""
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
            f"    {key}: {value!r}"
            for key, value in zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True)
        ]
    return "\n".join([*lines, "  hash: calib_12788084448423163542", ""])


def origin(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()  # about fixed axes, as URDF has it
    out[:3, 3] = 1e3 * np.array(xyz)
    return out


def described(text: str, q: np.ndarray) -> np.ndarray:
    """(7, 4, 4) base_T_link of the six links and of the flange that the controller reports, of the ROS description."""
    blocks = yaml.safe_load(text)["kinematics"]
    at, out = origin((0, 0, 0), (0, 0, math.pi)), []  # base_link -> base_link_inertia
    for name, value in zip(LINKS, q, strict=True):
        b = blocks[name]
        at = at @ origin((b["x"], b["y"], b["z"]), (b["roll"], b["pitch"], b["yaw"])) @ turned(value)
        out.append(at)
    flange = at @ origin((0, 0, 0), (0, -HALF, -HALF))
    tool0 = flange @ origin((0, 0, 0), (HALF, 0, HALF))
    base = origin((0, 0, 0), (0, 0, math.pi))  # base_link -> base, the controller's frame
    return np.array([*out, np.linalg.inv(base) @ tool0])


def turned(q: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", q).as_matrix()
    return out


def controllers(model: str, deltas: dict[str, list[float]], q: np.ndarray) -> np.ndarray:
    """(4, 4) base_T_flange by the controller's law; extended precision, as d may be of a kilometre."""
    out = np.eye(4, dtype=np.longdouble)
    added = np.column_stack([deltas[f"delta_{key}"] for key in ("theta", "a", "d", "alpha")]) * [
        1,
        1e3,
        1e3,
        1,
    ]
    for (theta, a, d, alpha), value in zip(
        (nominal_rows(model) + added).astype(np.longdouble), q, strict=True
    ):
        c, s, ca, sa = np.cos(theta + value), np.sin(theta + value), np.cos(alpha), np.sin(alpha)
        row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        out = out @ np.array(row, dtype=np.longdouble)
    return out.astype(float)


def drawn(rng: np.random.Generator, *, mm: float = 0.4, mrad: float = 1.1) -> dict[str, list[float]]:
    """Deltas of a real size; the controller's last row has no a and no alpha of its own."""
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


def compared(
    text: str, model: str, deltas: dict[str, list[float]], count: int
) -> tuple[float, float, float, float]:
    """The most that the flange is off (mm, rad) and that a link's frame is off its nominal place (mm, rad)."""
    rng = np.random.default_rng(1)
    flange, attitude, place, turn = 0.0, 0.0, 0.0, 0.0
    for q in rng.uniform(-math.pi, math.pi, (count, 6)):
        links, true = described(text, q), controllers(model, deltas, q)
        nominal = described(stock_yaml(model), q)
        flange = max(flange, float(np.linalg.norm(links[6, :3, 3] - true[:3, 3])))
        attitude = max(attitude, float(np.abs(links[6, :3, :3] - true[:3, :3]).max()))
        for mine, theirs in zip(links[:6], nominal[:6], strict=True):
            place = max(place, float(np.linalg.norm(mine[:3, 3] - theirs[:3, 3])))
            cosine = (np.trace(mine[:3, :3].T @ theirs[:3, :3]) - 1.0) / 2.0
            turn = max(turn, math.acos(min(1.0, max(-1.0, cosine))))
    return flange, attitude, place, turn


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_a_calibration_keeps_the_flange_and_the_links_near_their_places(
    tmp_path: Path, model: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in range(5):
        deltas = drawn(np.random.default_rng(seed))
        text = converted(tmp_path, model, deltas)
        flange, attitude, place, turn = compared(text, model, deltas, 1000 if seed == 0 else 50)
        assert flange < 1e-6
        assert attitude < 1e-9
        assert place < 6.0
        assert math.degrees(turn) < 0.5  # six angles of a milliradian add up along the arm
        blocks, stock = (yaml.safe_load(t)["kinematics"] for t in (text, stock_yaml(model)))
        for name in LINKS:
            mine, theirs = blocks[name], stock[name]
            assert max(abs(mine[key] - theirs[key]) for key in "xyz") < 2e-3
            both = (
                Rotation.from_euler("xyz", [b[key] for key in ("roll", "pitch", "yaw")])
                for b in (mine, theirs)
            )
            assert (next(both).inv() * next(both)).magnitude() < math.radians(0.2)
        assert "calib_12788084448423163542" in text
    assert "not on the axis" not in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("deltas", [DELTAS, *FAR_DELTAS], ids=["small", "far", "farther"])
def test_a_published_calibration_with_lengths_of_metres_has_its_links_near_their_places(
    tmp_path: Path, deltas: dict[str, list[float]]
) -> None:
    flange, attitude, place, turn = compared(converted(tmp_path, "ur10", deltas), "ur10", deltas, 200)
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
    flange, *_ = compared(text, "ur10e", deltas, 100)
    assert flange == pytest.approx(0.3, abs=1e-6)


def test_the_table_of_a_calibration_has_small_angles(tmp_path: Path) -> None:
    for seed, model in enumerate(MODELS):
        path = tmp_path / "calibration.conf"
        path.write_text(conf_of(drawn(np.random.default_rng(seed))))
        table = read_robot(path, Reading(model=model)).robot.table
        assert np.degrees(np.abs(table[:, [3, 4]]).max()) < 0.5
