"""Causes that arms share, and what chance alone makes of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from calib.extras.fleet.present.fleets import cause_phrase
from calib.extras.fleet.row import EffectSize, Row
from calib.extras.fleet.shared_causes import shared_causes
from tests.extras.fleet.rows import row


def fleet(bad: set[int], count: int = 40, **of_bad: str) -> list[Row]:
    """Arms A-1, A-2 ... of two sites in turn; the bad ones have a cause at joint 3."""
    return [
        row(f"d{k}", joint=3 if k in bad else None, serial=f"A-{k}", site="Ulm" if k % 2 else "Busan",
            about=of_bad if k in bad else {})
        for k in range(1, count + 1)
    ]  # fmt: skip


def test_a_site_with_bad_arms_stands_out() -> None:
    (cause,) = shared_causes(fleet(set(range(1, 16, 2))))
    assert (cause.effect, cause.joint, cause.of, len(cause.arms)) == ("joint_compliance", 3, 40, 8)
    (group,) = cause.groups
    assert (group.what, group.value, group.inside, group.outside) == ("site", "Ulm", (8, 20), (0, 20))
    assert group.p_value == pytest.approx(2 * math.comb(20, 8) / math.comb(40, 8))  # Fisher's, of two sites
    assert "8 of 20 with site Ulm, 0 of 20 others" in cause_phrase(cause)


def test_a_batch_is_told_by_a_key_of_about_where_its_arms_are_scattered() -> None:
    bad = {2, 9, 16, 25, 30, 39}
    arms = [
        replace(r, about={"gear": "lot 17" if k in bad | {20} else f"lot {k % 3}"})
        for k, r in enumerate(fleet(bad), start=1)
    ]
    (cause,) = shared_causes(arms)
    (group,) = cause.groups
    assert (group.what, group.value, group.inside, group.outside) == ("gear", "lot 17", (6, 7), (0, 33))


def test_an_arm_counts_once_by_its_last_dataset_and_minor_joints_do_not_count() -> None:
    minor = EffectSize("joint_compliance", 5, "joint_compliance.J5.k_rad_per_nm", 1e-6, 1e-7, "rad/Nm", 0.05)
    rows = [replace(r, sizes=(*r.sizes, minor)) if r.sizes else r for r in fleet({1, 2, 3}, 12)]
    before = [replace(r, path=f"old/{r.path}", date="2025-01-01", missing=(), sizes=()) for r in rows]
    after = [replace(r, date="2026-01-01") for r in rows]
    (cause,) = shared_causes([*after, *before])
    assert (cause.joint, cause.arms, cause.of) == (3, ("A-1", "A-2", "A-3"), 12)


def test_chance_alone_is_told_as_a_group_about_as_rarely_as_promised() -> None:
    rng = np.random.default_rng(5)
    told = 0
    for _ in range(10):
        bad = set((1 + rng.permutation(30)[:8]).tolist())
        (cause,) = shared_causes(fleet(bad, 30))
        told += bool(cause.groups)
    assert told <= 1  # expected: 0.1


def test_an_arm_whose_cause_is_suspected_counts_by_its_probability_and_all_its_dates() -> None:
    rows = fleet({6, 7, 8, 9, 10}, 10)

    def suspected(of: Row, p: float) -> Row:
        return replace(of, missing=(), suspected=("joint_compliance",), likely={"joint_compliance": p})

    some = [suspected(r, 0.7) if r.serial in ("A-7", "A-9") else r for r in rows]
    (cause,) = shared_causes(some)
    assert len(cause.arms) == 5
    unlikely = [suspected(r, 0.3) if r.serial in ("A-7", "A-9") else r for r in rows]
    assert len(shared_causes(unlikely)[0].arms) == 3
    dated = [replace(r, path=f"{r.path}/{k}", date=f"2026-0{k}-01") for r in rows for k in (1, 2, 3)]
    once = [suspected(r, 0.1) if r.date == "2026-03-01" and r.serial == "A-7" else r for r in dated]
    assert len(shared_causes(once)[0].arms) == 5  # twice claimed, once not
