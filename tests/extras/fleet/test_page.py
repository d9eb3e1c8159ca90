"""The page of this extra says what the code has."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.extras.fleet import shared_causes

PAGE = Path(__file__).parents[3] / "docs" / "extras" / "fleet.md"
SAID = [
    f"If {shared_causes.FEWEST} arms or more",
    f"{shared_causes.PERMUTATIONS} permutations",
    f"with a weight of {shared_causes.SINCE_WEIGHT:g}",
    f"probability of {shared_causes.LIKELY:g} or more",
    f"below {shared_causes.LEVEL:g} a group is reported",
]


@pytest.mark.parametrize("said", SAID, ids=lambda said: said[:40])
def test_the_page_has_the_codes_constant(said: str) -> None:
    assert " ".join(said.split()) in " ".join(PAGE.read_text(encoding="utf-8").split())
