"""What is said of the tool's row, against moving the nominal arm's points by each parameter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import redundancy
from calib.dataset.files.folder import load_dataset
from calib.identifiability.tool_rows import rows_of_tool, tool_rows
from calib.kinematics.chain import forward
from calib.kinematics.robot import Tool
from calib.present.fit.redundancy import tool_sentence
from calib.rendering.blocks import plain

SAMPLE = Path(__file__).parents[2] / "sample_data" / "hidden_effect_a"


@pytest.mark.parametrize(
    "tool", [Tool(d_mm=150.0), Tool(a_mm=80.0, d_mm=150.0), Tool(a_mm=80.0, d_mm=60.0, alpha_rad=0.4)]
)
def test_what_moves_no_point_is_said_to_be_unseen(tool: Tool) -> None:
    dataset = load_dataset(SAMPLE)
    robot = replace(dataset.robot, tool=tool)
    dataset = replace(dataset, robot=robot)
    q = dataset.poses.q
    moved = []
    for column in range(5):
        table = robot.table
        table[-1, column] += 1e-3
        places = [
            forward(of, q, robot.is_revolute, robot.base_T_first).base_T_frame[:, -1, :3, 3]
            for of in (robot.table, table)
        ]
        moved.append(np.abs(places[1] - places[0]).max() > 1e-9)
    found = tool_rows(dataset)
    kinds = ("aTCP", "alphaTCP", "dTCP", "thetaTCP", "betaTCP")
    assert set(found.unseen) == {name for name, moves in zip(kinds, moved, strict=True) if not moves}
    assert set(found.unseen) | set(found.known) | set(found.sums) == set(kinds)
    assert "d6" in found.sums["dTCP"]  # along one axis
    assert "not known, as a point has" in plain(tool_sentence(found))


def test_a_parameter_that_nothing_replaces_is_known_alone() -> None:
    dataset = load_dataset(SAMPLE)
    found = redundancy(dataset)
    alone = replace(found, groups=(), mixed_groups=(), combinations=(), no_influence=())
    assert len(rows_of_tool(alone, "position").known) == 5
