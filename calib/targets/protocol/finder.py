"""Protocol of every finder of targets: its request, its answer, and finders in files of a user's own.

A finder is a function from a scan and what is wanted in it to the places where such targets are. It does not know which
of several equal targets a place belongs to: `calib.targets.assignment` decides that from all poses together. One in a
user's file is a function `find(scan, wanted)`, whose errors become one line each.
"""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from calib.array_types import Array, ByteArray, IndexArray
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.errors import CalibError, TargetError
from calib.scans.scan import Scan
from calib.target_shapes import Shape


@dataclass(frozen=True)
class Wanted:
    """Request to a finder: all targets of one shape."""

    shape: Shape
    names: tuple[str, ...] = ("jig",)  # of the targets that have this shape
    scan_sigma_mm: float | None = None  # the scanner's declared noise along the ray
    declared: DeclaredNoise = NOTHING_DECLARED  # of its smooth error

    @property
    def most(self) -> int:
        """Number of places wanted."""
        return len(self.names)


@dataclass(frozen=True)
class FoundPoint:
    """Place where a target may be, in the scanner's frame."""

    xyz_mm: Array  # (3,) of the target's point: a sphere's centre, a plate's corner
    covariance_mm2: Array  # (3, 3)
    points: int = 0  # of the scan, that it was made from
    rms_mm: float = 0.0  # robust: of those points about the target's surface
    inlier_bits: ByteArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint8))  # (N / 8,) as in `Face`
    facts: Mapping[str, float] = field(default_factory=dict)  # name with its unit -> what was found besides
    doubts: tuple[str, ...] = ()  # what should be checked, each with what would help
    radius_mm: float | None = None  # of a sphere to draw about the point
    name: str = ""  # of the target, where the shape itself identifies it

    @property
    def inliers(self) -> IndexArray:
        """Indices (points,) of the scan's points from which the place was computed."""
        return np.flatnonzero(np.unpackbits(self.inlier_bits))

    def sigma_mm(self) -> float:
        """Standard deviation of the point over all three axes: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))


class TargetFinder(Protocol):
    """Function that finds at most `wanted.most` places of targets of one shape in a scan, the surest first.

    Raises TargetError with the reason, in one line that says what would help, where there is none.
    """

    def __call__(self, scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]: ...


EXAMPLE = "def find(scan, wanted): ... return xyz_mm, covariance_mm2"
_LEAST_EIGENVALUE = 1e-12  # of a covariance scaled to a unit diagonal


@dataclass(frozen=True)
class UserFinder:
    """The function `find` of a file, as a `TargetFinder` that is pickled as the file's path."""

    path: Path

    def __call__(self, scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
        """Places that the function finds. Raises TargetError where it finds none, raises, or returns no point."""
        function = _function(self.path, self.path.stat().st_mtime_ns)
        return checked_answer(function, scan, wanted, str(self.path))


def load_finder(path: Path) -> UserFinder:
    """Finder of a file. Raises CalibError in one line, with the line number where the file's code fails."""
    if not path.is_file():
        raise CalibError(f"{path}: no such finder file")
    _function(path, path.stat().st_mtime_ns)
    return UserFinder(path)


def checked_answer(
    function: Callable[[Scan, Wanted], Any], scan: Scan, wanted: Wanted, where: str
) -> Sequence[FoundPoint]:
    """Places that a user's function returns for a scan, checked. Raises TargetError in one line."""
    try:
        answer = function(scan, wanted)
    except TargetError:
        raise
    except Exception as error:
        line = _line(error, where)
        raise TargetError(f"{where}: {line}{type(error).__name__}: {_one_line(error)}; mend `find`") from None
    if answer is None or isinstance(answer, str):
        raise TargetError(answer or f"{where}: `find` returned nothing for {scan.name}; look at the scan")
    if isinstance(answer, tuple) and len(answer) == 2 and not isinstance(answer[0], FoundPoint):
        answer = [answer]
    if isinstance(answer, FoundPoint):
        answer = [answer]
    if not isinstance(answer, Sequence):
        raise TargetError(f"{where}: `find` returned a {type(answer).__name__}; return xyz_mm, covariance_mm2")
    places = [_point(one, where) for one in answer]
    if not places:
        raise TargetError(f"{where}: `find` returned nothing for {scan.name}; look at the scan")
    return places[: wanted.most]


def _point(one: Any, where: str) -> FoundPoint:
    """One returned place, checked. Raises TargetError."""
    if isinstance(one, FoundPoint):
        xyz, covariance, kept = one.xyz_mm, one.covariance_mm2, one
    elif isinstance(one, tuple | list) and len(one) == 2:
        (xyz, covariance), kept = one, None
    else:
        raise TargetError(f"{where}: `find` returned {type(one).__name__}; return xyz_mm, covariance_mm2")
    try:
        place, spread = np.asarray(xyz, dtype=float), np.asarray(covariance, dtype=float)
    except (TypeError, ValueError):
        raise TargetError(f"{where}: `find` returned what are no numbers; return xyz_mm, covariance_mm2") from None
    if place.shape != (3,) or spread.shape != (3, 3) or not (np.isfinite(place).all() and np.isfinite(spread).all()):
        raise TargetError(
            f"{where}: `find` returned arrays of shape {place.shape} and {spread.shape}; finite numbers of shape (3,) "
            "and (3, 3) are needed"
        )
    scale = np.sqrt(np.abs(np.diag(spread)))
    scaled = spread / np.maximum(np.outer(scale, scale), 1e-300)
    if not np.allclose(spread, spread.T) or np.linalg.eigvalsh(scaled)[0] < _LEAST_EIGENVALUE:
        raise TargetError(f"{where}: `find` returned a covariance that is not positive definite; give one in mm^2")
    return kept or FoundPoint(place, spread)


@lru_cache(maxsize=8)
def _function(path: Path, _changed_ns: int) -> Callable[[Scan, Wanted], Any]:
    """The file's `find`, loaded again when the file has changed. Raises CalibError."""
    spec = importlib.util.spec_from_file_location(f"_finder_{path.stem}", path)
    if spec is None:
        raise CalibError(f"{path}: not a Python file; a finder file ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except SyntaxError as error:
        raise CalibError(f"{path}: line {error.lineno}: {error.msg}; mend the syntax") from None
    except (KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:  # a file that calls exit() must not end the program
        raise CalibError(f"{path}: {_line(error, str(path))}{type(error).__name__}: {_one_line(error)}") from None
    find = getattr(module, "find", None)
    if not callable(find):
        raise CalibError(f"{path}: found no function `find`; write {EXAMPLE}")
    return find


def _line(error: BaseException, where: str) -> str:
    """ "line 12: " where the error was raised in the file `where`, else ""."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == where]
    return f"line {frames[-1].lineno}: " if frames else ""


def _one_line(error: BaseException) -> str:
    """Text of an error in one line of at most 200 characters."""
    return " ".join(str(error).split())[:200]
