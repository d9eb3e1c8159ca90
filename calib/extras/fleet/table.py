"""Table of a fleet's datasets, one row each, as .csv or .parquet; equal rows give an equal file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.errors import CalibError
from calib.extras.fleet.row import EffectSize, Row
from calib.lazy_modules import pd
from calib.text_files.csv_text import frame_csv

SUFFIXES = (".csv", ".parquet")
FIRST = ("path", "name", "serial")
"""First columns of every fleet table."""
_TEXTS = ("path", "name", "serial", "site", "date", "robot")


def fleet_frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Table with one row per dataset, in which lists are joined by "; ".

    A member of an effect has its main value and sigma.

    There are columns for the effects and the further keys of [about] of any row, sorted by name.
    """
    abouts = sorted({key for row in rows for key in row.about})
    parameters = sorted({size.parameter for row in rows for size in row.sizes})
    columns: dict[str, list[object]] = {name: [getattr(row, name) for row in rows] for name in _TEXTS}
    columns |= {f"about.{key}": [row.about.get(key, "") for row in rows] for key in abouts}
    columns |= {name: [getattr(row, name) for row in rows] for name in ("joints", "poses", "points")}
    for role in ("train", "test"):
        for stage in ("nominal", "links", "final"):
            values = [getattr(getattr(row, role), f"{stage}_mm") for row in rows]
            columns[f"{role}_rmse_{stage}_mm"] = values
    columns["noise_ratio"] = [row.noise_ratio for row in rows]
    columns["passed"] = [row.passed for row in rows]
    for name in ("verdict", "words"):
        columns[name] = [getattr(row, name) for row in rows]
    for name in ("missing", "suspected", "ambiguous", "left_out", "reasons"):
        columns[name] = ["; ".join(getattr(row, name)) for row in rows]
    sizes = [{size.parameter: size for size in row.sizes} for row in rows]
    for parameter in parameters:
        columns[parameter] = [_of(each.get(parameter), "value") for each in sizes]
        columns[f"{parameter}.sigma"] = [_of(each.get(parameter), "sigma") for each in sizes]
        columns[f"{parameter}.moves_mm"] = [_of(each.get(parameter), "moves_mm") for each in sizes]
    numbers = [name for name in columns if name.endswith(("_mm", "noise_ratio", ".sigma")) or name in parameters]
    return pd.DataFrame(columns).astype(dict.fromkeys(numbers, float))


def _of(size: EffectSize | None, field: str) -> float | None:
    return None if size is None else getattr(size, field)


def table_bytes(rows: Sequence[Row], suffix: str) -> bytes:
    """Content of a table file. Raises CalibError for an unknown suffix, or for .parquet without pyarrow."""
    frame = fleet_frame(rows)
    if suffix.lower() == ".csv":
        return frame_csv(frame).encode("utf-8")
    require_table_kind(suffix)
    content = io.BytesIO()
    frame.to_parquet(content, engine="pyarrow", index=False)
    return content.getvalue()


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write the fleet's table to a file, either completely or not at all."""
    write_bytes_atomically(path, table_bytes(rows, path.suffix))


def require_table_kind(suffix: str) -> None:
    """Raise CalibError where a table of this suffix cannot be written."""
    if suffix.lower() not in SUFFIXES:
        raise CalibError(f"a table's name ends with {' or '.join(SUFFIXES)}, found {suffix or 'no suffix'!r}")
    if suffix.lower() == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise CalibError(
                "a .parquet table needs pyarrow: pip install 'robot-calibration-inspector[fleet]', or name a .csv"
            ) from None


def is_table(path: Path) -> bool:
    """Whether a file is a fleet table or empty, so that it may be overwritten."""
    if path.suffix.lower() == ".parquet":
        import pyarrow.parquet

        try:
            return tuple(pyarrow.parquet.read_schema(path).names[: len(FIRST)]) == FIRST
        except (OSError, pyarrow.ArrowException):
            return path.stat().st_size == 0
    with path.open("rb") as file:
        start = file.read(200)
    return not start or start.startswith(",".join(FIRST).encode())
