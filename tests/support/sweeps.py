"""Parametrised sweeps of which each run takes a few cases and the thorough run all."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sweep(cases: Iterable[Any], every_run: Collection[Any]) -> list[Any]:
    """Parameters for `parametrize`: the cases in `every_run` as they are, the others marked as thorough.

    A case is a value, or a tuple of values where several parameters are set at once.
    """
    cases = list(cases)
    assert all(case in cases for case in every_run), f"not among the cases: {[c for c in every_run if c not in cases]}"
    return [case if case in every_run else _thorough(case) for case in cases]


def _thorough(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.thorough)
