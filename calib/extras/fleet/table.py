"""Table of a fleet's datasets, one row each, as .csv or .parquet; equal rows give an equal file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from calib.errors import CalibError
from calib.extras.fleet.row import Row
from calib.lazy_modules import pd
from calib.text_files.csv_text import frame_csv

SUFFIXES = (".csv", ".parquet")
FIRST = ("path", "name", "serial")
"""First columns of every fleet table."""
_TEXTS = ("path", "name", "serial", "site", "date", "robot")
_COUNTS = ("joints", "poses", "points")
_RMSE = {
    f"{role}.{stage}": f"{role}_rmse_{stage}"
    for role in ("train", "test")
    for stage in ("nominal_mm", "links_mm", "final_mm")
}
_LISTS = ("missing", "suspected", "ambiguous", "left_out", "reasons")
_OF_MEMBER = {"value": "", "sigma": ".sigma", "moves_mm": ".moves_mm"}


def fleet_frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Table with one row per dataset, in which lists are joined by "; ".

    A member of an effect has its main value and sigma.

    There are columns for the effects and the further keys of [about] of any row, sorted by name.
    """
    frame = pd.json_normalize([asdict(row) for row in rows])
    abouts = sorted({f"about.{key}" for row in rows for key in row.about})
    names = [*_TEXTS, *abouts, *_COUNTS, *_RMSE, "noise_ratio", "passed", "verdict", "words", *_LISTS]
    figures = dict.fromkeys([*_RMSE, "noise_ratio"], float)
    frame = frame.reindex(columns=names).fillna(dict.fromkeys(abouts, "")).astype(figures)
    for name in _LISTS:
        frame[name] = ["; ".join(texts) for texts in frame[name]]
    sizes = [{size.parameter: size for size in row.sizes} for row in rows]
    members = {
        f"{parameter}{ending}": [getattr(each.get(parameter), field, None) for each in sizes]
        for parameter in sorted(set().union(*sizes))
        for field, ending in _OF_MEMBER.items()
    }
    return frame.rename(columns=_RMSE).join(pd.DataFrame(members, frame.index, dtype=float))


def table_bytes(rows: Sequence[Row], suffix: str) -> bytes:
    """Content of a table file. Raises CalibError for an unknown suffix, or for .parquet without pyarrow."""
    frame = fleet_frame(rows)
    if suffix.lower() == ".csv":
        return frame_csv(frame).encode("utf-8")
    require_table_kind(suffix)
    content = io.BytesIO()
    frame.to_parquet(content, engine="pyarrow", index=False)
    return content.getvalue()


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
