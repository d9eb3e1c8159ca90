"""The pages of the method have the same parts, and name modules that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support import ROOT

METHOD = ROOT / "docs" / "method"


@pytest.mark.parametrize("page", sorted(METHOD.glob("*.md")), ids=lambda page: page.stem)
def test_modules_that_a_page_names_are_there(page: Path):
    """A name without a folder is in the folder that was named last, or below it."""
    folder = Path()
    for name in re.findall(r"`([\w./]+(?:\.py|/))`", page.read_text(encoding="utf-8")):
        named = name.startswith(("calib/", "inspector/", "benchmarks/", "tests/"))
        if named:
            assert (ROOT / name).exists(), name
            folder = (ROOT / name).parent if name.endswith(".py") else ROOT / name
        else:
            assert (folder / name).exists() or (ROOT / "benchmarks" / name).exists(), f"{name} in {folder}"


def test_every_page_has_its_parts():
    for page in METHOD.glob("*.md"):
        if page.stem in ("index", "glossary", "references"):
            continue
        text = page.read_text(encoding="utf-8")
        assert "$$" in text, page
        for part in ("## In the code", "## What was measured", "## Limits"):
            assert part in text, (page, part)
