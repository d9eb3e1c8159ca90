"""YAML, JSON and XML files of ROS and OpenCV as plain dicts and lists; OpenCV's matrices as `{rows, cols, data}`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.extras.camera.lens import opencv
from calib.text_files.records import content_of, yaml_documents

SUFFIXES = (".yaml", ".yml", ".json", ".xml")
_DEEPEST = 30


def documents(path: Path) -> list[Any]:
    """Documents of a file, several where YAML's --- part them. Raises CalibError."""
    if path.suffix.lower() == ".json":
        return [content_of(path)]
    return [_by_opencv(path)] if path.suffix.lower() == ".xml" else yaml_documents(path)


def _by_opencv(path: Path) -> Any:
    cv2 = opencv()
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError):
        raise CalibError(f"{path}: is no file of OpenCV's FileStorage") from None
    return _plain(storage.root(), 0)


def _plain(node: Any, depth: int) -> Any:
    """A node of OpenCV's FileStorage as plain values."""
    if depth > _DEEPEST or node.isNone():
        return None
    if node.isMap():
        return {key: _plain(node.getNode(key), depth + 1) for key in node.keys()}  # noqa: SIM118  no dict
    if node.isSeq():
        return [_plain(node.at(i), depth + 1) for i in range(node.size())]
    return node.string() if node.isString() else node.real()


def by_lower_name(content: Any) -> dict[str, Any]:
    """Entries of a document by their names in lower case, with _ for blanks; {} where it has none."""
    entries = content.items() if isinstance(content, dict) else ()
    return {str(name).lower().replace(" ", "_"): value for name, value in entries}


def number_array(value: Any) -> Array | None:
    """Numbers of a list, of nested lists, or of a matrix `{rows, cols, data}`, flat (N,); None where it is none."""
    if isinstance(value, dict):
        axes = [name for name in "xyzw" if name in value]
        return number_array(value.get("data") or [value[name] for name in axes])
    if not isinstance(value, list) or not value:
        return None
    try:
        found = np.array(value, dtype=float).ravel()
    except (ValueError, TypeError):
        return None
    return found if np.isfinite(found).all() else None
