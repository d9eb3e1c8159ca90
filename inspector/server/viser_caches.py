"""Caches of what viser looks up again and again."""

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
    """A zip file that stays open."""
    return contextlib.nullcontext(zipfile.ZipFile(path))


def cache_lookups() -> None:
    """Cache in viser what takes it noticeable time.

    It works out the types of a kind of node for every node (a sixth of a turn of the page), and reads the directory of
    its four thousand icons for every icon (more than half a second of the start).
    """
    _assignable_props_api.get_type_hints = _type_hints  # type: ignore[assignment]
    _icons.zipfile = SimpleNamespace(ZipFile=_opened)  # type: ignore[assignment]
