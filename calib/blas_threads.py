"""Limit of numpy's and scipy's BLAS to one thread while a function of this library runs; restored when it ends."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context, or decorator, in which numpy and scipy multiply matrices on the calling thread alone.

    The matrices here are small: threads that wait for each other double the time of a diagnosis, and the last bit of a
    sum depends on their number. Nothing in the caller's process stays changed, its environment variables included.
    """
    with _controller().limit(limits=1):
        yield


@cache
def _controller() -> Any:
    """Controller of the BLAS libraries of numpy and scipy, which have to be loaded already."""
    import scipy.linalg  # noqa: F401

    before = dict(os.environ)
    from threadpoolctl import ThreadpoolController  # sets KMP_DUPLICATE_LIB_OK as it loads

    for name in set(os.environ) - set(before):
        del os.environ[name]
    return ThreadpoolController()
