"""What is told of connections that go wrong: nothing of strangers who speak no HTTP, a line of everything else.

A port scan opens connections and sends nothing, a TLS greeting or rubbish; websockets logs each with its traceback.
"""

from __future__ import annotations

import logging

from websockets.exceptions import ConnectionClosed, InvalidHandshake, SecurityError

from calib.errors import shown

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
