"""Meshes of the links that an arm moves, as a URDF names them, and their files.

A mesh in STL or OBJ is taken, that of <visual> before that of <collision>. A mesh's place is one of

* `package://NAME/...`: the folder that the user gave for NAME, else the ROS package (a folder with package.xml) of that
  name that holds the robot's file or stands beside that package;
* a path from the robot's own file, in the same package or below the file's folder.

Packages are looked for only where the user named the robot's file; nothing outside the folders said is read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np

from calib.array_types import Array
from calib.dataset.files.triangles import read_triangles, require_few
from calib.errors import DatasetError
from calib.frames import apply, make_transform, rotation_from_rpy
from calib.robot_formats.urdf.chain import ArmPath, carried_links
from calib.robot_formats.urdf.safe_xml import Element

KINDS = (".stl", ".obj")
_MOST_BYTES = 50 * 1024**2  # of one mesh
_PACKAGE = "package.xml"
_PREFIX, _FILE = "package://", "file://"
Packages = Mapping[str, Path]


@dataclass(frozen=True)
class MeshFile:
    """A mesh's file with its place in the frame of the link that a joint moves."""

    path: Path
    link_T_mesh: Array  # (4, 4) mm
    scale: Array  # (3,) mm by the file's unit, along the mesh's axes


@dataclass(frozen=True)
class LinkMeshes:
    """Meshes of an arm's links, and why others are missing."""

    of_joint: tuple[tuple[MeshFile, ...], ...]  # (n,) of what each joint moves up to the next one
    missing: Mapping[str, str]  # the reason by the link's name

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence on meshes that are missing, with what would do; () where none is."""
        if not self.missing:
            return ()
        link, reason = next(iter(self.missing.items()))
        more = f" and {len(self.missing) - 1} more links" if len(self.missing) > 1 else ""
        return (f"meshes of {link}{more} are left out: {reason}",)


def link_meshes(arm: ArmPath, packages: Packages | None) -> LinkMeshes:
    """Meshes of the links that an arm moves; `packages`: folders by name, None where none may be looked for."""
    elements = {" ".join(e.attributes.get("name", "").split()): e for e in arm.tree.file.root.all("link")}
    found: list[tuple[MeshFile, ...]] = []
    missing: dict[str, str] = {}
    for joint in arm.moving:
        files: list[MeshFile] = []
        for name, place, _ in carried_links(arm, joint.child):
            element = elements.get(name)
            taken, reason = ([], "") if element is None else _of_link(element, arm.tree.file.path, packages)
            files += [MeshFile(one.path, place @ one.link_T_mesh, one.scale) for one in taken]
            if reason:
                missing[name] = reason
        found.append(tuple(files))
    return LinkMeshes(tuple(found), missing)


def _of_link(link: Element, robot_file: Path, packages: Packages | None) -> tuple[list[MeshFile], str]:
    """Meshes of a link's <visual>, else of its <collision>; and the first reason why there are none."""
    reason = ""
    for tag in ("visual", "collision"):
        taken: list[MeshFile] = []
        complete = True
        for shape, mesh in _meshes(link, tag):
            name = (mesh.attributes.get("filename") or "").strip()
            path, why = _file_of(name, robot_file, packages)
            if path is None:
                reason, complete = reason or why, False
                continue
            scale = _numbers(mesh.attributes.get("scale", "1 1 1"), 3)
            taken.append(MeshFile(path, _origin(shape), 1e3 * scale))
        if taken and complete:
            return taken, ""
    return [], reason


def _meshes(link: Element, tag: str) -> Iterator[tuple[Element, Element]]:
    for shape in link.all(tag):
        for geometry in shape.all("geometry"):
            yield from ((shape, mesh) for mesh in geometry.all("mesh"))


def _origin(shape: Element) -> Array:
    origin = shape.first("origin")
    given = {} if origin is None else origin.attributes
    turn = rotation_from_rpy(_numbers(given.get("rpy", "0 0 0"), 3))
    return make_transform(turn, 1e3 * _numbers(given.get("xyz", "0 0 0"), 3))


