"""An arm as its URDF has it and as it is, an instrument, and the files that an owner has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

# Origin of each joint in the one before (m, rad as roll, pitch, yaw), then the flange; each joint turns about its z.
_ORIGINS = (
    ((0.0, 0.0, 0.22), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.19), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, -0.47, 0.0), (0.0, 0.0, 0.0)),
    ((0.06, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.41), (np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.085), (0.0, 0.0, 0.0)),
)
LIMITS_DEG = (170.0, 110.0, 140.0, 175.0, 115.0, 180.0)
_MASS_KG = (14.0, 12.0, 6.0, 5.0, 2.5, 0.8)
_COM_M = ((0, 0, 0.05), (0, -0.22, 0.03), (0.02, 0, 0), (0, 0, 0.2), (0, 0, 0.01), (0, 0, 0.03))
_G = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Arm:
    """Six joints by their origins; what is told of it is its URDF."""

    origins: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = _ORIGINS
    tool_m: tuple[float, float, float] = (0.03, -0.02, 0.14)
    mass_kg: tuple[float, ...] = _MASS_KG

    def frames(self, q_rad: Array) -> list[Array]:
        """Frames of the joints after their turn, and of the flange, (4, 4) each."""
        at, out = np.eye(4), []
        for (xyz, rpy), angle in zip(self.origins, [*q_rad, 0.0], strict=True):
            at = at @ placed(xyz, rpy) @ placed((0, 0, 0), (0, 0, angle))
            out.append(at)
        return out

    def tool(self, q_rad: Array) -> Array:
        """Place of the tool point in the base, m."""
        return (self.frames(q_rad)[-1] @ np.array([*self.tool_m, 1.0]))[:3]

    def torques(self, q_rad: Array, payload_kg: float = 0.0) -> Array:
        """Torque of gravity about each joint's axis, Nm; the payload hangs at the tool point."""
        frames = self.frames(q_rad)
        bodies = [(m, (f @ np.array([*c, 1.0]))[:3]) for m, c, f in zip(self.mass_kg, _COM_M, frames, strict=False)]
        bodies.append((payload_kg, self.tool(q_rad)))
        return np.array(
            [
                sum(frame[:3, 2] @ np.cross(place - frame[:3, 3], mass * _G) for mass, place in bodies[j:])
                for j, frame in enumerate(frames[:-1])
            ]
        )

    def urdf(self, name: str = "shop_arm") -> str:
        """URDF of the arm with masses; the tool point is the tip."""
        links = ["base_link", *(f"link_{j}" for j in range(1, 7)), "flange", "tool_point"]
        out = [f'<robot name="{name}">', '  <link name="base_link"/>']
        for j, mass in enumerate(self.mass_kg):
            com = " ".join(f"{v:.6g}" for v in _COM_M[j])
            out.append(
                f'  <link name="link_{j + 1}"><inertial><origin xyz="{com}"/><mass value="{mass:.6g}"/>'
                '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>'
            )
        out += ['  <link name="flange"/>', '  <link name="tool_point"/>']
        joints = [*self.origins, (self.tool_m, (0.0, 0.0, 0.0))]
        for j, (xyz, rpy) in enumerate(joints):
            kind = "revolute" if j < 6 else "fixed"
            limit = np.radians(LIMITS_DEG[j]) if j < 6 else 0.0
            more = f'<axis xyz="0 0 1"/><limit lower="{-limit:.6g}" upper="{limit:.6g}" effort="99" velocity="2"/>'
            out.append(
                f'  <joint name="joint_{j + 1}" type="{kind}"><parent link="{links[j]}"/><child link="{links[j + 1]}"/>'
                f'<origin xyz="{" ".join(f"{v:.9g}" for v in xyz)}" rpy="{" ".join(f"{v:.12g}" for v in rpy)}"/>'
                f"{more if j < 6 else ''}</joint>"
            )
        return "\n".join([*out, "</robot>"]) + "\n"


