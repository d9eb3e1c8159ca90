"""What a camera sees: ChArUco boards, grids of ArUco and AprilTag markers, single markers, and checkerboards."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.errors import CalibError

KINDS = ("charuco", "checkerboard", "aruco", "apriltag")
_FORMS = (
    "charuco:SQUARESxSQUARES:square_mm:marker_mm, checkerboard:SQUARESxSQUARES:square_mm, "
    "apriltag:TAGSxTAGS:tag_mm:gap_mm (or aruco:...), apriltag:tag_mm (or aruco:...) for a single one"
)
_TEXT = re.compile(rf"(?P<kind>{'|'.join(KINDS)}):((?P<counts>\d{{1,4}}x\d{{1,4}}):)?(?P<sizes>\d+\.?\d*(:\d+\.?\d*)*)")
_MOST = 100  # squares or markers along a side
_LONGEST_MM = 10_000.0


@dataclass(frozen=True)
class Board(Brief):
    """A flat board as its printed size tells it.

    Its frame lies on its middle: x to the right and y down the printed page, z away from who looks at it.
    """

    text: str  # as it was typed, "charuco:8x6:30:22"
    kind: str  # of KINDS
    columns: int  # of squares or markers
    rows: int
    square_mm: float  # side of a square, or of a marker
    inner_mm: float  # side of a marker in a square, or the gap between two markers; 0 where there is none

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the whole board, mm."""
        if self.kind in ("charuco", "checkerboard"):
            return self.columns * self.square_mm, self.rows * self.square_mm
        step = self.square_mm + self.inner_mm
        return self.columns * step - self.inner_mm, self.rows * step - self.inner_mm

    @property
    def corners_mm(self) -> Array:
        """Corners (N, 3) in the board's frame, mm: the inner ones row by row, or four of each marker clockwise."""
        middle = 0.5 * np.array(self.size_mm)
        if self.kind in ("charuco", "checkerboard"):
            x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
            flat = self.square_mm * np.column_stack([x.ravel(), y.ravel()])
        else:
            x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
            first = (self.square_mm + self.inner_mm) * np.column_stack([x.ravel(), y.ravel()])
            around = self.square_mm * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            flat = (first[:, None] + around).reshape(-1, 2)
        return np.column_stack([flat - middle, np.zeros(len(flat))])

    @property
    def turns_alike(self) -> bool:
        """Whether the board turned by half a turn looks the same, so that its corners cannot be numbered."""
        return self.kind == "checkerboard" and (self.columns + self.rows) % 2 == 0

    @property
    def is_of_markers(self) -> bool:
        """Whether its corners are those of markers."""
        return self.kind in ("aruco", "apriltag")

    @property
    def is_single(self) -> bool:
        """Whether it is one marker."""
        return self.is_of_markers and self.columns == self.rows == 1

    def _brief(self) -> str:
        return self.text


def board_of(text: str) -> Board:
    """Board that a text names, such as "charuco:8x6:30:22" (squares, mm, mm). Raises CalibError.

    >>> from calib.extras.camera.board import board_of
    >>> board_of("charuco:8x6:30:22").size_mm
    (240.0, 180.0)
    """
    found = _TEXT.fullmatch(text.strip().lower())
    if found is None:
        raise _wrong(text, "it is not written so")
    kind, counts, sizes = found["kind"], found["counts"], list(map(float, found["sizes"].split(":")))
    columns, rows = map(int, counts.split("x")) if counts else (1, 1)
    is_of_markers = kind in ("aruco", "apriltag")
    needed = 1 if kind == "checkerboard" or (is_of_markers and not counts) else 2
    if len(sizes) != needed or (not counts and not is_of_markers):
        raise _wrong(text, f"found {len(sizes)} sizes in mm, {needed} and the numbers of squares are needed")
    least = 1 if is_of_markers else 3
    if not least <= min(columns, rows) <= max(columns, rows) <= _MOST:
        raise _wrong(text, f"found {columns} x {rows}, {least} to {_MOST} along a side are needed")
    square_mm, inner_mm = [*sizes, 0.0][:2]
    if not 0.0 < square_mm <= _LONGEST_MM:
        raise _wrong(text, f"found a size of {square_mm:g} mm")
    if kind == "charuco" and not 0.0 < inner_mm < square_mm:
        raise _wrong(text, f"a marker of {inner_mm:g} mm does not fit into a square of {square_mm:g} mm")
    if is_of_markers and columns * rows > 1 and not 0.0 < inner_mm <= _LONGEST_MM:
        raise _wrong(text, f"found a gap of {inner_mm:g} mm")
    return Board(text.strip(), kind, columns, rows, square_mm, inner_mm)


def _wrong(text: str, found: str) -> CalibError:
    return CalibError(f"--board {text}: {found}; give {_FORMS}")
