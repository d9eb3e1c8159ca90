"""A watched cell whose arm carries the scanner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import effects_named
from calib.errors import CalibError
from calib.extras.watch.watch import watch
from calib.simulation.simulate import measure
from calib.simulation.truth.equilibrium import Truth
from tests.support.flange_mount import MADE, RB5


def _later(truth: Truth, seed: int) -> Dataset:
    rng = np.random.default_rng(seed)
    return measure(RB5, truth, MADE.dataset.poses, rng=rng, name="later", noise_mm=0.01).dataset


def test_a_jig_that_moved_is_told_from_the_arm_and_the_scanner() -> None:
    assert MADE.truth.base_T_jig is not None
    moved = MADE.truth.base_T_jig.copy()
    moved[:3, 3] += [0.0, 0.3, 0.2]
    first = calibrate(_later(MADE.truth, 5), effects=effects_named(MADE.dataset, ["joint_compliance"]))
    assert watch(first, _later(MADE.truth, 6)).verdict == "unchanged"
    later = _later(replace(MADE.truth, base_T_jig=moved), 7)
    seen = watch(first, later)
    assert [change.what for change in seen.changes] == ["jig"]
    assert seen.changes[0].size == pytest.approx(np.hypot(0.3, 0.2), rel=0.05)
    assert "jig (or the base) moved" in seen.headline
    with pytest.raises(CalibError, match="its scanner is in the room, that of later on the flange"):
        watch(first, replace(later, robot=replace(RB5, carries_scanner=False)))
