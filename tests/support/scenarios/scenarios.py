"""Scenarios: what is wrong with an arm or with its sheet, the folder that shows it, and which answers are right."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.scenarios.shop import CAMERA_MM, Arm, Array, Shop, Visit, in_sockets, marker_session, session


@dataclass(frozen=True)
class Found:
    """What an agent came to: what the tools told, and what they claim."""

    told: str  # texts of all answers
    document: Mapping[str, Any]  # of the diagnosis; empty where it did not come to one
    calibrated: Mapping[str, Any]  # of `calibrate`

    @property
    def claimed(self) -> set[str]:
        """Effects that are claimed as the cause."""
        return set(self.document.get("missing", ())) if self.document.get("verdict") == "named" else set()


@dataclass(frozen=True)
class Scenario:
    """A folder with a known cause."""

    name: str
    owner_says: str
    write: Callable[[Path], Path]
    is_right: Callable[[Found], bool]
    may_claim: Collection[str] = ()  # effects that are true, or the same at these poses
    options: tuple[tuple[str, Any], ...] = ()  # what the owner can tell beside the files


def _named(*names: str) -> Callable[[Found], bool]:
    """Whether one of these is claimed, or stands in the open set."""

    def holds(found: Found) -> bool:
        open_ones = {name for one in found.document.get("open_sets", ()) for name in one["effects"]}
        open_ones |= set(found.document.get("ambiguous_set", ()))
        return bool((found.claimed | open_ones) & set(names))

    return holds


def _says(*parts: str) -> Callable[[Found], bool]:
    return lambda found: all(part in found.told for part in parts)


def _geometry(found: Found) -> bool:
    """Whether nothing but geometry is told, and it mends the error."""
    return found.document.get("verdict") == "adequate" and not found.claimed


def _tool_off(found: Found) -> bool:
    return found.document.get("tool_found_mm") is not None and not found.claimed


def _wrong(make: Callable[[Shop], dict[str, Array]], **more: Any) -> Callable[[Path], Path]:
    """A writer of a session whose sheet has what `make` returns."""

    def write(folder: Path) -> Path:
        shop = session(**more)
        return shop.write(folder, **make(shop))

    return write


def _plain(**more: Any) -> Callable[[Path], Path]:
    return lambda folder: session(**more).write(folder)


def _only(joint: int, by_pose: Callable[[Visit, Arm], Array]) -> Callable[[Visit, Arm], Array]:
    """What one joint, counted from 1, stands off."""

    def change(visit: Visit, arm: Arm) -> Array:
        off = np.zeros((len(visit.q_rad), 6))
        off[:, joint - 1] = by_pose(visit, arm)
        return off

    return change


def _soft(joint: int, rad_per_nm: float) -> Callable[[Visit, Arm], Array]:
    def by_pose(visit: Visit, arm: Arm) -> Array:
        each = zip(visit.q_rad, visit.payload_kg, strict=True)
        return np.array([rad_per_nm * arm.torques(q, kg)[joint - 1] for q, kg in each])

    return _only(joint, by_pose)


def _since(share: float, values: Array) -> Callable[[Visit], Array]:
    """Points that stand off since a share of the session."""
    return lambda visit: np.where(np.arange(len(visit.q_rad))[:, None] >= share * len(visit.q_rad), values, 0.0)


def _swapped(shop: Shop) -> dict[str, Array]:
    return {"q_rad": shop.visit.q_rad[:, [0, 1, 2, 4, 3, 5]]}


def _signed(shop: Shop) -> dict[str, Array]:
    return {"q_rad": shop.visit.q_rad * np.array([1, 1, -1, 1, 1, 1])}


def _shifted(shop: Shop) -> dict[str, Array]:
    return {"points_mm": np.roll(shop.points_mm, 1, axis=0)}


def _blundered(shop: Shop) -> dict[str, Array]:
    points_mm = shop.points_mm.copy()
    points_mm[[7, 31]] += [[6.0, -4.0, 3.0], [-5.0, 7.0, 2.0]]
    return {"points_mm": points_mm}


def _mirrored(shop: Shop) -> dict[str, Array]:
    return {"points_mm": shop.points_mm * np.array([1.0, -1.0, 1.0])}


def _metres_as_mm(shop: Shop) -> dict[str, Array]:
    return {"points_mm": shop.points_mm / 25.4}  # inches under a heading of millimetres


def _of_another_controller(folder: Path) -> Path:
    """A sheet with the controller's own poses, which reckons with a third link that is 10 mm longer."""
    shop = session(23)
    origins = list(shop.told.origins)
    (x, y, z), rpy = origins[4]
    origins[4] = ((x, y, z + 0.010), rpy)
    own = replace(shop.told, origins=tuple(origins))
    poses = np.array([own.frames(q)[-1] for q in shop.visit.q_rad])
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    values = np.hstack([poses[:, :3, 3], turns])
    more = {f"actual_TCP_pose_{k}": [f"{v:.6f}" for v in values[:, k]] for k in range(6)}
    return replace(shop, more=more).write(folder)


def camera_files(shop: Shop, seen: str, folder: Path) -> Path:
    """Folder with the joint values, and the poses of a marker on the flange as a program of the camera wrote them."""
    shop.write(folder)
    lines = (folder / "measured.csv").read_text(encoding="utf-8").splitlines()
    (folder / "joints.csv").write_text("\n".join(",".join(line.split(",")[:7]) for line in lines) + "\n")
    (folder / "measured.csv").unlink()
    (folder / "marker.csv").write_text(seen, encoding="utf-8")
    return folder


