"""What is told of connections that go wrong: nothing of strangers who speak no HTTP, a line of everything else.

A port scan opens connections and sends nothing, a TLS greeting or rubbish; websockets logs each with its traceback.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import time
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidHandshake, SecurityError

from calib.errors import shown

_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_TELL_EVERY_S = 60.0
_STRANGERS = (InvalidHandshake, SecurityError, ConnectionClosed, EOFError, ConnectionError, TimeoutError)


class _InOneLine(logging.Filter):
    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, _STRANGERS):
            return False
        if error is not None:
            said = " ".join(f"{record.getMessage()}: {type(error).__name__}: {error}".split())
            record.msg, record.args = shown(said), None
            record.exc_info = record.exc_text = None
        return True


def connection_logger() -> logging.Logger:
    """The logger to give to websockets' `serve`."""
    logger = logging.getLogger("inspector.server.connections")
    if not logger.filters:
        logger.addFilter(_InOneLine())
    return logger


class CrowdTold:
    """A loop's exception handler: a crowd of connections, more than there may be files, is a line a minute.

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
