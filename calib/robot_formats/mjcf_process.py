"""Compilation of a model by MuJoCo in a separate bounded process, which reads only the named meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.frames import apply, invert, make_transform
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain

_FURTHEST_M = 1e6  # from the world, as of a URDF's numbers


def prepare() -> None:
    """Import MuJoCo, if installed, before memory is bounded."""
    try:
        import mujoco
    except ImportError:
        return
    del mujoco


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """The chain as a dict, or a dict with the key `error`.

    Args:
        asked: text, meshes (path by name), file and lines (by name) for messages, tip, base.
    """
    path = Path(asked["file"])
    try:
        import mujoco
    except ImportError:
        return {"error": f"{path}: a MuJoCo model needs MuJoCo itself, the extra `mujoco`"}
    meshes = {name: Path(place).read_bytes() for name, place in asked["meshes"].items()}
    try:
        model = mujoco.MjModel.from_xml_string(asked["text"], meshes)
    except (ValueError, mujoco.FatalError) as error:
        return {"error": f"{path}: MuJoCo refuses it: {' '.join(str(error).split())[:300]}"}
    try:
        return document_of(_Arm(mujoco, model, path, asked["lines"]).chain(asked["tip"], asked["base"]))
    except RobotFileError as error:
        return {"error": str(error)}


def document_of(chain: SerialChain) -> dict[str, Any]:
    """A chain as a dict for JSON; `mjcf.chain_from_document` makes the chain from it."""
    return {
        "name": chain.name,
        "joints": [asdict(joint) | {"before_T_joint": joint.before_T_joint.tolist()} for joint in chain.joints],
        "last_T_tip": chain.last_T_tip.tolist(),
        "gravity_m_s2": chain.gravity_m_s2,
        "base": chain.base,
        "tip": chain.tip,
    }


class _Arm:
    """Bodies and joints of a compiled model at its reference configuration."""

    def __init__(self, mujoco: Any, model: Any, path: Path, lines: Mapping[str, int]) -> None:
        self._mujoco, self._m, self._path, self._lines = mujoco, model, path, lines
        self._data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        kinds = mujoco.mjtJoint
        self._hinge, self._slide = int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)
        self._refuse_far()

    def chain(self, tip: str | None, base: str | None) -> SerialChain:
        """Chain from a base body to a tip."""
        end_body, world_T_tip, tip_name = self._tip(tip)
        way = [end_body]
        root = 0 if base is None else self._body(base)
        while way[0] != root:
            if way[0] == 0:
                raise RobotFileError(
                    f"{self._path}: line {self._line(str(base))}: body {base!r} is not on the way to {tip_name!r}; "
                    "name another base"
                )
            way.insert(0, int(self._m.body_parentid[way[0]]))
        numbers = [j for body in way[1:] for j in self._joints_of(body)]
        if not numbers:
            raise RobotFileError(
                f"{self._path}: line {self._line(tip_name)}: no joint moves between the base and {tip_name!r}; name "
                "another tip"
            )
        self._refuse_unserial(numbers)
        self._data.qpos[self._m.jnt_qposadr[numbers]] = 0.0  # a model's reference may be elsewhere
        self._mujoco.mj_kinematics(self._m, self._data)
        world_T_base, world_T_tip = self._body_frame(root), self._tip(tip)[1]
        places = [invert(world_T_base) @ self._joint_frame(j) for j in numbers]
        befores = [places[0], *(invert(a) @ b for a, b in pairwise(places))]
        joints = tuple(
            self._joint(j, before, world_T_base @ place, self._carried(way, numbers, k))
            for k, (j, before, place) in enumerate(zip(numbers, befores, places, strict=True))
        )
        x, y, z = map(float, world_T_base[:3, :3].T @ self._m.opt.gravity)
        return SerialChain(
            name=self._path.stem,
            joints=joints,
            last_T_tip=invert(places[-1]) @ invert(world_T_base) @ world_T_tip,
            gravity_m_s2=(x, y, z),
            base=self._m.body(root).name,
            tip=tip_name,
        )

    def _refuse_far(self) -> None:
        """Raise RobotFileError where a position in mm is not finite."""
        for kind, one, places_m in (
            ("body", self._m.body, self._data.xpos),
            ("the masses of body", self._m.body, self._data.xipos),
            ("site", self._m.site, self._data.site_xpos),
            ("joint", self._m.joint, self._data.xanchor),
        ):
            far = np.flatnonzero(~(np.abs(places_m) <= _FURTHEST_M).all(axis=1))
            if len(far):
                name = one(int(far[0])).name
                raise RobotFileError(
                    f"{self._path}: line {self._line(name)}: {kind} {name!r} is more than {_FURTHEST_M:g} m away; "
                    "lengths are metres, correct pos"
                )

    def _tip(self, tip: str | None) -> tuple[int, Array, str]:
        """Body number, transform in the world (4, 4) and name of the tip."""
        m = self._m
        for site in range(m.nsite):
            if tip is not None and m.site(site).name == tip:
                turn = self._data.site_xmat[site].reshape(3, 3)
                place = make_transform(turn, 1e3 * self._data.site_xpos[site])
                return int(m.site_bodyid[site]), place, tip
        if tip is None:
            parents = set(m.body_parentid[1:].tolist())
            ends = [b for b in range(1, m.nbody) if b not in parents and self._moves(b)]
            if len(ends) != 1:
                names = [m.body(b).name for b in ends] + [m.site(s).name for s in range(m.nsite)]
                listed = ", ".join(name for name in names[:30] if name)
                found = "several tips; choose one with --tip" if ends else "no joint moves; there are"
                raise RobotFileError(f"{self._path}: line {self._line()}: {found}: {listed}")
            tip = m.body(ends[0]).name
            return ends[0], self._body_frame(ends[0]), tip
        body = self._body(tip)
        return body, self._body_frame(body), tip

    def _body(self, name: str) -> int:
        for body in range(self._m.nbody):
            if self._m.body(body).name == name:
                return body
        names = ", ".join(self._m.body(b).name for b in range(1, min(self._m.nbody, 30)))
        raise RobotFileError(
            f"{self._path}: line {self._line()}: there is no body or site {name!r}; the bodies are {names}"
        )

    def _line(self, name: str = "") -> int:
        """Line of a named element in the user's file; the root's line where it is in another file."""
        return self._lines.get(name, self._lines[""])

    def _body_frame(self, body: int) -> Array:
        return make_transform(self._data.xmat[body].reshape(3, 3), 1e3 * self._data.xpos[body])

    def _joints_of(self, body: int) -> list[int]:
        first, count = int(self._m.body_jntadr[body]), int(self._m.body_jntnum[body])
        return list(range(first, first + count))

    def _moves(self, body: int) -> bool:
        while body:
            if self._m.body_jntnum[body]:
                return True
            body = int(self._m.body_parentid[body])
        return False

    def _refuse_unserial(self, numbers: list[int]) -> None:
        for j in numbers:
            if int(self._m.jnt_type[j]) not in (self._hinge, self._slide):
                name = self._m.joint(j).name
                raise RobotFileError(
                    f"{self._path}: line {self._line(name)}: joint {name!r} is a ball or free joint; name a base "
                    "behind it"
                )
        for k in range(self._m.neq):
            if int(self._m.eq_type[k]) == int(self._mujoco.mjtEq.mjEQ_JOINT) and {int(self._m.eq_obj1id[k])} & set(
                numbers
            ):
                name = self._m.joint(int(self._m.eq_obj1id[k])).name
                raise RobotFileError(
                    f"{self._path}: line {self._line(name)}: joint {name!r} follows another by <equality>; name a tip "
                    "before it"
                )

    def _joint_frame(self, j: int) -> Array:
        """Frame (4, 4) of a joint in the world: at its anchor, with the world's axes."""
        return make_transform(np.eye(3), 1e3 * self._data.xanchor[j])

    def _joint(self, j: int, before: Array, place: Array, carried: tuple[float, Array]) -> ChainJoint:
        m, turns = self._m, int(self._m.jnt_type[j]) == self._hinge
        mass_kg, com_mm = carried
        ax, ay, az = map(float, place[:3, :3].T @ self._data.xaxis[j])
        scale = 1.0 if turns else 1e3
        low, high = (float(v) * scale for v in m.jnt_range[j])
        limited = bool(m.jnt_limited[j])
        cx, cy, cz = map(float, apply(invert(place), com_mm))
        return ChainJoint(
            name=m.joint(j).name or f"joint{j + 1}",
            before_T_joint=before,
            axis=(ax, ay, az),
            type="revolute" if turns else "prismatic",
            min=low if limited else None,
            max=high if limited else None,
            mass_kg=mass_kg,
            com_mm=(cx, cy, cz) if mass_kg else (0.0, 0.0, 0.0),
        )

    def _carried(self, way: list[int], numbers: list[int], k: int) -> tuple[float, Array]:
        """Mass, kg, and centre of mass in the world of all bodies from joint k to the next joint of the arm."""
        m = self._m
        body = int(m.jnt_bodyid[numbers[k]])
        following = int(m.jnt_bodyid[numbers[k + 1]]) if k + 1 < len(numbers) else -1
        if following == body:  # two joints of one body: the first carries nothing of its own
            return 0.0, np.zeros(3)
        inside = {body}
        for other in range(body + 1, m.nbody):  # parents come first
            if int(m.body_parentid[other]) in inside and other != following:
                inside.add(other)
        rows = sorted(inside)
        mass = m.body_mass[rows]
        total = float(mass.sum())
        centre = (mass[:, None] * self._data.xipos[rows]).sum(axis=0) / total if total else np.zeros(3)
        return total, 1e3 * centre