def _camera_is_found(found: Found) -> bool:
    """Whether the camera stands within its sigmas, and a millimetre, of where it is, and the arm is not blamed."""
    place = found.calibrated.get("hand_eye")
    if not place or found.claimed:
        return False
    off_mm = np.array(place[0]["parent_T_camera"])[:3, 3] - CAMERA_MM
    sigma_mm = np.sqrt(np.diag(np.array(place[0]["covariance"]))[:3])
    return bool(np.all(np.abs(off_mm) < 3.5 * sigma_mm) and np.all(np.abs(off_mm) < 1.0))


def _sister() -> Arm:
    nominal = Arm()
    origins = list(nominal.origins)
    origins[2] = ((0.0, -0.5295, 0.0), origins[2][1])
    origins[4] = ((0.0, 0.0, 0.4655), origins[4][1])
    return replace(nominal, origins=tuple(origins))


def _zero_off() -> Arm:
    """The URDF of an arm whose second joint was mastered 0.9 deg off."""
    nominal = Arm()
    origins = list(nominal.origins)
    xyz, rpy = origins[1]
    # Turned about its own z before the joint turns: yaw in the frame of the joint.
    turned = (rpy[0], rpy[1] + np.radians(0.9), rpy[2])
    origins[1] = (xyz, turned)
    return replace(nominal, origins=tuple(origins))


_WAVES = _only(3, lambda visit, _: np.radians(0.05) * np.sin(visit.q_rad[:, 2] + 0.7))
_PLAY = _only(4, lambda visit, _: np.radians(0.06) * visit.approach[:, 3])
_SLIP = _only(2, lambda visit, _: np.where(np.arange(len(visit.q_rad)) >= 33, np.radians(0.12), 0.0))

SCENARIOS = (
    Scenario("nothing", "is it good enough?", _plain(seed=1), _geometry),
    Scenario("exact_arm", "is it good enough?", _plain(seed=2, links=0.0), _geometry),
    Scenario("joint_zero", "the arm is 1 cm off everywhere", _plain(seed=3, told=_zero_off()), _geometry),
    Scenario(
        "wrong_tool", "the tool is 4 cm from where I think",
        _plain(seed=4, told=replace(Arm(), tool_m=(0.0, 0.0, 0.11))), _tool_off,
    ),
    Scenario("sister_table", "the errors are centimetres", _plain(seed=5, told=_sister()), _says("a2")),
    Scenario("sign", "the errors are half a metre", _wrong(_signed, seed=6), _says("joint 3")),
    Scenario("columns", "the errors are half a metre", _wrong(_swapped, seed=7), _says("q4", "q5")),
    Scenario("rows", "the errors are half a metre", _wrong(_shifted, seed=8), _says("row")),
    Scenario("mirrored", "the errors are half a metre", _wrong(_mirrored, seed=9), _says("mirror")),
    Scenario("inches", "the errors are half a metre", _wrong(_metres_as_mm, seed=10), _says("25.4")),
    Scenario("blunders", "two poses look odd", _wrong(_blundered, seed=11), _says("P008", "P032")),
    Scenario(
        "soft_joint", "with the gripper it sags",
        _plain(seed=12, change=_soft(2, 2.5e-5), columns=("payload_kg",)), _named("joint_compliance"),
        ("joint_compliance",),
    ),
    Scenario(
        "play", "it depends on where it comes from", _plain(seed=13, change=_PLAY, columns=("approach",)),
        _named("backlash"), ("backlash",),
    ),
    Scenario(
        "gear_waves", "some places are worse than others", _plain(seed=14, change=_WAVES, poses=80),
        _named("transmission_error"), ("transmission_error", "encoder_eccentricity"),
    ),
    Scenario(
        "belt_slip", "after the crash test it was off", _plain(seed=15, change=_SLIP),
        _named("joint_step", "link_step"), ("joint_step",),
    ),
    Scenario(
        "tripod_kicked", "somebody ran into the tracker",
        _plain(seed=16, moved_mm=_since(0.55, np.array([0.4, -0.3, 0.2]))), _named("scanner_step", "target_step"),
        ("scanner_step",),
    ),
    Scenario(
        "warming", "it drifts in the morning",
        _plain(seed=17, columns=("temperature_c",),
               change=lambda visit, _: 2.5e-5 * (visit.temperature_c[:, None] - 21.0) * np.array([0, 1.0, 0, 0, 0, 0])),
        lambda found: found.document.get("verdict") in ("named", "ambiguous", "unexplained"),
        ("thermal_growth", "warm_up", "motor_heat", "joint_step", "thermal_zero", "scanner_drift"),
    ),
    Scenario("few_poses", "I measured six poses", _plain(seed=18, poses=6), _says("poses")),
    Scenario(
        "one_corner", "I measured around the fixture", _plain(seed=19, poses=40, reach_deg=12.0),
        lambda found: not found.claimed and ("plan" in found.told or found.document.get("verdict") == "adequate"),
    ),
    Scenario(
        "coarse_instrument", "I used a ruler", _plain(seed=20, sigma_mm=1.0), lambda found: not found.claimed,
    ),
    Scenario(
        "printed_sockets", "I have a printed plate and a ball",
        lambda folder: in_sockets(21).write(folder),
        lambda found: not found.claimed and "leave the arm closed" in found.told,
    ),
    Scenario(
        "other_table", "the pendant shows another place", _of_another_controller,
        _says("disagree by", "different tables"),
    ),
    Scenario(
        "camera_mount", "the camera's picks are off",
        lambda folder: camera_files(*marker_session(22), folder), _camera_is_found,
        options=(("robot", "camera_mount/arm.urdf"), ("joints", "camera_mount/joints.csv"),
                 ("marker_poses", "camera_mount/marker.csv")),
    ),
)  # fmt: skip
