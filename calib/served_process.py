"""Work on a visitor's files in a process of its own with bounded memory and time, a copy of one that has the imports.

Whoever serves others does all that it does with their files by one call of `within_limits`: a sheet, mesh, photo or
TOML that asks for all memory, runs for ever or crashes its parser ends that process and becomes one line. The process
ends with the server, also when that is killed.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from calib.bounded_process import ProcessLimits, bound_this_process, how_it_ended
from calib.errors import CalibError

P = ParamSpec("P")
T = TypeVar("T")
Told = tuple[Any, Exception | None]

LIMITS = ProcessLimits(seconds=300.0, memory_bytes=3 * 1024**3, answer_bytes=1024**3)
"""What one request may take: photos of a board take a second each, and a GB."""
_IMPORTED = ("calib.dataset_import.import_dataset", "pandas", "scipy.spatial")


def within_limits(what: str, function: Callable[P, T], /, *args: P.args, **keywords: P.kwargs) -> T:
    """Result of a module's function, worked out in a bounded process.

    Arguments and result are copied by pickle. What the function raises is raised here. Raises CalibError, with `what`
    as the name of what was read, where the process gives no answer.
    """
    context = _context()
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(there, what, function, args, keywords), daemon=True)
    process.start()
    there.close()
    until = time.monotonic() + LIMITS.seconds
    try:
        content = here.recv_bytes() if here.poll(LIMITS.seconds) else b""
    except EOFError:
        content = b""
    finally:
        late = time.monotonic() > until
        process.join(0 if late else 1.0)  # for its exit code
        process.kill()
        process.join()
        here.close()
    if not content:
        code = -int(signal.SIGKILL) if late else process.exitcode or 0
        raise CalibError(f"{what}: {how_it_ended(code, LIMITS)}")
    result, error = pickle.loads(content)
    if error is not None:
        raise error
    return result


class BoundedExecutor(ThreadPoolExecutor):
    """Executor that works out each function in a bounded process of its own, so many at a time as it has threads."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Begin a function; in messages what it reads is called as the first path among its arguments."""
        what = next((argument.name for argument in args if isinstance(argument, Path)), "its files")
        return super().submit(within_limits, what, fn, *args, **kwargs)


def warm_up(*modules: str) -> None:
    """Start the process that bounded ones are copies of beside other work, with further modules that requests need."""
    context = _context()
    if context.get_start_method() == "forkserver":
        context.set_forkserver_preload([*_IMPORTED, *modules])
    threading.Thread(target=context.Process(target=int, daemon=True).start, daemon=True).start()


@cache
def _context() -> Any:
    """Processes that are copies of one with the imports; fresh ones where the system has no such."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*_IMPORTED])
    return context


def _answer(
    there: Connection, what: str, function: Callable[..., Any], args: tuple[Any, ...], keywords: dict[str, Any]
) -> None:
    """Body of the bounded process: send the pickled result and error."""
    threading.Thread(target=_end_with_server, daemon=True).start()
    bound_this_process(LIMITS)
    try:
        told: Told = function(*args, **keywords), None
    except MemoryError:
        told = None, CalibError(f"{what}: needs more than {LIMITS.memory_bytes // 1024**2} MB of memory")
    except Exception as error:
        told = None, error
    content = _copied(told)
    if len(content) > LIMITS.answer_bytes:
        content = _copied((None, CalibError(f"{what}: makes more than {LIMITS.answer_bytes // 1024**2} MB")))
    there.send_bytes(content)
    os._exit(0)  # its answer is all that is wanted of it


def _end_with_server() -> None:
    server = multiprocessing.parent_process()
    assert server is not None
    server.join()
    os._exit(1)


def _copied(told: Told) -> bytes:
    """A result and error as bytes; an error that pickle cannot make anew becomes one of its words."""
    content = pickle.dumps(told)
    if isinstance(told[1], CalibError):
        try:
            pickle.loads(content)
        except TypeError:
            return pickle.dumps((None, CalibError(str(told[1]))))
    return content
