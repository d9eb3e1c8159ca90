"""Figure of a fleet."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.extras.fleet.result import Fleet
from calib.extras.fleet.row import Rmse
from inspector import figures
from tests.extras.fleet.rows import row
from tests.support.figures import named, stands_alone


def test_the_errors_of_a_fleet() -> None:
    rows = tuple(row(f"arm{k}", test=Rmse(3.0, 0.5, 0.1 * k)) for k in (2, 1))
    fleet = Fleet(Path(), rows, (), (), (), 0, 1.0)
    last = named(figures.fleet_errors(fleet), "with all that was found")
    assert list(zip(last.customdata, last.y, strict=True)) == [("arm1", 0.1), ("arm2", pytest.approx(0.2))]
    stands_alone(figures.fleet_errors(fleet), "mm")
