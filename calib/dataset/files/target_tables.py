"""Targets in dataset.toml: [[targets]] with name, shape and sizes, and a [jig] that is no three-faced corner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from calib.dataset.files.cell_tables import load_jig
from calib.errors import is_one_line
from calib.kinematics.robot import Robot
from calib.target_shapes import SPHERE_MM, DeclaredTarget, OwnShape, Shape, Socket, Sphere, Spheres
from calib.text_files.toml_table import TomlTable, document_of, is_finite

_MOST_TARGETS = 50
_FARTHEST_MM = 1e4


def load_targets(jig: TomlTable, tables: Sequence[TomlTable], robot: Robot) -> tuple[DeclaredTarget, ...]:
    """All declared targets except a three-faced [jig]; a [jig] of another shape comes first. Raises DatasetError."""
    targets: list[DeclaredTarget] = []
    if jig.data.get("shape") in _READERS and jig.data.get("shape") != "trihedral":
        targets.append(_target(jig, "jig"))
    if len(tables) > _MOST_TARGETS:
        raise tables[0].error("name", f"found {len(tables)} targets", f"{_MOST_TARGETS} or fewer would do")
    targets += [_target(table, "") for table in tables]
    names = [name for target in targets for name in target.names]
    if jig.data and len(targets) == len(tables):
        names.append("jig")  # the three-faced one
    known = ("jig", *(target.name for target in robot.targets))
    places = [jig] * (len(targets) - len(tables)) + list(tables)
    for table, target in zip(places, targets, strict=True):
        for name in target.names:
            if names.count(name) > 1:
                raise table.error("name", f"found {name!r} more than once", "give each target a name of its own")
            if not robot.carries_scanner and name not in known:
                remedy = (
                    f"robot.toml knows {', '.join(known)}; add [[targets]] with this name and its xyz_mm there, the "
                    "place on the tool"
                )
                raise table.error("name", f"found {name!r}", remedy)
    return tuple(targets)


def _target(table: TomlTable, name: str) -> DeclaredTarget:
    kind = table.text("shape", choices=tuple(_READERS))
    if kind is None:
        raise table.error("shape", "the key is missing", f"give one of {', '.join(_READERS)}")
    name = table.text("name") or name or ("spheres" if kind == "spheres" else "")
    if not name or not is_one_line(name):
        found = "the key is missing or empty" if not name else f"found {name!r}"
        raise table.error("name", found, "give the name that the target has in robot.toml, in one line")
    return DeclaredTarget(name, _READERS[kind](table))


def _length(table: TomlTable, key: str, least: float = 0.0, most: float = _FARTHEST_MM) -> float | None:
    """Length in mm under a key, checked against the limits; None where the key is absent."""
    value = table.number(key, positive=True)
    if value is not None and not least <= value <= most:
        raise table.error(key, f"found {value:g} mm", f"{least:g} to {most:g} mm is needed")
    return value


def _no_more(table: TomlTable, *keys: str) -> None:
    for key in table.unread():
        if key not in keys:
            raise table.error(key, "is no key of a target of this shape", "see README, Other targets")


def _trihedral(table: TomlTable) -> Shape:
    jig, _ = load_jig(table)
    return jig


def _sphere(table: TomlTable) -> Shape:
    diameter_mm = _length(table, "diameter_mm", *SPHERE_MM)
    _no_more(table)
    return Sphere(diameter_mm)


def _spheres(table: TomlTable) -> Shape:
    names = table.data.get("spheres")
    if not isinstance(names, list) or len(names) < 3 or not all(isinstance(n, str) and is_one_line(n) for n in names):
        raise table.error("spheres", f"found {names!r}", 'three or more names are needed, such as ["s1", "s2", "s3"]')
    distances = _numbers(table, "distances_mm")
    pairs = len(names) * (len(names) - 1) // 2
    if len(distances) != pairs or min(distances) <= 0:
        raise table.error(
            "distances_mm",
            f"found {list(distances)}",
            f"{pairs} lengths above 0 are needed, between centres 1 and 2, 1 and 3, ..., 2 and 3, ...",
        )
    if len(names) == 3 and max(distances) >= sum(distances) - max(distances):
        raise table.error("distances_mm", f"found {list(distances)}", "three centres on a line, or none; mend them")
    diameter_mm = _length(table, "diameter_mm", *SPHERE_MM)
    _no_more(table, "spheres", "distances_mm")
    return Spheres(tuple(names), distances, diameter_mm)


def _socket(table: TomlTable) -> Shape:
    diameter_mm = _length(table, "diameter_mm", 0.5)
    sigma_mm = _length(table, "probe_sigma_mm", 1e-6, 1.0) or Socket().probe_sigma_mm
    _no_more(table)
    return Socket(diameter_mm, sigma_mm)


def _own(table: TomlTable) -> Shape:
    return OwnShape({key: value for key, value in table.data.items() if key not in ("name", "shape")})


def _numbers(table: TomlTable, key: str) -> tuple[float, ...]:
    value = table.data.get(key)
    if not isinstance(value, list) or not value or not all(map(is_finite, value)):
        raise table.error(key, f"found {value!r}", "finite numbers in [ ] are needed")
    return tuple(map(float, value))


_READERS: dict[str, Callable[[TomlTable], Shape]] = {
    "trihedral": _trihedral,
    "sphere": _sphere,
    "spheres": _spheres,
    "socket": _socket,
    "own": _own,
}


def target_document(target: DeclaredTarget) -> dict[str, Any]:
    """One of [[targets]] as a dict for writing; `load_targets` reads it back."""
    shape = target.shape
    if isinstance(shape, OwnShape):
        return {"name": target.name, "shape": "own", **shape.sizes}
    if isinstance(shape, Spheres):
        sizes = document_of(shape, but=("names",))
        return {"name": target.name, "shape": "spheres", "spheres": list(shape.names), **sizes}
    return {"name": target.name, "shape": type(shape).__name__.lower(), **document_of(shape)}
