"""Compilation of a model by MuJoCo in a bounded process, and the serial chain between two of its bodies."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.frames import apply, invert, make_transform
from calib.robot_formats.chain.serial_chain import RobotFileError

_FURTHEST_MM = 1e9  # from the world, as of a URDF's numbers


def prepare() -> None:
    """Import MuJoCo, if installed, before memory is bounded."""
    try:
        import mujoco
    except ImportError:
        return
    del mujoco


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """The fields of a model's `SerialChain` as lists and numbers, or a dict with the key `error`.

    Args:
        asked: model (its absolute path), tip, base.
    """
    try:
        import mujoco
    except ImportError:
        return {"error": "a MuJoCo model needs MuJoCo itself, the extra `mujoco`"}
    try:
        return _chain(mujoco, mujoco.MjModel.from_xml_path(asked["model"]), asked["tip"], asked["base"])
    except RobotFileError as error:
        return {"error": str(error)}
    except (ValueError, KeyError, mujoco.FatalError) as error:  # KeyError: no such body, with those that there are
        return {"error": f"MuJoCo refuses it: {' '.join(str(error.args[0]).split())[:300]}"}


def _chain(mujoco: Any, m: Any, tip: str | None, base: str | None) -> dict[str, Any]:
    """Chain from a base body (None: the world) to a tip."""
    bodies, sites = [m.body(b).name for b in range(m.nbody)], [m.site(s).name for s in range(m.nsite)]
    ends = [b for b in range(1, m.nbody) if b not in m.body_parentid[1:] and m.body_weldid[b]]  # 0: stands still
    if tip is None and len(ends) != 1:
        found = "several tips; choose one with --tip" if ends else "no joint moves; there are"
        raise RobotFileError(f"{found}: {', '.join([*filter(None, (*(bodies[b] for b in ends), *sites))][:30])}")
    at_site = sites.index(tip) if tip in sites else None
    end = int(m.site_bodyid[at_site]) if at_site is not None else ends[0] if tip is None else m.body(tip).id
    tip, root = tip or bodies[end], 0 if base is None else m.body(base).id
    way = [end]
    while way[0] != root:
        if way[0] == 0:
            raise RobotFileError(f"body {base!r} is not on the way to {tip!r}; name another base")
        way.insert(0, int(m.body_parentid[way[0]]))
    numbers = [j for body in way[1:] for j in range(m.njnt) if m.jnt_bodyid[j] == body]
    if not numbers:
        raise RobotFileError(f"no joint moves between the base and {tip!r}; name another tip")
    _refuse_unserial(mujoco, m, numbers)
    data = mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    data.qpos[m.jnt_qposadr[numbers]] = 0.0  # a model's reference may be elsewhere
    mujoco.mj_kinematics(m, data)
    if not all((np.abs(1e3 * each) <= _FURTHEST_MM).all() for each in (data.xpos, data.xipos, data.xanchor)):
        raise RobotFileError(f"a part is more than {1e-3 * _FURTHEST_MM:g} m away; lengths are metres, correct pos")
    world_T_base = _frame(data.xmat[root], data.xpos[root])
    world_T_tip = _frame(data.xmat[end], data.xpos[end])
    if at_site is not None:
        world_T_tip = _frame(data.site_xmat[at_site], data.site_xpos[at_site])
    places = [_frame(world_T_base[:3, :3], data.xanchor[j]) for j in numbers]  # of the joints' frames, as the base's
    following = [*(int(m.jnt_bodyid[j]) for j in numbers[1:]), -1]
    return {
        "joints": [
            _joint(mujoco, m, data, j, invert(before) @ place, place, after)
            for j, (before, place), after in zip(numbers, pairwise([world_T_base, *places]), following, strict=True)
        ],
        "last_T_tip": (invert(places[-1]) @ world_T_tip).tolist(),
        "gravity_m_s2": (world_T_base[:3, :3].T @ m.opt.gravity).tolist(),
        "base": bodies[root],
        "tip": tip,
    }


def _frame(turn: Array, place_m: Array) -> Array:
    return make_transform(np.reshape(turn, (3, 3)), 1e3 * place_m)


def _refuse_unserial(mujoco: Any, m: Any, numbers: list[int]) -> None:
    kinds = mujoco.mjtJoint
    for j in numbers:
        if int(m.jnt_type[j]) not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
            raise RobotFileError(f"joint {m.joint(j).name!r} is a ball or free joint; name a base behind it")
        if j in m.eq_obj1id[m.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)]:
            raise RobotFileError(f"joint {m.joint(j).name!r} follows another by <equality>; name a tip before it")


def _joint(mujoco: Any, m: Any, data: Any, j: int, before: Array, place: Array, following: int) -> dict[str, Any]:
    """Fields of a `ChainJoint`, with the mass of all that hangs on its body up to the arm's next one."""
    body, turns = int(m.jnt_bodyid[j]), int(m.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_HINGE)
    inside = {body} - {following}  # of two joints of one body the first carries nothing of its own
    for other in range(body + 1, m.nbody):  # parents come first
        inside |= {other} if int(m.body_parentid[other]) in inside and other != following else set()
    masses = m.body_mass[sorted(inside)]
    total = float(masses.sum())
    centre = 1e3 * masses @ data.xipos[sorted(inside)] / total if total else place[:3, 3]
    low, high = (m.jnt_range[j] * (1.0 if turns else 1e3)).tolist() if m.jnt_limited[j] else (None, None)
    return {
        "name": m.joint(j).name or f"joint{j + 1}",
        "before_T_joint": before.tolist(),
        "axis": (place[:3, :3].T @ data.xaxis[j]).tolist(),
        "type": "revolute" if turns else "prismatic",
        "min": low,
        "max": high,
        "mass_kg": total,
        "com_mm": apply(invert(place), centre).tolist(),
    }
