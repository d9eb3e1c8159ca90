"""Cameras and boards on arms, simulated by scipy and OpenCV: truth that shares no code with what is tested."""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

ROBOT_FILE = Path(__file__).parents[2] / "calib" / "robots" / "rb5.toml"
MATRIX = np.array([[1150.0, 0.0, 630.0], [0.0, 1146.0, 492.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.11, 0.07, 0.0008, -0.0005, 0.01])
SIZE_PX = (1280, 960)
Array = np.ndarray


def transform(rotation: Rotation, xyz) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), xyz
    return out


def nominal_table() -> Array:
    """Rows a, alpha, d, theta, beta (mm, rad) of the joints of the built-in arm."""
    joints = tomllib.loads(ROBOT_FILE.read_text())["joints"]
    return np.array(
        [
            [j["a_mm"], *(np.radians(j[k]) for k in ("alpha_deg",)), j["d_mm"], np.radians(j["theta_deg"]),
             np.radians(j["beta_deg"])]
            for j in joints
        ]
    )  # fmt: skip


def flange(table: Array, q: Array) -> Array:
    """base_T_flange by elementary transforms Rz(theta + q) T(a, 0, d) Rx(alpha) Ry(beta)."""
    out = np.eye(4)
    for (a, alpha, d, theta, beta), angle in zip(table.tolist(), np.asarray(q).tolist(), strict=True):
        ct, st = math.cos(theta + angle), math.sin(theta + angle)
        ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
        out = out @ np.array(
            [
                [ct * cb - st * sa * sb, -st * ca, ct * sb + st * sa * cb, a * ct],
                [st * cb + ct * sa * sb, ct * ca, st * sb - ct * sa * cb, a * st],
                [-ca * sb, sa, ca * cb, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    return out


def joints_to(table: Array, wanted: Array, rng: np.random.Generator) -> Array | None:
    """Joint values that bring the flange to a pose, None where none was found from a random start."""

    def error(q):
        at = flange(table, q)
        turn = Rotation.from_matrix(at[:3, :3].T @ wanted[:3, :3]).as_rotvec()
        return np.concatenate([(at[:3, 3] - wanted[:3, 3]) / 300.0, turn])

    found = least_squares(error, rng.uniform(-2.0, 2.0, len(table)), max_nfev=60)
    q = (found.x + np.pi) % (2 * np.pi) - np.pi
    return q if found.cost < 1e-16 and abs(q[2]) < np.radians(160) else None


def look(rng: np.random.Generator, distance: tuple[float, float], tilt_deg: float) -> Array:
    """Random camera_T_board: the board before the camera, tilted, turned about the sight by any angle."""
    z = rng.uniform(*distance)
    x, y = z * rng.uniform([-0.22, -0.16], [0.22, 0.16])
    about = rng.uniform(0, 2 * np.pi)
    tilt = Rotation.from_rotvec(
        np.radians(tilt_deg) * np.sqrt(rng.uniform(0.15, 1)) * np.array([np.cos(about), np.sin(about), 0])
    )
    return transform(tilt * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)), [x, y, z])


@dataclass(frozen=True)
class Scene:
    """An arm with a camera on its flange or in the room, its poses, and what the camera sees."""

    on_flange: bool
    q: Array  # (N, n) rad
    parent_T_camera: Array
    parent_T_board: Array
    true_table: Array
    camera_T_board: Array  # (N, 4, 4), of the board's middle
    names: tuple[str, ...]
    distance: tuple[float, float] = (320.0, 480.0)
    tilt_deg: float = 40.0
    matrix: Array = field(default_factory=lambda: MATRIX)
    distortion: Array = field(default_factory=lambda: DISTORTION)
    driven: Callable[[Array], Array] = lambda q: q  # joints as they truly stand, from those that the arm reports

    @classmethod
    def draw(
        cls, rng: np.random.Generator, *, on_flange: bool, poses: int = 20, link_mm: float = 0.0, link_deg: float = 0.0,
        distance: tuple[float, float] = (320.0, 480.0), tilt_deg: float = 40.0,
        driven: Callable[[Array], Array] = lambda q: q,
    ) -> Scene:  # fmt: skip
        """Random scene; link errors are normal with these sigmas."""
        nominal = nominal_table()
        sigma = np.array([link_mm, np.radians(link_deg), link_mm, np.radians(link_deg), np.radians(link_deg)])
        true_table = nominal + rng.normal(size=nominal.shape) * sigma
        small = Rotation.from_rotvec(rng.normal(size=3) * 0.05)
        if on_flange:
            camera = transform(small * Rotation.from_euler("z", 0.5), rng.normal(size=3) * 5 + [40.0, -60.0, 70.0])
            board = transform(Rotation.from_euler("x", np.pi) * small, rng.normal(size=3) * 20 + [480.0, 60.0, 20.0])
        else:
            camera = transform(Rotation.from_euler("xz", [-100, -70], degrees=True) * small, [-150.0, -750.0, 500.0])
            camera = transform(Rotation.from_matrix(_facing(np.array([0.45, 0.9, -0.05]))), [150.0, -900.0, 450.0])
            board = transform(small * Rotation.from_euler("x", np.pi), rng.normal(size=3) * 5 + [10.0, 20.0, 45.0])
        empty = np.zeros((0, len(nominal)))
        none = np.zeros((0, 4, 4))
        scene = cls(on_flange, empty, camera, board, true_table, none, (), distance, tilt_deg, driven=driven)
        return scene.more_poses(rng, poses)

    def more_poses(self, rng: np.random.Generator, poses: int) -> Scene:
        """The same cell at new random poses."""
        nominal, camera, board = nominal_table(), self.parent_T_camera, self.parent_T_board
        q, seen = [], []
        while len(q) < poses:
            wanted = np.linalg.inv(look(rng, self.distance if self.on_flange else (400.0, 560.0), self.tilt_deg))
            pose = board @ wanted @ np.linalg.inv(camera)
            if not self.on_flange:
                pose = camera @ np.linalg.inv(wanted) @ np.linalg.inv(board)
            if (found := joints_to(nominal, pose, rng)) is None:
                continue
            true = flange(self.true_table, self.driven(found))
            q.append(found)
            seen.append(
                np.linalg.inv(true @ camera) @ board if self.on_flange else np.linalg.inv(camera) @ true @ board
            )
        names = tuple(f"p{i + 1}" for i in range(poses))
        return replace(self, q=np.array(q), camera_T_board=np.array(seen), names=names)

    def pixels(self, pose: int, board_mm: Array) -> Array:
        """Where corners (N, 3), about the board's middle, are seen, by OpenCV."""
        at = self.camera_T_board[pose]
        rotvec = Rotation.from_matrix(at[:3, :3]).as_rotvec()
        return cv2.projectPoints(board_mm, rotvec, at[:3, 3], self.matrix, self.distortion)[0].reshape(-1, 2)

    def flanges(self) -> Array:
        """Nominal base_T_flange (N, 4, 4)."""
        table = nominal_table()
        return np.array([flange(table, q) for q in self.q])

    def write_joints(self, path: Path) -> Path:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["pose", *(f"q{k + 1}_deg" for k in range(self.q.shape[1]))])
            for name, q in zip(self.names, self.q, strict=True):
                writer.writerow([name, *map(repr, np.degrees(q).tolist())])
        return path

    def render(
        self,
        pose: int,
        drawing: Array,
        size_mm: tuple[float, float],
        rng: np.random.Generator,
        *,
        mirrored=False,
        fine: int = 2,
    ) -> Array:
        """Image of a drawing of the whole board: rays through a lens, some to a pixel, blurred, noisy."""
        columns, rows = np.meshgrid(np.arange(SIZE_PX[0] * fine), np.arange(SIZE_PX[1] * fine))
        pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
        pixels = (pixels + 0.5) / fine - 0.5
        rays = _RAYS.get((self.matrix.tobytes(), self.distortion.tobytes(), fine))
        if rays is None:
            rays = cv2.undistortPoints(pixels, self.matrix, self.distortion).reshape(-1, 2)
            _RAYS[(self.matrix.tobytes(), self.distortion.tobytes(), fine)] = rays
        at = self.camera_T_board[pose]
        plane = np.column_stack([at[:3, 0], at[:3, 1], at[:3, 3]])  # ray s = plane (x, y, 1)
        found = np.column_stack([rays, np.ones(len(rays))]) @ np.linalg.inv(plane).T
        xy = found[:, :2] / found[:, 2:]
        dots = drawing.shape[1] / size_mm[0]
        at_drawing = (xy + 0.5 * np.array(size_mm)) * dots - 0.5
        at_drawing[found[:, 2] <= 0] = -1e4
        shape = (SIZE_PX[1] * fine, SIZE_PX[0] * fine)
        image = cv2.remap(
            drawing, *(at_drawing[:, k].reshape(shape).astype(np.float32) for k in (0, 1)),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=215,
        )  # fmt: skip
        image = cv2.resize(image, SIZE_PX, interpolation=cv2.INTER_AREA).astype(np.float32)
        image = cv2.GaussianBlur(image, (0, 0), 0.7) * 0.8 + 20 + rng.normal(size=image.shape) * 2.0
        image = np.clip(image, 0, 255).astype(np.uint8)
        return np.ascontiguousarray(image[:, ::-1]) if mirrored else image


