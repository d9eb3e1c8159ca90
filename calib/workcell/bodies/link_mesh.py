"""Meshes of links named in robot.toml, each in its link's own frame, in mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.files.triangles import read_triangles
from calib.errors import DatasetError

KINDS = (".stl", ".ply", ".obj", ".off", ".glb")


@dataclass(frozen=True)
class LinkMesh:
    """Triangles of one link."""

    vertices_mm: Array  # (V, 3) in the link's own frame
    triangles: NDArray[np.int64]  # (T, 3) indices into them

    def bounding_capsule(self) -> tuple[Array, Array, float]:
        """Ends (3,) of an axis along the mesh, and the radius about it, mm, within which every vertex lies."""
        middle = self.vertices_mm.mean(axis=0)
        off_mm = self.vertices_mm - middle
        axis = np.linalg.svd(off_mm, full_matrices=False)[2][0]
        along = off_mm @ axis
        across = np.linalg.norm(off_mm - along[:, None] * axis, axis=1)
        radius = float(across.max())
        rounded = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
        first, last = float((along + rounded).min()), float((along - rounded).max())
        if first > last:  # shorter than thick
            first = last = 0.5 * (first + last)
            radius = float(np.hypot(across, along - first).max())
        return middle + first * axis, middle + last * axis, radius


def load_link_mesh(dataset: Dataset, joint: int) -> LinkMesh | None:
    """Mesh of the link that a joint moves; None where robot.toml names none.

    Raises:
        DatasetError: a file outside the dataset's folder, missing, of an unknown kind, unreadable or too large.
    """
    name = dataset.robot.joints[joint].mesh
    if name is None or dataset.folder is None:
        return None
    place = f"{dataset.folder}: mesh of joint {joint + 1}, {name!r}"
    folder = dataset.folder.resolve()
    path = (folder / name).resolve()
    if not path.is_relative_to(folder):
        raise DatasetError(f"{place}, lies outside the dataset's folder; put it inside")
    if path.suffix.lower() not in KINDS:
        raise DatasetError(f"{place}: found a {path.suffix or 'nameless'} file; {', '.join(KINDS)} would do")
    if not path.is_file():
        raise DatasetError(f"{place}: there is no such file; add it, or take the key out of robot.toml")
    try:
        return LinkMesh(*read_triangles(path))
    except DatasetError as error:
        raise DatasetError(f"{place}: {error}") from error
