"""Logging of failed connections: none for clients that speak no HTTP, one line each for all others, bounded in rate.

A port scan opens connections and sends nothing, a TLS greeting or rubbish; websockets logs each with its traceback.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import threading
import time
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidHandshake, SecurityError

from calib.errors import printable

_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_TELL_EVERY_S = 60.0
_MOST_LINES = 60  # in that time
_STRANGERS = (InvalidHandshake, SecurityError, ConnectionClosed, EOFError, ConnectionError, TimeoutError)


class _InOneLine(logging.Filter):
    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, _STRANGERS):
            return False
        if error is not None:
            said = " ".join(f"{record.getMessage()}: {type(error).__name__}: {error}".split())
            record.msg, record.args = printable(said), None
            record.exc_info = record.exc_text = None
        return True


class _Bounded(logging.Filter):
    """Log filter that passes a limited number of lines a minute, then one line with the number of suppressed ones."""

    def __init__(self) -> None:
        super().__init__()
        self._since_s = -_TELL_EVERY_S
        self._told = self._left_out = 0
        self._lock = threading.Lock()

    def filter(self, record: logging.LogRecord) -> bool:
        with self._lock:
            now_s = time.monotonic()
            if now_s - self._since_s >= _TELL_EVERY_S:
                self._since_s, self._told = now_s, 0
            self._told += 1
            if self._told > _MOST_LINES:
                self._left_out += 1
                return False
            words, self._left_out = self._left_out, 0
        record.msg, record.args = printable(record.getMessage()), None
        if words:
            record.msg += f" (before it {words} lines like this were left out)"
        return True


_BOUND = _Bounded()


def bounded_logger(name: str) -> logging.Logger:
    """Logger for events that clients can cause; all such loggers share `_MOST_LINES` lines a minute."""
    logger = logging.getLogger(name)
    if _BOUND not in logger.filters:
        logger.addFilter(_BOUND)
    return logger


def connection_logger() -> logging.Logger:
    """Logger for websockets' `serve`."""
    name = "inspector.server.connections"
    logger = logging.getLogger(name)
    if not logger.filters:
        logger.addFilter(_InOneLine())  # first: what it lets go does not count
    return bounded_logger(name)


class ConnectionWarning:
    """Exception handler of an event loop that logs "too many open connections" once a minute at most.

    asyncio tells of each that it cannot accept, with a traceback, a hundred at a time: megabytes in seconds. It tries
    again after a second by itself, and whoever is connected is served on.
    """

    def __init__(self) -> None:
        self._told_s = -_TELL_EVERY_S

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if not (isinstance(error, OSError) and error.errno in _NO_ROOM and "socket" in context):
            loop.default_exception_handler(context)
            return
        if time.monotonic() - self._told_s >= _TELL_EVERY_S:
            self._told_s = time.monotonic()
            connection_logger().warning(
                "more connections at a time than this process may have open files (%s); further ones wait",
                error.strerror,
            )
