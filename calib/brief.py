"""One-line representations of results and large values, for `repr` and a debugger's list of variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

LONGEST = 200  # characters of a representation, beyond which it is cut
_LONGEST_VALUE = 60  # characters of one field's value


class Brief:
    """Base class of values whose `repr` is one short line: the class's name and a few words from `_brief`.

    Without a `_brief` of its own a dataclass shows its fields, each shortened: arrays by shape, others by length.
    Name it as the first base, so that a dataclass does not make a `__repr__` of its own.
    """

    def _brief(self) -> str:
        """The value in a few words, without its class."""
        value: Any = self  # a dataclass or not
        members = fields(value) if is_dataclass(value) else ()
        return ", ".join(f"{one.name}={in_short(getattr(value, one.name))}" for one in members if one.repr)

    def __repr__(self) -> str:
        inside = " ".join(self._brief().split())
        return f"{type(self).__name__}({inside if len(inside) <= LONGEST else f'{inside[: LONGEST - 4]} ...'})"

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]  # dataclasses go by the class's own attributes


def in_short(value: Any) -> str:
    """A field's value in a few characters: arrays and tables by their shape, long collections by their length."""
    shape = getattr(value, "shape", None)
    if shape:
        return f"<{' x '.join(map(str, shape))}>"
    if isinstance(value, str | int | float) or value is None:
        text = f"{value:.6g}" if isinstance(value, float) else repr(value)
    elif isinstance(value, tuple | list | frozenset | set | Mapping) and len(value) > 3:
        text = f"<{len(value)} {type(value).__name__} items>"
    elif is_dataclass(value) and not isinstance(value, type | Brief):
        text = f"{type(value).__name__}(...)"
    else:
        text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


def errors_in_short(before: object, after: object) -> str:
    """RMSE, mm, of the test poses (of the training poses where none is for testing) before and after a fit, as text.

    Both are objects with the attributes `train` and `test`, figures with an `rmse_mm` or None.
    """
    for role in ("test", "train"):
        was, now = getattr(before, role), getattr(after, role)
        if was is not None and now is not None:
            return f"{role} RMSE {was.rmse_mm:.3g} -> {now.rmse_mm:.3g} mm"
    return "no errors"
