"""Compilation of a model by MuJoCo in a bounded process, and the serial chain between two of its bodies."""

from __future__ import annotations

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
    """The chain of a model's arm as a dict, or a dict with the key `error`.

    Args:
        asked: model (its absolute path), file (its name for messages), tip, base.
    """
    file = asked["file"]
    try:
        import mujoco
    except ImportError:
        return {"error": f"{file}: a MuJoCo model needs MuJoCo itself, the extra `mujoco`"}
    try:
        model = mujoco.MjModel.from_xml_path(asked["model"])
    except (ValueError, mujoco.FatalError) as error:
        return {"error": f"{file}: MuJoCo refuses it: {' '.join(str(error).split())[:300]}"}
    try:
        chain = _Arm(mujoco, model).chain(asked["tip"], asked["base"], Path(file).stem)
    except RobotFileError as error:
        return {"error": f"{file}: {error}"}
    joints = [asdict(joint) | {"before_T_joint": joint.before_T_joint.tolist()} for joint in chain.joints]
    return vars(chain) | {"joints": joints, "last_T_tip": chain.last_T_tip.tolist()}


class _Arm:
    """Bodies and joints of a compiled model; what it raises begins without the file's name."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._mujoco, self._m, self._data = mujoco, model, mujoco.MjData(model)
        mujoco.mj_kinematics(model, self._data)
        for kind, name_of, places_m in (
            ("body", model.body, self._data.xpos),
            ("the masses of body", model.body, self._data.xipos),
            ("site", model.site, self._data.site_xpos),
            ("joint", model.joint, self._data.xanchor),
        ):
            far = np.flatnonzero(~(np.abs(places_m) <= _FURTHEST_M).all(axis=1))
            if len(far):
                raise RobotFileError(
                    f"{kind} {name_of(int(far[0])).name!r} is more than {_FURTHEST_M:g} m away; lengths are metres, "
                    "correct pos"
                )

    def chain(self, tip: str | None, base: str | None, name: str) -> SerialChain:
        """Chain from a base body to a tip."""
        m, data = self._m, self._data
        root = 0 if base is None else self._body(base)
        end, site = self._end(tip)
        end_name = m.body(end).name if site is None else m.site(site).name
        way = [end]
        while way[0] != root:
            if way[0] == 0:
                raise RobotFileError(f"body {base!r} is not on the way to {end_name!r}; name another base")
            way.insert(0, int(m.body_parentid[way[0]]))
        numbers = [j for body in way[1:] for j in range(m.njnt) if m.jnt_bodyid[j] == body]
        if not numbers:
            raise RobotFileError(f"no joint moves between the base and {end_name!r}; name another tip")
        self._refuse_unserial(numbers)
        data.qpos[m.jnt_qposadr[numbers]] = 0.0  # a model's reference may be elsewhere
        self._mujoco.mj_kinematics(m, data)
        world_T_base = self._frame(data.xmat[root], data.xpos[root])
        world_T_tip = self._frame(data.xmat[end], data.xpos[end])
        if site is not None:
            world_T_tip = self._frame(data.site_xmat[site], data.site_xpos[site])
        # a joint's frame is at its anchor, with the world's axes
        places = [invert(world_T_base) @ self._frame(np.eye(3), data.xanchor[j]) for j in numbers]
        befores = [places[0], *(invert(a) @ b for a, b in pairwise(places))]
        bodies = [*(int(m.jnt_bodyid[j]) for j in numbers), -1]
        joints = [
            self._joint(j, before, world_T_base @ place, *self._carried(body, following))
            for j, before, place, body, following in zip(numbers, befores, places, bodies, bodies[1:], strict=False)
        ]
        x, y, z = map(float, world_T_base[:3, :3].T @ m.opt.gravity)
        last_T_tip = invert(places[-1]) @ invert(world_T_base) @ world_T_tip
        return SerialChain(name, tuple(joints), last_T_tip, (x, y, z), m.body(root).name, end_name)

    def _end(self, tip: str | None) -> tuple[int, int | None]:
        """Number of the body of the tip, and of its site where it is one."""
        m = self._m
        sites = [m.site(s).name for s in range(m.nsite)]
        if tip in sites:
            site = sites.index(tip)
            return int(m.site_bodyid[site]), site
        if tip is not None:
            return self._body(tip), None
        ends = [b for b in range(1, m.nbody) if b not in m.body_parentid[1:] and m.body_weldid[b]]  # 0: stands still
        if len(ends) != 1:
            names = [name for name in (*(m.body(b).name for b in ends), *sites) if name]
            found = "several tips; choose one with --tip" if ends else "no joint moves; there are"
            raise RobotFileError(f"{found}: {', '.join(names[:30])}")
        return ends[0], None

    def _body(self, name: str) -> int:
        names = [self._m.body(b).name for b in range(self._m.nbody)]
        if name not in names:
            raise RobotFileError(f"there is no body or site {name!r}; the bodies are {', '.join(names[1:30])}")
        return names.index(name)

    def _frame(self, turn: Array, place_m: Array) -> Array:
        return make_transform(np.reshape(turn, (3, 3)), 1e3 * place_m)

    def _refuse_unserial(self, numbers: list[int]) -> None:
        m, kinds = self._m, self._mujoco.mjtJoint
        for j in numbers:
            if int(m.jnt_type[j]) not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
                raise RobotFileError(f"joint {m.joint(j).name!r} is a ball or free joint; name a base behind it")
        for k in range(m.neq):
            if int(m.eq_type[k]) == int(self._mujoco.mjtEq.mjEQ_JOINT) and m.eq_obj1id[k] in numbers:
                name = m.joint(int(m.eq_obj1id[k])).name
                raise RobotFileError(f"joint {name!r} follows another by <equality>; name a tip before it")

    def _joint(self, j: int, before: Array, place: Array, mass_kg: float, com_mm: Array) -> ChainJoint:
        m, turns = self._m, int(self._m.jnt_type[j]) == int(self._mujoco.mjtJoint.mjJNT_HINGE)
        ax, ay, az = map(float, place[:3, :3].T @ self._data.xaxis[j])
        cx, cy, cz = map(float, apply(invert(place), com_mm))
        low, high = (float(value) * (1.0 if turns else 1e3) for value in m.jnt_range[j])
        return ChainJoint(
            name=m.joint(j).name or f"joint{j + 1}",
            before_T_joint=before,
            axis=(ax, ay, az),
            type="revolute" if turns else "prismatic",
            min=low if m.jnt_limited[j] else None,
            max=high if m.jnt_limited[j] else None,
            mass_kg=mass_kg,
            com_mm=(cx, cy, cz) if mass_kg else (0.0, 0.0, 0.0),
        )

    def _carried(self, body: int, following: int) -> tuple[float, Array]:
        """Mass, kg, and centre of mass in the world, mm, of all that hangs on a body up to the arm's next one."""
        m = self._m
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