def _numbers(text: str, count: int) -> Array:
    """Finite numbers of an attribute; those of no shift, turn or scale where it has others."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    return values if len(values) == count and np.isfinite(values).all() else np.zeros(count)


def _file_of(name: str, robot_file: Path, packages: Packages | None) -> tuple[Path | None, str]:
    """File of a mesh, or None and the reason."""
    if not name.lower().endswith(KINDS):
        return None, f"{name[:80]!r} is neither STL nor OBJ"
    here = robot_file.resolve().parent
    own = _package_of(here) if packages is not None else None
    if name.startswith(_PREFIX):
        package, _, rest = name.removeprefix(_PREFIX).partition("/")
        root = None if packages is None else packages.get(package) or _beside(own, package)
        if root is None:
            return None, f"package {package[:60]!r} is not known; give its folder by --package {package[:60]}=FOLDER"
        return _inside(root, rest)
    if name.startswith(_FILE):
        named = Path(unquote(urlsplit(name).path))
        if packages is not None and _is_mesh(named):
            return named, ""
        return None, f"{name[:80]!r} is no file of this machine, or larger than 50 MB"
    path, why = _inside(here, name)
    if path is None and own is not None and "://" not in name:
        relative = (here / name).resolve()
        path = relative if relative.is_relative_to(own) and _is_mesh(relative) else None
    return path, why


def _package_of(folder: Path) -> Path | None:
    """The ROS package that holds a folder; None where there is none."""
    return next((at for at in (folder, *folder.parents) if (at / _PACKAGE).is_file()), None)


def _beside(own: Path | None, package: str) -> Path | None:
    """A ROS package by name: the one that holds the robot's file, or one beside it."""
    if own is None or package in ("", ".", ".."):
        return None
    if own.name == package:
        return own
    other = own.parent / package
    return other if (other / _PACKAGE).is_file() else None


def _inside(root: Path, name: str) -> tuple[Path | None, str]:
    root = root.resolve()
    path = (root / name).resolve()
    if not path.is_relative_to(root):
        return None, f"{name[:80]!r} leads out of {root.name}"
    return (path, "") if _is_mesh(path) else (None, f"{name[:80]!r} is no file of {root.name}, or larger than 50 MB")


def _is_mesh(path: Path) -> bool:
    return path.is_file() and path.stat().st_size <= _MOST_BYTES


def stl_of_links(meshes: Sequence[Sequence[MeshFile]]) -> tuple[tuple[bytes | None, ...], tuple[str, ...]]:
    """Binary STL, mm, of each joint's link in its frame, None where there is none; and notes on what is left out."""
    if not any(meshes):
        return (), ()
    if find_spec("trimesh") is None:
        return (), ("meshes of links need trimesh: pip install 'robot-calibration-inspector[scans]'",)
    out: list[bytes | None] = []
    notes: list[str] = []
    for k, files in enumerate(meshes):
        content, why = _stl_of(files) if files else (None, "")
        out.append(content)
        notes += [f"the mesh of what joint {k + 1} moves is left out: {why}"] if why else []
    count = sum(content is not None for content in out)
    return tuple(out), (*([f"meshes of {count} links are taken from the robot's file"] if count else []), *notes)


def _stl_of(files: Sequence[MeshFile]) -> tuple[bytes | None, str]:
    """STL of a link's meshes together; or None and the reason."""
    import trimesh

    parts = []
    for file in files:
        try:
            corners, triangles = read_triangles(file.path)
        except DatasetError as error:
            return None, f"{file.path.name}: {error}"
        parts.append(trimesh.Trimesh(apply(file.link_T_mesh, corners * file.scale), triangles, process=False))
    joined = trimesh.util.concatenate(parts)
    try:
        require_few(joined.faces)
    except DatasetError as error:
        return None, str(error)
    return bytes(joined.export(file_type="stl")), ""
