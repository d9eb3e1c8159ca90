"""`calib.watch`, as a notebook uses it."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

import calib
from calib.extras.watch.watch import watch

ROOT = Path(__file__).parents[3]


def test_the_public_name_and_its_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert getattr(calib, "watch") is watch  # noqa: B009  # of a plug-in, which type checkers do not see
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    for test in doctest.DocTestFinder(recurse=False).find(watch, "watch", globs={}):
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
    assert runner.tries
    report = watch(ROOT / "sample_data" / "hidden_effect_a", ROOT / "sample_data" / "hidden_effect_a")
    assert len(repr(report)) < 300
    assert "\n" not in repr(report)
