"""A cell in MuJoCo: an arm's bodies, its jig as a mesh, floor and boxes; rays and contacts are the engine's own.

The chain is built from a robot's table anew, in nested bodies; nothing of `calib.kinematics.chain` or `calib.workcell`
is used. Lengths come in mm and are metres inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Box
from calib.kinematics.robot import Robot
from tests.support.mujoco_arm import mujoco

JIG, FLOOR = "jig", "floor"
_AZIMUTHS = np.radians([180.0, 300.0, 60.0])  # of the edges opposite to faces 1, 2, 3; normal 1 is at 0
_INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
_ELSEWHERE = 'pos="1 2 3" quat="0.9 0.1 0.2 0.3"'  # until it is placed: what stands in its body's frame cannot be moved
_MISS_M = 1e-5  # a ray that ends so near its point has met it


@dataclass(frozen=True)
class Rod:
    """A capsule along a row's d or a, whose far end may stop early, or between two points of the link's frame."""

    name: str
    link: int
    radius_mm: float
    along: str  # "d", "a" or "points"
    cut_mm: float = 0.0
    start_mm: tuple[float, ...] = ()
    end_mm: tuple[float, ...] = ()


class MujocoCell:
    """A cell in MuJoCo that is put to one pose after another."""

    def __init__(
        self,
        robot: Robot,
        rods: Sequence[Rod],
        *,
        edge_mm: float = 60.0,
        floor_z_mm: float | None = None,
        boxes: Sequence[Box] = (),
    ) -> None:
        self.robot, self.rods = robot, rods
        flat = np.sqrt(2.0 / 3.0)
        self.edges = np.array([[flat * np.cos(a), flat * np.sin(a), np.sqrt(1.0 / 3.0)] for a in _AZIMUTHS])
        self.edges *= edge_mm / 1e3
        n, inner = robot.n_joints, ""
        for i in reversed(range(n + 1)):
            rest = _row(robot.table[i])
            parts = _INERTIAL + "".join(
                f'<geom name="{rod.name}" type="capsule" size="{rod.radius_mm / 1e3} 0.1" {_ELSEWHERE}/>'
                for rod in rods
                if rod.link == i
            )
            if i < n:
                axis, place = rest[2, :3], -rest[:3, :3].T @ rest[:3, 3]
                kind = "hinge" if robot.joints[i].is_revolute else "slide"
                parts += f'<joint type="{kind}" axis="{_text(axis)}" pos="{_text(place)}"/>'
            else:
                side = -1.0 if robot.tool.d_mm < 0 else 1.0
                turned = np.diag([1.0, -side, -side, 1.0])
                parts += f'<body name="{JIG}" {_pose(turned)}><geom name="{JIG}" type="mesh" mesh="{JIG}"/></body>'
            inner = f"<body {_pose(rest)}>{parts}{inner}</body>"
        first = robot.base.transform.copy()
        first[:3, 3] /= 1e3
        around = ""
        if floor_z_mm is not None:
            around = f'<geom name="{FLOOR}" type="plane" size="5 5 0.1" pos="0 0 {floor_z_mm / 1e3}"/>'
        for box in boxes:
            low, high = np.array(box.min_mm) / 1e3, np.array(box.max_mm) / 1e3
            middle, half = _text((high + low) / 2.0), _text((high - low) / 2.0)
            around += f'<geom name="{box.name}" type="box" size="{half}" pos="{middle}"/>'
        vertices = _text(np.concatenate([np.zeros((1, 3)), self.edges]).ravel())
        self.model = mujoco().MjModel.from_xml_string(
            f'<mujoco><compiler angle="radian"/><asset><mesh name="{JIG}" vertex="{vertices}"/></asset>'
            f"<worldbody>{around}<body {_pose(first)}>{inner}</body></worldbody></mujoco>"
        )
        self.data = mujoco().MjData(self.model)

    def stand(self, q: ArrayLike) -> None:
        """Put the arm to joints (n,), rad or mm."""
        q = np.asarray(q, dtype=float)
        for rod in self.rods:
            self._place(rod, q)
        self.data.qpos[:] = np.where(self.robot.is_revolute, q, q / 1e3)
        mujoco().mj_kinematics(self.model, self.data)

    def _place(self, rod: Rod, q: NDArray) -> None:
        geom = self.model.geom(rod.name)
        if rod.along == "points":
            start, end = np.array(rod.start_mm) / 1e3, np.array(rod.end_mm) / 1e3
        else:
            row = self.robot.table[rod.link].copy()
            if rod.link < self.robot.n_joints and not self.robot.joints[rod.link].is_revolute:
                row[2] += q[rod.link]
            link_R_aside = _row(np.array([0.0, row[1], 0.0, 0.0, row[4]]))[:3, :3].T  # before alpha and beta
            knee = link_R_aside @ [-row[0] / 1e3, 0.0, 0.0]
            origin = knee - link_R_aside @ [0.0, 0.0, row[2] / 1e3]
            start, end = (origin, knee) if rod.along == "d" else (knee, np.zeros(3))
        length = np.linalg.norm(end - start)
        end = start + max(1.0 - rod.cut_mm / 1e3 / max(length, 1e-9), 0.0) * (end - start)
        length = np.linalg.norm(end - start)
        along = (end - start) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
        turn = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0]
        geom.pos[:], geom.quat[:] = 0.5 * (start + end), turn.as_quat(scalar_first=True)
        geom.size[1] = max(0.5 * length, 1e-6)
        geom.rbound[:] = geom.size[0] + geom.size[1]

    @property
    def apex_mm(self) -> NDArray:
        return 1e3 * self.data.body(JIG).xpos

    def steepest_deg(self, eye_mm: ArrayLike) -> float:
        """Largest angle, deg, between the line to the eye (3,) and the normal of a face at the apex."""
        frame = self.data.body(JIG)
        edges = self.edges @ frame.xmat.reshape(3, 3).T
        sight = np.asarray(eye_mm) / 1e3 - frame.xpos
        normals = -edges / np.linalg.norm(edges, axis=1, keepdims=True)  # of a cube: opposite to its edge
        return float(np.degrees(np.arccos(np.clip(normals @ sight / np.linalg.norm(sight), -1.0, 1.0)).max()))

    def hidden(self, eye_mm: ArrayLike, per_edge: int = 6) -> list[str]:
        """Names of the bodies that rays from the eye (3,) meet before the points of a raster over the faces."""
        frame = self.data.body(JIG)
        edges = self.edges @ frame.xmat.reshape(3, 3).T
        eye = np.asarray(eye_mm, dtype=float) / 1e3
        steps = (np.arange(per_edge) + 0.5) / (per_edge + 0.5)
        met, what = [], np.zeros(1, dtype=np.int32)
        for one, other in ((1, 2), (2, 0), (0, 1)):
            for s in steps:
                for t in steps[steps + s < 0.97]:
                    ray = frame.xpos + s * edges[one] + t * edges[other] - eye
                    share = mujoco().mj_ray(self.model, self.data, eye, ray, None, 1, -1, what)
                    if 0.0 <= share < 1.0 - _MISS_M:
                        met.append(self.model.geom(int(what[0])).name)
        return met

    def meet(self, one: str, other: str) -> bool:
        """Whether two bodies touch, by the engine's distance of two solids."""
        first, second = self.model.geom(one).id, self.model.geom(other).id
        return mujoco().mj_geomDistance(self.model, self.data, first, second, 0.1, None) < 0.0


def _row(row: NDArray) -> NDArray:
    """The transform of one row of a table at rest, m: Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta)."""
    a, alpha, d, theta, beta = row
    out = np.eye(4)
    turn = Rotation.from_euler("z", theta)
    out[:3, 3] = turn.apply([a / 1e3, 0.0, d / 1e3])
    out[:3, :3] = (turn * Rotation.from_euler("x", alpha) * Rotation.from_euler("y", beta)).as_matrix()
    return out


def _text(values: ArrayLike) -> str:
    return " ".join(f"{v:.17g}" for v in np.asarray(values, dtype=float).ravel())


def _pose(frame: NDArray) -> str:
    quat = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True)
    return f'pos="{_text(frame[:3, 3])}" quat="{_text(quat)}"'