def placed(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> Array:
    """Frame of an origin as URDF has it: turned about the fixed x, y, z in this order."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    out = np.eye(4)
    out[:3, :3] = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    out[:3, 3] = xyz
    return out


@dataclass(frozen=True)
class Visit:
    """What happens at each pose of a session: arrays over the poses."""

    q_rad: Array  # (N, 6) as commanded
    payload_kg: Array  # (N,)
    temperature_c: Array  # (N,)
    approach: Array  # (N, 6) the side from which each joint came, -1 or 1


MARKER_M = (0.02, 0.03, 0.05)  # of `marker_session`, on the flange
CAMERA_MM = np.array([1600.0, 200.0, 700.0])  # of `marker_session`, in the base's frame

Change = Callable[[Visit, Arm], Array]  # (N, 6) what each joint stands off, rad


@dataclass(frozen=True)
class Shop:
    """A measured session, from which the files are written."""

    arm: Arm  # as it is
    told: Arm  # as its URDF has it
    visit: Visit
    points_mm: Array  # (N, 3) in the instrument's frame
    columns: tuple[str, ...] = ()  # of conditions that the sheet has, too
    sigma_mm: float = 0.03
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    more: Mapping[str, Sequence[str]] = field(default_factory=dict)  # further columns of the sheet, a text each pose

    def write(self, folder: Path, *, q_rad: Array | None = None, points_mm: Array | None = None) -> Path:
        """URDF and one sheet; joint values and points may be written as an owner got them wrong."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "arm.urdf").write_text(self.told.urdf(), encoding="utf-8")
        q_deg = np.degrees(self.visit.q_rad if q_rad is None else q_rad)
        points = self.points_mm if points_mm is None else points_mm
        head = ["pose", *(f"q{j}_deg" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
        rows = [
            [f"P{k + 1:03d}", *(f"{v:.6f}" for v in q), *(f"{v:.4f}" for v in p)]
            for k, (q, p) in enumerate(zip(q_deg, points, strict=True))
        ]
        if "payload_kg" in self.columns:
            head.append("payload_kg")
            rows = [[*row, f"{v:.3f}"] for row, v in zip(rows, self.visit.payload_kg, strict=True)]
        if "temperature_c" in self.columns:
            head.append("temperature_c")
            rows = [[*row, f"{v:.2f}"] for row, v in zip(rows, self.visit.temperature_c, strict=True)]
        if "approach" in self.columns:
            head += [f"approach{j}" for j in range(1, 7)]
            rows = [[*row, *(f"{int(v)}" for v in side)] for row, side in zip(rows, self.visit.approach, strict=True)]
        for name, texts in self.more.items():
            head.append(name)
            rows = [[*row, text] for row, text in zip(rows, texts, strict=True)]
        (folder / "measured.csv").write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n", encoding="utf-8")
        return folder


def real_arm(nominal: Arm, links: float, rng: np.random.Generator) -> Arm:
    """The arm whose links are off by 0.3 mm and 0.02 deg, times `links`."""
    origins = tuple(
        (tuple(np.add(xyz, links * 3e-4 * rng.normal(size=3))), tuple(np.add(rpy, links * 3.5e-4 * rng.normal(size=3))))
        for xyz, rpy in nominal.origins
    )
    return replace(nominal, origins=origins)


def session(
    seed: int, *, poses: int = 60, reach_deg: float = 360.0, sigma_mm: float = 0.03, links: float = 1.0,
    told: Arm | None = None, change: Change | None = None, columns: tuple[str, ...] = (),
    moved_mm: Callable[[Visit], Array] | None = None,
) -> Shop:  # fmt: skip
    """A session of an arm whose links are off by 0.3 mm and 0.02 deg (times `links`) and more.

    Args:
        reach_deg: the joints stay within this about the middle.
        told: the arm of the URDF, where it is not the arm's own nominal one.
        change: what the joints stand off at each pose.
        moved_mm: (N, 3) what each measured point stands off, in the instrument's frame.
    """
    rng = np.random.default_rng(seed)
    nominal = Arm()
    arm = real_arm(nominal, links, rng)
    limits = np.radians(np.minimum(LIMITS_DEG, reach_deg))
    q_rad = np.array([above_table(arm, limits, rng) for _ in range(poses)])
    visit = Visit(
        q_rad,
        rng.choice([0.0, 4.0], poses) if "payload_kg" in columns else np.zeros(poses),
        21.0 + 9.0 * (1.0 - np.exp(-np.arange(poses) / 25.0)),
        rng.choice([-1.0, 1.0], (poses, 6)),
    )
    off = np.zeros((poses, 6)) if change is None else change(visit, arm)
    at_m = np.array([arm.tool(q) for q in q_rad + off])
    stand = placed(tuple(rng.uniform(-2.0, 2.0, 3)), tuple(rng.uniform(-3.0, 3.0, 3)))
    points_mm = 1e3 * (at_m @ stand[:3, :3].T + stand[:3, 3]) + sigma_mm * rng.normal(size=(poses, 3))
    if moved_mm is not None:
        points_mm = points_mm + moved_mm(visit)
    return Shop(arm, nominal if told is None else told, visit, points_mm, columns, sigma_mm, rng)


def in_sockets(seed: int, *, sigma_mm: float = 0.1, postures: int = 6, places: int = 4, seat_mm: float = 0.0) -> Shop:
    """A session without an instrument: the ball in four sockets of a printed plate, which lay at up to four places.

    sigma_mm  # of each socket's place on the plate, the same at every visit; seat_mm  # of how the ball sits at each
    """
    rng = np.random.default_rng(seed)
    nominal = Arm()
    arm = real_arm(nominal, 1.0, rng)
    plate_mm = np.array([[0.0, 0.0, 0.0], [120.0, 0.0, 0.0], [0.0, 80.0, 0.0], [120.0, 80.0, 0.0]])
    printed_mm = plate_mm + sigma_mm * rng.normal(size=plate_mm.shape)
    limits = np.radians(LIMITS_DEG)
    q_rad, points_mm, setups = [], [], []
    stands = (("front", (0.55, 0.0)), ("left", (0.1, 0.55)), ("right", (0.2, -0.5)), ("far", (0.7, 0.25)))
    for name, middle_m in stands[:places]:
        turned = placed((*middle_m, rng.uniform(0.02, 0.2)), (0.0, 0.0, rng.uniform(-3.0, 3.0)))
        for nominal_mm, socket_mm in zip(plate_mm, printed_mm, strict=True):
            at_m = (turned @ np.array([*(socket_mm / 1e3), 1.0]))[:3]
            for _ in range(postures):
                sits_m = at_m if not seat_mm else at_m + 1e-3 * seat_mm * rng.normal(size=3)
                q_rad.append(_reaching(arm, sits_m, limits, rng))
                points_mm.append(nominal_mm)
                setups.append(name)
    visits = len(q_rad)
    visit = Visit(np.array(q_rad), np.zeros(visits), np.full(visits, 21.0), np.ones((visits, 6)))
    return Shop(arm, nominal, visit, np.array(points_mm), (), sigma_mm, rng, {"setup": setups})


def _reaching(arm: Arm, at_m: Array, limits: Array, rng: np.random.Generator) -> Array:
    """Joint values, rad, some of many with which the tool point is at a place."""
    while True:
        start = 0.9 * rng.uniform(-limits, limits)
        bounds = (-0.98 * limits, 0.98 * limits)
        found = least_squares(lambda q: 1e3 * (arm.tool(q) - at_m), start, bounds=bounds, max_nfev=60)
        if np.abs(found.fun).max() < 1e-6:
            return np.asarray(found.x)


def marker_session(
    seed: int, *, links: float = 0.0, sigma_mm: float = 0.2, sigma_rad: float = 5e-4
) -> tuple[Shop, str]:
    """A marker on the flange before a camera in the room, and the poses that the camera's program wrote as CSV."""
    shop = session(seed, poses=40, links=links)
    rng = shop.rng
    flange_marker = placed(MARKER_M, tuple(rng.uniform(-0.5, 0.5, 3)))
    camera_base = np.linalg.inv(placed(tuple(CAMERA_MM / 1e3), (-2.0, 0.1, 1.7)))
    rows = ["pose,x,y,z,qx,qy,qz,qw"]
    for k, q in enumerate(shop.visit.q_rad):
        seen = camera_base @ shop.arm.frames(q)[-1] @ flange_marker
        turn = Rotation.from_matrix(seen[:3, :3]) * Rotation.from_rotvec(sigma_rad * rng.normal(size=3))
        place_m = seen[:3, 3] + 1e-3 * sigma_mm * rng.normal(size=3)
        rows.append(",".join([f"P{k + 1:03d}", *(f"{v:.7f}" for v in (*place_m, *turn.as_quat()))]))
    return shop, "\n".join(rows) + "\n"


def above_table(arm: Arm, limits: Array, rng: np.random.Generator) -> Array:
    """Joint values, rad, within limits, with the tool point above the floor."""
    while True:
        q_rad = rng.uniform(-limits, limits)
        if arm.tool(q_rad)[2] > 0.05:
            return q_rad
