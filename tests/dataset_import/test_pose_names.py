"""Names of one file against the poses of another: spelled otherwise, within longer ones, counted from 0."""

from __future__ import annotations

import pytest

from calib.dataset_import.pose_names import matched

COUNT = 10
POSES = [f"P{k}" for k in range(1, COUNT + 1)]
ROWS = [str(k) for k in range(1, COUNT + 1)]
IN_ORDER = list(range(COUNT))


def counted(form: str, start: int = 1, count: int = COUNT) -> list[str]:
    return [form.format(k) for k in range(start, start + count)]


@pytest.mark.parametrize(
    ("names", "poses", "found"),
    [
        (POSES[::-1], POSES, IN_ORDER[::-1]),
        (["NEST1", *counted("p {:03}")], POSES, [-1, *IN_ORDER]),
        (["NEST1", *counted("Pt_{:03}")], ROWS, [-1, *IN_ORDER]),
        (["P1 again", *POSES], POSES, [-1, *IN_ORDER]),
        (counted("Cell::Points::p{}"), POSES, IN_ORDER),
        ([f"{pose}_{k}" for pose in POSES for k in (1, 2)], POSES, [k for k in IN_ORDER for _ in "ab"]),
        (counted("2024-03-05_WP{:02}_a"), POSES, IN_ORDER),
        (counted("scan_{:03}", 3, 4), POSES, [2, 3, 4, 5]),
        (counted("cloud{}", 0), ROWS, IN_ORDER),
        (counted("{}", 0), ROWS, IN_ORDER),
        (counted("cloud{}", 0, 9), ROWS, [-1] * 9),  # one too few: the first or the last pose has none
        (counted("IMG_{}", 7000), POSES, [-1] * COUNT),
    ],
)
def test_the_pose_of_a_name(names: list[str], poses: list[str], found: list[int]) -> None:
    assert list(matched(names, poses).pose) == found


def test_what_differs_is_told() -> None:
    assert matched(POSES, POSES).how == ""
    assert "scan_000 as P1" in matched(counted("scan_{:03}", 0), POSES).how
