"""Modules that load when something of them is first used: pandas takes half a second, and few commands make a table.

from calib.lazy_modules import pd, spatial
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from scipy import spatial
else:

    class _Lazy:
        """A module by name, imported when an attribute is asked for."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self._name), name)

    pd = _Lazy("pandas")
    spatial = _Lazy("scipy.spatial")

__all__ = ["is_frame", "pd", "spatial"]


def is_frame(value: object) -> bool:
    """Whether a value is a table of pandas; none is before pandas was loaded."""
    return "pandas" in sys.modules and isinstance(value, pd.DataFrame)
