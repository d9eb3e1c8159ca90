"""Causes that arms share, and what chance alone makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from calib.extras.fleet.present.fleets import cause_phrase
from calib.extras.fleet.row import EffectSize, Row
from calib.extras.fleet.shared_causes import _ranges, shared_causes
from tests.extras.fleet.rows import row


def fleet(bad: set[int], count: int = 40, **of_bad: str) -> list[Row]:
    """Arms A-1, A-2 ... of two sites in turn; the bad ones have a cause at joint 3."""
    return [
        row(f"d{k}", joint=3 if k in bad else None, serial=f"A-{k}", site="Ulm" if k % 2 else "Busan",
            about=of_bad if k in bad else {})
        for k in range(1, count + 1)
    ]  # fmt: skip


def test_a_batch_of_bad_gears_is_told_by_its_numbers() -> None:
    (cause,) = shared_causes(fleet(set(range(11, 19))))
    assert (cause.effect, cause.joint, cause.of, len(cause.arms)) == ("joint_compliance", 3, 40, 8)
    (group,) = cause.groups
    assert (group.what, group.value) == ("serial numbers", "A-11 to A-18")
    assert (group.inside, group.outside) == ((8, 8), (0, 32))
    assert group.p_value < 0.01
    assert "8 of 8 with serial numbers A-11 to A-18, 0 of 32 others" in cause_phrase(cause)


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


def test_a_cause_in_all_five_arms_since_a_number_stands_out_among_ten() -> None:
    (cause,) = shared_causes(fleet({6, 7, 8, 9, 10}, 10))
    group = cause.groups[0]
    assert (group.what, group.value, group.inside, group.outside) == ("serial numbers since", "A-6", (5, 5), (0, 5))
    assert group.p_value == pytest.approx(3 * 3 / 252)  # one of 252 ways, of three tests, corrected for three groups
    assert "5 of 5 with serial numbers since A-6" in cause_phrase(cause)


def test_an_arm_whose_cause_is_suspected_counts_by_its_probability_and_all_its_dates() -> None:
    rows = fleet({6, 7, 8, 9, 10}, 10)

    def suspected(of: Row, p: float) -> Row:
        return replace(of, missing=(), suspected=("joint_compliance",), likely={"joint_compliance": p})

    some = [suspected(r, 0.7) if r.serial in ("A-7", "A-9") else r for r in rows]
    (cause,) = shared_causes(some)
    assert len(cause.arms) == 5
    assert cause.groups[0].value == "A-6"
    unlikely = [suspected(r, 0.3) if r.serial in ("A-7", "A-9") else r for r in rows]
    assert len(shared_causes(unlikely)[0].arms) == 3
    dated = [replace(r, path=f"{r.path}/{k}", date=f"2026-0{k}-01") for r in rows for k in (1, 2, 3)]
    once = [suspected(r, 0.1) if r.date == "2026-03-01" and r.serial == "A-7" else r for r in dated]
    assert len(shared_causes(once)[0].arms) == 5  # twice claimed, once not


def test_a_day_is_never_split_and_the_test_is_that_of_all_ways_to_deal_out_the_cause() -> None:
    dates = ["2026-01-01"] * 3 + ["2026-02-01"] * 3 + ["2026-03-01"] + ["2026-04-01"] * 5
    rows = [
        row(f"d{k}", joint=3 if k in (2, *range(5, 12)) else None, date=date) for k, date in enumerate(dates)
    ]  # fmt: skip
    (group,) = _ranges(rows, np.array([bool(each.sizes) for each in rows]))
    assert (group.what, group.value, group.inside) == ("dates since", "2026-03-01", (6, 6))

    def shares(with_it: Sequence[int]) -> tuple[float, float]:
        has = np.isin(range(12), with_it)
        lead = [has[:k].sum() / 8 - (~has)[:k].sum() / 4 for k in (0, 3, 6, 7, 12)]
        return max(b - a for a, b in combinations(lead, 2)), -min(lead)

    ways = np.array([shares(way) for way in combinations(range(12), 8)])
    by_chance, since = np.mean(ways >= np.subtract(shares((2, *range(5, 12))), 1e-9), axis=0)
    assert (
        3.0 * since <= group.p_value <= 3.0 * by_chance
    )  # where days hold several, that since a day is an upper bound
