"""Arms as URDF text, measured by a tracker at a ball that their files do not know; the truth is computed here alone."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from calib.statistics import rms_length
from tests.support.chains import joint, link, urdf_of

UR_LIKE = (
    ("0 0 0.1807", "0 0 0", "0 0 1"),
    ("0 0 0", "1.570796327 0 0", "0 0 1"),
    ("-0.6127 0 0", "0 0 0", "0 0 1"),
    ("-0.57155 0 0.17415", "0 0 0", "0 0 1"),
    ("0 -0.11985 0", "1.570796327 0 0", "0 0 1"),
    ("0 0.11655 0", "1.570796327 3.141592653589793 3.141592653589793", "0 0 1"),
)
SEVEN_AXES = (
    ("0 0 0.333", "0 0 0", "0 0 1"),
    ("0 0 0", "-1.5707963 0 0", "0 0 1"),
    ("0 -0.316 0", "1.5707963 0 0", "0 0 1"),
    ("0.0825 0 0", "1.5707963 0 0", "0 0 1"),
    ("-0.0825 0.384 0", "-1.5707963 0 0", "0 0 1"),
    ("0 0 0", "1.5707963 0 0", "0 0 1"),
    ("0.088 0 0", "1.5707963 0 0", "0 0 1"),
)
TIP = ("0 0.0922 0.01", "0 0 1.57")  # of link ee_link on the last
BALL_IN_TIP_MM = np.array([50.0, -30.0, 120.0])


def numbers(text: str) -> np.ndarray:
    return np.array([float(part) for part in text.split()])


def placed(xyz_mm: np.ndarray, turn: Rotation) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn.as_matrix(), xyz_mm
    return out


@dataclass(frozen=True)
class Arm:
    """Origins (4, 4) and axes of the joints that turn, the tip on the last of them; mm and rad."""

    origins: tuple[np.ndarray, ...]
    axes: tuple[np.ndarray, ...]
    tip: np.ndarray
    zeros: np.ndarray

    def last(self, q: np.ndarray) -> np.ndarray:
        """(4, 4) the last joint's frame, which turns with it."""
        at = np.eye(4)
        for origin, axis, angle in zip(self.origins, self.axes, q + self.zeros, strict=True):
            at = at @ origin @ placed(np.zeros(3), Rotation.from_rotvec(axis * angle))
        return at

    def tip_at(self, q: np.ndarray) -> np.ndarray:
        return self.last(q) @ self.tip


def urdf_text(joints: tuple[tuple[str, str, str], ...]) -> str:
    names = ["base_link", *(f"link_{k}" for k in range(1, len(joints) + 1)), "ee_link"]
    moving = [
        joint(f"joint_{k}", names[k - 1], names[k], xyz, rpy, axis) for k, (xyz, rpy, axis) in enumerate(joints, 1)
    ]
    fixed = joint("ee_fixed_joint", names[-2], names[-1], *TIP, type="fixed")
    return urdf_of("".join(map(link, names)), "".join([*moving, fixed]))


def read_urdf(text: str) -> Arm:
    """The arm of a URDF as `urdf_text` writes it, whatever its origins have become."""
    joints = {one.get("name"): one for one in ET.fromstring(text).findall("joint")}

    def origin(of: ET.Element) -> np.ndarray:
        found = of.find("origin")
        return placed(1e3 * numbers(found.get("xyz", "")), Rotation.from_euler("xyz", numbers(found.get("rpy", ""))))

    moving = [joints[name] for name in sorted(joints) if re.fullmatch(r"joint_\d", name or "")]
    axes = []
    for one in moving:
        axis = one.find("axis")
        axes.append(numbers(axis.get("xyz", "")))
    tip = origin(joints["ee_fixed_joint"])
    return Arm(tuple(map(origin, moving)), tuple(axes), tip, np.zeros(len(axes)))


def as_built(nominal: Arm, rng: np.random.Generator) -> Arm:
    """The arm with errors of 1 mm and 2 mrad an axis in every origin, and of 2 mrad in every joint's zero."""
    origins = [
        origin @ placed(rng.normal(0.0, 1.0, 3), Rotation.from_euler("xyz", rng.normal(0.0, 2e-3, 3)))
        for origin in nominal.origins
    ]
    return Arm(tuple(origins), nominal.axes, nominal.tip, rng.normal(0.0, 2e-3, len(nominal.axes)))


