"""A UR controller's calibration.conf with a calibrated arm: the controller's own chain, elementary, meets it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from calib.extras.robot_forms.ur_calibration import chain_of_standard, nominal_rows, table_of_chain
from calib.robot_formats.robot_file import ReadOptions, read_robot
from calib.statistics import rms_length
from inspector.cli.parser import main
from tests.support.robot_texts import conf_of
from tests.support.standard_dh import exactly

MODEL = "ur10e"
TOOL_MM = np.array([12.0, -9.0, 110.0, 1.0])


def drawn(rng: np.random.Generator, mm: float, mrad: float) -> dict[str, list[float]]:
    sizes = {"theta": 1e-3 * mrad, "a": 1e-3 * mm, "d": 1e-3 * mm, "alpha": 1e-3 * mrad}
    out = {f"delta_{key}": (size * rng.normal(size=6)).tolist() for key, size in sizes.items()}
    out["delta_a"][5] = out["delta_alpha"][5] = 0.0
    return out


def rows_of(deltas: dict[str, list[float]]) -> np.ndarray:
    added = np.column_stack([deltas[f"delta_{key}"] for key in ("theta", "a", "d", "alpha")])
    return nominal_rows(MODEL) + added * [1, 1e3, 1e3, 1]


def test_a_table_comes_back_from_its_own_chain():
    rng = np.random.default_rng(0)
    for _ in range(20):
        rows = rows_of(drawn(rng, 0.5, 1.0))
        found = table_of_chain(chain_of_standard(rows, "arm"), nominal_rows(MODEL))
        q = rng.uniform(-3, 3, 6)
        assert exactly(found.rows, q) == pytest.approx(exactly(rows, q), abs=1e-6)
        assert found.lost_mm < 1e-6


def test_the_nominal_table_with_its_parallel_axes_comes_back_as_it_is():
    found = table_of_chain(chain_of_standard(nominal_rows(MODEL), "arm"), nominal_rows(MODEL))
    assert found.rows == pytest.approx(nominal_rows(MODEL), abs=1e-9)


@pytest.mark.slow
def test_a_calibrated_conf_predicts_what_the_true_controller_would(tmp_path: Path, capsys):
    rng = np.random.default_rng(5)
    factory = drawn(rng, 0.3, 0.6)
    wear = drawn(rng, 0.4, 0.8)
    truth = {key: (np.array(factory[key]) + wear[key]).tolist() for key in factory}
    truth["delta_theta"][0], truth["delta_d"][0] = factory["delta_theta"][0], factory["delta_d"][0]  # the base's own
    conf = tmp_path / "calibration.conf"
    conf.write_text("# kept\n" + conf_of(factory) + "\n[other]\ndelta_a = [1, 2]\n")
    q = rng.uniform(-2.5, 2.5, (90, 6))
    points = np.array([(exactly(rows_of(truth), one) @ TOOL_MM)[:3] for one in q]) + rng.normal(size=(90, 3)) * 0.01
    with (tmp_path / "joints.csv").open("w", newline="") as file:
        csv.writer(file).writerows([[*(f"q{k + 1}_rad" for k in range(6)), "x_mm", "y_mm", "z_mm"],
                                    *np.column_stack([q, points]).tolist()])  # fmt: skip
    cell, out = tmp_path / "cell", tmp_path / "new.conf"
    assert main(["import", str(cell), "--robot", str(conf), "--model", MODEL, "--joints", str(tmp_path / "joints.csv"),
                 "--sigma", "0.01"]) == 0  # fmt: skip
    assert main(["calibrate", str(cell), "--kinematics-out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "keep the one that it had" in said
    text = out.read_text()
    assert text.startswith("# kept\n")
    assert text.endswith("\n[other]\ndelta_a = [1, 2]\n")
    again = read_robot(out, ReadOptions(model=MODEL)).robot
    assert again.n_joints == 6
    new = {}
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        if key.startswith("delta_") and key not in new:
            new[key] = [float(word) for word in value.strip("[]").split(",")]
    test = rng.uniform(-2.5, 2.5, (200, 6))
    frames = [np.array([exactly(rows_of(deltas), one) for one in test]) for deltas in (truth, new, factory)]
    left, before = (misfit(frames[0] @ TOOL_MM, other) for other in frames[1:])
    assert before > 0.3
    assert left < 0.05


def misfit(true: np.ndarray, frames: np.ndarray) -> float:
    """RMS, mm, of a point fixed to the flange, at the place on it and in the frame that fit best."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    def error(x: np.ndarray) -> np.ndarray:
        placed = frames[:, :3, :3] @ (TOOL_MM[:3] + x[:3]) + frames[:, :3, 3]
        return (Rotation.from_rotvec(x[3:6]).apply(placed) + x[6:] - true[:, :3]).ravel()

    found = least_squares(error, np.zeros(9), x_scale=[1, 1, 1, 1e-3, 1e-3, 1e-3, 1, 1, 1])
    return rms_length(found.fun.reshape(-1, 3))
