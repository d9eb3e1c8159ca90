"""Progress of long work, shown on request: `progress=True` of a function that takes it.

In a notebook it is a bar in the cell's output, by IPython alone (no widgets), which is gone when the work is done, so
that a saved notebook keeps nothing of it; at a terminal tqdm's bar on stderr; where stderr is no terminal, nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Protocol

from calib.html_text import escape

OnProgress = Callable[[int, int, str], None]  # done, in all, what was just done
OnStep = Callable[[str], None]  # what is about to be done
_EVERY_S = 0.1  # at most so often is a notebook's bar drawn
_LONGEST = 60  # characters of a name beside a bar


class Handle(Protocol):
    """Protocol of IPython's handle of an output that can be updated."""

    def update(self, shown: object) -> None: ...


def in_notebook() -> bool:
    """Whether the code runs in a cell of Jupyter, VS Code or another front end of a kernel."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


@contextmanager
def counted(what: str, unit: str, *, asked: bool = True, then: OnProgress | None = None) -> Iterator[OnProgress | None]:
    """Context with a function to call after each part of the work: it advances a bar, if `asked`, and calls `then`.

    None where nobody wants to know.
    """
    if not asked:
        yield then
        return
    with _notebook_bar(what) if in_notebook() else _terminal_bar(what, unit) as moves:

        def on_progress(done: int, total: int, name: str) -> None:
            moves(done, total, name)
            if then is not None:
                then(done, total, name)

        yield on_progress


@contextmanager
def staged(*, asked: bool = True, then: OnStep | None = None) -> Iterator[OnStep | None]:
    """Context with a function to call with a line of text at each step, for a number of steps not known beforehand."""
    if not asked:
        yield then
        return
    with _notebook_line() if in_notebook() else _terminal_line() as tells:

        def on_step(step: str) -> None:
            tells(step)
            if then is not None:
                then(step)

        yield on_step


@contextmanager
def _notebook_bar(what: str) -> Iterator[OnProgress]:
    with _output() as shown:
        last = 0.0

        def moves(done: int, total: int, name: str) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last >= _EVERY_S or done >= total:
                last = now
                shown(f"{what}: {done} of {total}, {name[:_LONGEST]}", f' value="{done}" max="{max(total, 1)}"')

        yield moves


@contextmanager
def _notebook_line() -> Iterator[OnStep]:
    with _output() as shown:
        yield lambda step: shown(f"{step} ...", "")


@contextmanager
def _output() -> Iterator[Callable[[str, str], None]]:
    """Context with a function that shows a text and a bar in the cell's output; the bar's state is "" where unknown."""
    ipython = import_module("IPython.display")  # a notebook has it
    handle: Handle = ipython.display(ipython.HTML(""), display_id=True)

    def shown(words: str, state: str) -> None:
        style = "width:220px;vertical-align:middle;margin-right:8px"
        handle.update(ipython.HTML(f'<div><progress{state} style="{style}"></progress>{escape(words)}</div>'))

    try:
        yield shown
    finally:
        handle.update(ipython.HTML(""))


@contextmanager
def _terminal_bar(what: str, unit: str) -> Iterator[OnProgress]:
    from tqdm import tqdm  # takes a while to load

    with tqdm(desc=what, unit=unit, file=sys.stderr, leave=False, disable=None) as bar:

        def moves(done: int, total: int, name: str) -> None:
            bar.total = total
            bar.set_postfix_str(name[:_LONGEST], refresh=False)
            bar.update(done - bar.n)

        yield moves


@contextmanager
def _terminal_line() -> Iterator[OnStep]:
    if not sys.stderr.isatty():
        yield lambda step: None
        return

    def tells(step: str) -> None:
        sys.stderr.write(f"\r\033[K{step} ...")
        sys.stderr.flush()

    try:
        yield tells
    finally:
        sys.stderr.write("\r\033[K")
        sys.stderr.flush()
