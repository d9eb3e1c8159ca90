"""The table of a sister type of Universal Robots' arms is told by its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.consistency.data_problem import suspicions
from calib.consistency.hypotheses import known_tables
from calib.simulation.simulate import simulate_dataset
from tests.support.sweeps import sweep

TABLES = dict(known_tables())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("true", "given"),
    sweep(
        [("UR5", "UR5e or UR7e"), ("UR5", "UR10"), ("UR16e", "UR10e or UR12e"), ("UR3e", "UR5e or UR7e")],
        every_run=[("UR5", "UR5e or UR7e"), ("UR16e", "UR10e or UR12e")],
    ),
)
def test_a_sister_types_table_is_told_by_its_name(true: str, given: str) -> None:
    data = simulate_dataset(TABLES[true], rng=np.random.default_rng(2), poses=40).dataset
    found = suspicions(calibrate(replace(data, robot=TABLES[given])), calibrate).problem
    assert found is not None
    assert found.kind == "robot_table"
    assert f"the links are those of a {true}, not those of robot.toml" in found.warning
    assert found.then_mm < 0.5 * found.now_mm
