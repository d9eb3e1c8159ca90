"""Triangles of a mesh file of a robot's link."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array
from calib.errors import DatasetError

MOST_TRIANGLES = 200_000  # of one link: more slow every page down and show nothing more


def read_triangles(path: Path) -> tuple[Array, NDArray[np.int64]]:
    """Corners (V, 3) of a mesh in the file's unit, and triangles (T, 3) of their indices.

    Raises DatasetError, which tells what was found and not where, for a file without triangles or with too many.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        corners, triangles = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # whatever a foreign file makes the reader raise
        raise DatasetError(f"it cannot be read ({type(error).__name__}: {error})") from error
    if triangles.ndim != 2 or not len(triangles) or not np.isfinite(corners).all():
        raise DatasetError("found no triangles with finite corners; export the mesh again")
    require_few(triangles)
    return corners, triangles


def require_few(triangles: NDArray[np.int64]) -> None:
    """Raise DatasetError for more triangles than a page can show."""
    if len(triangles) > MOST_TRIANGLES:
        raise DatasetError(
            f"found {len(triangles):,} triangles; {MOST_TRIANGLES:,} or fewer would do, simplify the mesh"
        )
