"""What is added is paid by what is taken away: no part has more tokens than pyproject.toml allows, nor much fewer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.copies import ROOT
from tests.support.tokens import budget, counted, part_of, tokens_of

SLACK = 2_000  # tokens of a part that may be free; what is taken away beyond lowers the budget


@pytest.mark.slow
def test_no_part_is_above_its_budget_and_none_has_room_to_fill_up() -> None:
    allowed, now = budget(), counted()
    assert now.keys() == allowed.keys()
    above = {part: f"{count:,} of {allowed[part]:,}" for part, count in now.items() if count > allowed[part]}
    assert above == {}, "take away as much as was added; the budget is not raised"
    if (ROOT / "calib" / "extras").is_dir():
        slack = {part: count for part, count in now.items() if allowed[part] - count > SLACK}
        assert slack == {}, "lower [tool.budget] in pyproject.toml to these figures: what was taken away stays away"


def test_tokens_are_what_a_reader_meets(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    function = 'def f(x):\n    """Doc\n    string."""\n    return (\n        x + "text"\n    )\n'
    path.write_text(f'"""A module."""\n\n# a comment\n{function}')
    assert tokens_of(path) == len(["def", "f", "(", "x", ")", ":", "return", "(", "x", "+", '"text"', ")"])


def test_a_file_counts_in_one_part() -> None:
    names = (
        "calib/frames.py",
        "calib/extras/watch/plugin.py",
        "inspector/extras/mcp/plugin.py",
        "tests/extras/a.py",
        "docs/conf.py",
    )
    assert [part_of(Path(name)) for name in names] == ["core", "extras", "extras", "tests", ""]
