"""Caches for lookups that viser repeats for every request."""

from __future__ import annotations

import contextlib
import functools
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import get_type_hints

from viser import _assignable_props_api, _icons

_type_hints = functools.cache(get_type_hints)


@functools.cache
def _opened(path: Path) -> contextlib.AbstractContextManager[zipfile.ZipFile]:
    """Zip file that stays open between lookups."""
    return contextlib.nullcontext(zipfile.ZipFile(path))


def cache_lookups() -> None:
    """Add caches to the functions of viser that take noticeable time.

    It works out the types of a kind of node for every node (a sixth of a turn of the page), and reads the directory of
    its four thousand icons for every icon (more than half a second of the start).
    """
    _assignable_props_api.get_type_hints = _type_hints  # type: ignore[assignment]
    _icons.zipfile = SimpleNamespace(ZipFile=_opened)  # type: ignore[assignment]
