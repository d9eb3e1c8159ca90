"""One BLAS thread while a function of the method runs; the caller's setting comes back when it ends."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context, or a decorator, in which numpy and scipy multiply matrices on the calling thread alone.

    The matrices here are small: threads that wait for each other double a diagnosis' time, and a sum's last bit depends
    on their number. Nothing is left changed in the caller's process, its environment variables included.
    """
    with _controller().limit(limits=1):
        yield


@cache
def _controller() -> Any:
    """The controller of the BLAS libraries that numpy and scipy bring; both have to be loaded for it to find theirs."""
    import scipy.linalg  # noqa: F401

    before = dict(os.environ)
    from threadpoolctl import ThreadpoolController  # sets KMP_DUPLICATE_LIB_OK as it loads

    for name in set(os.environ) - set(before):
        del os.environ[name]
    return ThreadpoolController()
