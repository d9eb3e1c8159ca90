"""YAML, JSON and XML files of ROS and OpenCV as plain dicts and lists; OpenCV's matrices as `{rows, cols, data}`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError

SUFFIXES = (".yaml", ".yml", ".json", ".xml")
_MOST_BYTES = 20_000_000
_DEEPEST = 30


def documents(path: Path) -> list[Any]:
    """Documents of a file, several where YAML's --- part them. Raises CalibError."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CalibError(f"{path}: cannot be read: {error.strerror}") from None
    if len(content) > _MOST_BYTES:
        raise CalibError(f"{path}: {len(content)} bytes, more than any lens or list of poses has")
    suffix = path.suffix.lower()
    if suffix == ".xml":
        return [_by_opencv(path)]
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CalibError(f"{path}: is no text in UTF-8") from None
    if suffix == ".json":
        try:
            return [json.loads(text)]
        except (ValueError, RecursionError) as error:
            raise CalibError(f"{path}: is no JSON: {error}") from None
    return _yaml(path, text)


def _yaml(path: Path, text: str) -> list[Any]:
    try:
        import yaml
    except ImportError:
        raise CalibError(
            f"{path}: YAML needs PyYAML, which is not installed: pip install 'robot-calibration-inspector[camera]'"
        ) from None

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        """Safe loader that takes OpenCV's matrices as maps, and refuses aliases, by which small files grow huge."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.events.AliasEvent):
                raise yaml.YAMLError("aliases (*name) are not read")
            return super().compose_node(parent, index)

    Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True))
    lines = text.split("\n")
    if lines and lines[0].startswith("%YAML:"):  # OpenCV's own way of writing the version
        lines = lines[1:]
    try:
        return [one for one in yaml.load_all("\n".join(lines), Loader) if one is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CalibError(f"{path}: is no YAML that can be read: {' '.join(str(error).split())[:200]}") from None


def _by_opencv(path: Path) -> Any:
    try:
        import cv2
    except ImportError:
        raise CalibError(
            f"{path}: OpenCV's XML needs OpenCV, which is not installed: pip install "
            "'robot-calibration-inspector[camera]'"
        ) from None
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    except (cv2.error, SystemError):
        raise CalibError(f"{path}: is no file of OpenCV's FileStorage") from None
    if not storage.isOpened():
        raise CalibError(f"{path}: is no file of OpenCV's FileStorage")
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


def number_array(value: Any) -> Array | None:
    """Numbers of a list, of nested lists, or of a matrix `{rows, cols, data}`, flat (N,); None where it is none."""
    if isinstance(value, dict):
        if "data" in value:
            return number_array(value["data"])
        if {"x", "y", "z"} <= set(value):
            names = ("x", "y", "z", "w") if "w" in value else ("x", "y", "z")
            return number_array([value[name] for name in names])
        return None
    if not isinstance(value, list) or not value:
        return None
    try:
        found = np.array(value, dtype=float).ravel()
    except (ValueError, TypeError):
        return None
    return found if np.isfinite(found).all() else None
