"""The page of this extra says what the code has."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.extras.watch import change_tests, misfit

PAGE = Path(__file__).parents[3] / "docs" / "extras" / "watch.md"
SAID = [
    f"multiplied by $f$, from {misfit.PROVEN_INFLATION:g} on",
    f"by more than {misfit.PROVEN_GAIN:g};",
    rf"$\tau \ge {misfit.PROVEN_TAILS:g}$",
    f"$g - {change_tests.PER_PARAMETER:g} K + 2 \\log w$",
    f"{change_tests.UNUSUAL_WEIGHT:g} for lengths, angles and compliances",
    f"An alarm is below {change_tests.ALARM:g};",
    f"a change of the arm is named below {change_tests.NAMED:g} where",
    f"else below {change_tests.NAMED_GIVEN_OTHERS:g}",
]


@pytest.mark.parametrize("said", SAID, ids=lambda said: said[:40])
def test_the_page_has_the_codes_constant(said: str) -> None:
    assert " ".join(said.split()) in " ".join(PAGE.read_text(encoding="utf-8").split())
