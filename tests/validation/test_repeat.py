"""Causes that come back in recordings of one arm, made by an engine that shares no code with calib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib import repeat
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.errors import CalibError, FitError
from calib.validation.repeat import Recurrence
from tests.support.engine.cases import robot_of
from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell, draw_cell
from tests.support.paired_cell import ARMS, compliance

KEYS = {"cause", "joint", "in", "values", "sigmas", "agree"}


def recording(
    cell: Cell, causes: Sequence[tuple[Cause, float]], name: str, seed: int, *, masses: bool = True
) -> Dataset:
    """A noisy point at each pose of a cell."""
    n = cell.poses
    role = np.full(n, "train", dtype="<U9")
    role[0] = "reference"
    ids = tuple(f"p{k + 1:02d}" for k in range(n))
    poses = Poses(ids, role, cell.q, np.full(n, ""), tuple(f"{one}.ply" for one in ids))
    xyz_mm = cell.reported(causes)["jig"] + 0.05 * np.random.default_rng(seed).standard_normal((n, 3))
    points = Points(np.arange(n), xyz_mm, np.full(n, "jig"))
    return Dataset(name, robot_of(cell, masses=masses), poses, points, scanner=Scanner(point_sigma_mm=0.05))


def cells(arm: str = "UR10e", count: int = 2) -> list[Cell]:
    """Cells of one arm: other poses and another scanner each time, the same errors of lengths and angles."""
    drawn = [draw_cell(ARMS[arm], np.random.default_rng([seed, 4]), poses=30, payload=False) for seed in range(count)]
    return [replace(cell, rows=drawn[0].rows) for cell in drawn]


@pytest.fixture(scope="module")
def soft() -> Recurrence:
    """Two recordings of an arm whose joint 2 yields by 2e-5 rad/Nm."""
    cause = compliance(1).cause
    return repeat([recording(cell, [(cause, 20.0)], f"run{k}", k) for k, cell in enumerate(cells())])


def test_a_cause_comes_back_with_its_value(soft: Recurrence) -> None:
    assert soft.verdict == "repeats"
    (back,) = (cause for cause in soft.causes if cause.comes_back)
    assert (back.cause, back.joint, back.found_in) == ("joint_compliance", 2, ("run0", "run1"))
    for value, sigma in zip(back.values, back.sigmas, strict=True):
        assert abs(value - 2e-5) < 4.0 * sigma < 1e-5


def test_what_comes_back_is_told(soft: Recurrence) -> None:
    told = soft.to_dict()
    assert told["verdict"] == "repeats"
    assert all(set(cause) >= KEYS for cause in told["causes"])
    assert soft.headline == "Comes back in 2 of 2 recordings: joint_compliance."
    assert "run0 and run1" in soft.summary()


def test_a_cause_of_one_recording_alone_does_not_come_back() -> None:
    """The joint was mended in between: both recordings together call for what the second has nothing of."""
    one, other = cells()
    cause = compliance(1).cause
    found = repeat([recording(one, [(cause, 20.0)], "before", 0), recording(other, [], "after", 1)])
    assert found.verdict == "differs"
    assert not any(cause.comes_back for cause in found.causes)
    assert ("contradicts", "contradicts") in [cause.says for cause in found.causes]
    assert "joint_compliance" in found.headline


def test_a_class_that_each_recording_leaves_open_comes_back() -> None:
    """Without masses nothing tells a joint that yields from a link that bends, in one recording or in two."""
    cause = [(compliance(1).cause, 20.0)]
    found = repeat([recording(cell, cause, f"run{k}", k, masses=False) for k, cell in enumerate(cells())])
    assert found.verdict == "repeats", found.summary()
    back = next(one for one in found.causes if one.comes_back)
    assert {"joint_compliance", "link_bending", "base_compliance"} <= {back.cause, *back.alike}
    assert back.named_alone == ("run0", "run1")
    assert "contradicts" not in back.says


@pytest.mark.thorough
def test_recordings_that_show_nothing_say_too_little() -> None:
    found = repeat([recording(cell, [], f"run{k}", k) for k, cell in enumerate(cells())])
    assert found.verdict == "too little data"


def test_one_recording_and_other_arms_are_refused() -> None:
    (cell,) = cells(count=1)
    with pytest.raises(CalibError, match="two or more"):
        repeat([recording(cell, [], "alone", 0)])
    (panda,) = cells("Panda", 1)
    with pytest.raises(FitError, match="another arm"):
        repeat([recording(cell, [], "one", 0), recording(panda, [], "other", 0)])
