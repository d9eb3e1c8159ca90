"""Further columns of a table of poses, kept as arrays; the table of pandas is made where one asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.array_types import IndexArray
from calib.lazy_modules import pd

Column = NDArray[Any]


class FurtherColumns:
    """Columns (N,) by name, of numbers or texts. Whatever else a `pandas.DataFrame` offers is its `frame`'s."""

    def __init__(self, columns: Mapping[str, Column] | None = None) -> None:
        """Take columns (N,) by name."""
        self.by_name = dict(columns or {})

    @classmethod
    def of(cls, columns: FurtherColumns | pd.DataFrame) -> FurtherColumns:
        """The columns of a table of pandas; further columns as they are."""
        if isinstance(columns, cls):
            return columns
        return cls({str(name): np.asarray(column) for name, column in columns.items()})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, in their order."""
        return tuple(self.by_name)

    def select(self, rows: IndexArray) -> FurtherColumns:
        """Some of the rows, in the order of `rows` (K,)."""
        return FurtherColumns({name: column[rows] for name, column in self.by_name.items()})

    def without(self, name: str) -> FurtherColumns:
        """All columns but one."""
        return FurtherColumns({other: column for other, column in self.by_name.items() if other != name})

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The columns as a table of pandas."""
        return pd.DataFrame(self.by_name)

    def __getitem__(self, name: str) -> pd.Series[Any]:
        """A column, as pandas has it. Raises KeyError where there is none of that name."""
        return self.frame[name]

    def __len__(self) -> int:
        return len(next(iter(self.by_name.values()), ()))

    def __getattr__(self, name: str) -> Any:
        """Attribute of the `frame`."""
        if name.startswith("__") or "by_name" not in vars(self):  # while it is copied or loaded
            raise AttributeError(name)
        return getattr(self.frame, name)


def is_number(column: Column) -> bool:
    """Whether a column holds numbers or truth values, not texts."""
    return column.dtype.kind in "fiub"
