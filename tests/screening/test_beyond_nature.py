"""A cause that would have to be larger than such causes are stands behind one that need not."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from calib import calibrate, screen
from calib.effects.catalogue.loads import JointCompliance
from calib.effects.effect import Family, NaturalBound
from calib.screening.candidates import DECADES_BEYOND
from tests.support.paired_cell import ARMS, compliance, draw_pairs, measured

SOFT = 5e-5  # rad/Nm


class NeverSoSoft(JointCompliance):
    """The same law, of which no more than a hundredth has been known."""

    name = "never_so_soft"
    bounds: ClassVar[tuple[NaturalBound, ...]] = (NaturalBound(0.01 * SOFT, "rad/Nm", "tests"),)


def test_sizes_beyond_nature_cost_evidence() -> None:
    rng = np.random.default_rng(0)
    made = measured(draw_pairs(ARMS["RB5"], rng, 50, (0.0,)), [(compliance(1).cause, 1e6 * SOFT)], rng)
    families = [Family(kind.name, (kind(1),)) for kind in (NeverSoSoft, JointCompliance)]
    natural, beyond = screen(calibrate(made), families).candidates
    assert (natural.name, beyond.name) == ("joint_compliance", "never_so_soft")
    cost = natural.log_evidence - beyond.log_evidence
    assert abs(cost - 0.5 * (2.0 / DECADES_BEYOND) ** 2) < 2.0