_RAYS: dict = {}


def _facing(direction: Array) -> Array:
    """Rotation of a camera that looks along a direction, its x axis level."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def charuco_drawing(columns: int, rows: int, square_mm: float, marker_mm: float, dots_per_mm: int = 6) -> Array:
    """A ChArUco board as OpenCV draws it, the squares to the edge."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((columns, rows), square_mm, marker_mm, markers)
    size = (int(columns * square_mm * dots_per_mm), int(rows * square_mm * dots_per_mm))
    return board.generateImage(size, marginSize=0)


def checkerboard_drawing(columns: int, rows: int, square_mm: float, dots_per_mm: int = 6) -> Array:
    """A checkerboard, its first square dark."""
    side = round(square_mm * dots_per_mm)
    light = np.indices((rows, columns)).sum(axis=0) % 2
    return np.kron(255 * light, np.ones((side, side))).astype(np.uint8)


def marker_drawing(
    columns: int, rows: int, side_mm: float, gap_mm: float, dictionary: str, dots_per_mm: int = 6
) -> Array:
    """A grid of markers, numbered row by row."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    side, step = round(side_mm * dots_per_mm), round((side_mm + gap_mm) * dots_per_mm)
    drawing = np.full((step * rows, step * columns), 255, np.uint8)
    for number in range(columns * rows):
        row, column = divmod(number, columns)
        across = slice(column * step, column * step + side)
        drawing[row * step : row * step + side, across] = cv2.aruco.generateImageMarker(markers, number, side)
    return drawing[: (rows - 1) * step + side, : (columns - 1) * step + side]


def with_margin(drawing: Array, size_mm: tuple[float, float], margin_mm: float) -> tuple[Array, tuple[float, float]]:
    """A drawing with white paper around it, and its size."""
    pad = round(margin_mm * drawing.shape[1] / size_mm[0])
    wide = cv2.copyMakeBorder(drawing, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=255)
    return wide, (size_mm[0] * wide.shape[1] / drawing.shape[1], size_mm[1] * wide.shape[0] / drawing.shape[0])


def write_images(scene: Scene, folder: Path, drawing: Array, size_mm, rng, poses=None, **how) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(len(scene.names)) if poses is None else poses:
        cv2.imwrite(str(folder / f"{scene.names[k]}.png"), scene.render(k, drawing, size_mm, rng, **how))
    return folder