@dataclass(frozen=True)
class Measured:
    """An arm as drawn and as built, and the poses at which its ball was measured."""

    nominal: Arm
    true: Arm
    q: np.ndarray  # (N, n)
    is_test: np.ndarray  # (N,)
    points_mm: np.ndarray  # (N, 3) in the tracker's frame
    ball_mm: np.ndarray  # (3,) in the frame of the tip


def measured(
    joints: tuple[tuple[str, str, str], ...],
    folder: Path,
    seed: int = 0,
    poses: int = 90,
    ball_mm: np.ndarray = BALL_IN_TIP_MM,
) -> Measured:
    """Files as a user has them: robot.urdf, joints.csv, points.csv, targets.csv."""
    rng = np.random.default_rng(seed)
    text = urdf_text(joints)
    nominal = read_urdf(text)
    true = as_built(nominal, rng)
    count = len(joints)
    q = np.round(rng.uniform(-1.6, 1.6, (poses, count)), 6)
    q[:, 1] = np.round(q[:, 1] * 0.6 - 0.5, 6)
    is_test = np.arange(poses) % 3 == 2
    ball = true.tip @ np.append(ball_mm, 1.0)
    tracker = placed(rng.uniform(-2000.0, 2000.0, 3), Rotation.random(rng=rng))
    exact = np.array([(tracker @ true.last(at) @ ball)[:3] for at in q])
    points_mm = exact + rng.normal(0.0, 0.05, exact.shape)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(text)
    columns = [f"q{k}_rad" for k in range(1, count + 1)]
    names = [f"P{k}" for k in range(poses)]
    joints_rad = pd.DataFrame(q, columns=columns)
    joints_rad.insert(0, "pose", names)
    joints_rad.insert(1, "role", np.where(is_test, "test", "train"))
    joints_rad.to_csv(folder / "joints.csv", index=False)
    pd.DataFrame(points_mm, names, ["x_mm", "y_mm", "z_mm"]).to_csv(folder / "points.csv", index_label="pose")
    targets = rng.uniform(-1.4, 1.4, (200, count))
    targets[:, 1] = targets[:, 1] * 0.6 - 0.5
    degrees = [f"q{k}_deg" for k in range(1, count + 1)]
    targets_deg = pd.DataFrame(np.degrees(targets), [f"T{k}" for k in range(200)], degrees)
    targets_deg.to_csv(folder / "targets.csv", index_label="pose")
    return Measured(nominal, true, q, is_test, points_mm, ball_mm)


def rigid(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) by least squares."""
    mid, to = source.mean(axis=0), target.mean(axis=0)
    turn = Rotation.align_vectors(target - to, source - mid)[0]
    return placed(to - turn.apply(mid), turn)


def held_out_mm(arm: Arm, seen: Measured, ball_mm: np.ndarray | None = None) -> float:
    """3D RMS at the test poses of an arm with its ball in the tip's frame; None: where the training poses have it."""
    train, frames = ~seen.is_test, np.array([arm.tip_at(at) for at in seen.q])
    if ball_mm is None:
        ball_mm = np.zeros(3)
        for _ in range(200):
            tracker = rigid((frames @ np.append(ball_mm, 1.0))[train, :3], seen.points_mm[train])
            turns = (tracker @ frames)[train, :3, :3].reshape(-1, 3)
            away = seen.points_mm[train] - (tracker @ frames)[train, :3, 3]
            found = np.linalg.lstsq(turns, away.ravel(), rcond=None)[0]
            ball_mm = ball_mm + (found - ball_mm)
    at_mm = (frames @ np.append(ball_mm, 1.0))[:, :3]
    tracker = rigid(at_mm[train], seen.points_mm[train])
    off = at_mm @ tracker[:3, :3].T + tracker[:3, 3] - seen.points_mm
    return rms_length(off[seen.is_test])


def tip_off(arm: Arm, seen: Measured) -> tuple[float, float]:
    """How far the tip's attitude is off that of the true arm at the test poses, rad: mean, and of the nominal arm.

    One turn of the whole arm is taken out: no tracker knows it.
    """
    out = []
    true = Rotation.from_matrix([seen.true.tip_at(at)[:3, :3] for at in seen.q[seen.is_test]])
    for one in (arm, seen.nominal):
        off = true * Rotation.from_matrix([one.tip_at(at)[:3, :3] for at in seen.q[seen.is_test]]).inv()
        out.append(float((off.mean().inv() * off).magnitude().mean()))
    return out[0], out[1]
