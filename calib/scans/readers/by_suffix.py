"""The files that scans come in, by suffix: each reader takes the file's bytes and gives points and, if any, normals.

The readers are this project's own, and small, because of damaged files: other libraries return a part of one, fill it
up with zeros, print, or end the process. The tests compare whole files with what those libraries read and write. Only
.e57, a container with its own compression and checksums, is left to the library that the trade shares.
"""

from __future__ import annotations

from calib.scans.readers.e57 import SUFFIX, read_e57
from calib.scans.readers.mesh import read_obj, read_stl
from calib.scans.readers.npz import read_npz
from calib.scans.readers.parsing import Reader
from calib.scans.readers.pcd import read_pcd
from calib.scans.readers.ply import read_ply
from calib.scans.readers.text import read_text

READERS: dict[str, Reader] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_text,
    ".asc": read_text,
    ".pts": read_text,
    ".csv": read_text,
    ".txt": read_text,
    ".stl": read_stl,
    ".obj": read_obj,
    ".npz": read_npz,
    SUFFIX: read_e57,
}
"""By suffix. All raise ScanError with what was found; rows without a value are still in what they return."""
