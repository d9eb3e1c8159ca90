"""Scans of the jig on its flange by ray casting, with the errors of a structured-light scanner.

The scanner's frame is a camera's: origin in the lens, z along the view, y down; lengths in mm. The jig's frame has its
origin in the apex and z along the jig's axis, away from the scanner: a convex jig lies at z > 0, and flange and arm lie
behind it. Behind these are a wall and a table, fixed to the scanner.

A simulated scan is a window around the jig, not the whole field of 450 mm, of whose 12 000 points fewer than 200 would
be on a 60 mm jig.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from calib.array_types import Array, BoolArray
from calib.errors import ScanError
from calib.frames import apply
from calib.jig import Jig, jig_geometry
from calib.scans.scan import Scan

CUBE_CORNER = Jig()

_PLATE_MM = (260.0, 220.0, 12.0)

SCENE = 0
"""Label of a surface other than the jig's faces, which have 1, 2, 3."""


def scene_triangles(
    scanner_T_jig: Array, jig: Jig, *, flange_mm: float, arm_turn_rad: float, background: tuple[float, float] | None
) -> tuple[Array, NDArray[np.int8]]:
    """Triangles of all surfaces in the scene (T, 3, 3), in the scanner's frame, and their labels (T,).

    background: distances of the wall behind and the table below the scanner, mm; None: the jig is on its own plate.
    """
    import trimesh

    edges, _ = jig_geometry(jig)
    apex = np.zeros(3)
    faces = np.array([[apex, edges[1], edges[2]], [apex, edges[2], edges[0]], [apex, edges[0], edges[1]]])
    back_mm = float(edges[:, 2].mean()) if jig.convex else 2.0
    flange_mm = max(flange_mm, back_mm + 1.0)  # a tool row shorter than the jig: the jig is on the flange itself

    def cylinder(radius_mm: float, start_mm: float, length_mm: float) -> Any:
        middle = trimesh.transformations.translation_matrix([0.0, 0.0, start_mm + 0.5 * length_mm])
        return trimesh.creation.cylinder(radius_mm, length_mm, sections=64, transform=middle)

    post = cylinder(14.0, back_mm, flange_mm - back_mm)
    body = [edges[None, ::-1]] if jig.convex else []  # the cut face
    if background is None:
        plate = trimesh.creation.box(
            _PLATE_MM, trimesh.transformations.translation_matrix([0.0, 0.0, flange_mm + 0.5 * _PLATE_MM[2]])
        )
        standing = np.concatenate([faces, *body, post.triangles, plate.triangles])
        return apply(scanner_T_jig, standing), _labels(len(standing))
    across = trimesh.transformations.rotation_matrix(
        arm_turn_rad, [0, 0, 1]
    ) @ trimesh.transformations.translation_matrix([30.0, 0.0, flange_mm + 110.0])
    across = across @ trimesh.transformations.rotation_matrix(0.5 * np.pi, [0, 1, 0])
    parts = [
        post,
        cylinder(37.5, flange_mm, 12.0),
        cylinder(42.0, flange_mm + 12.0, 140.0),
        trimesh.creation.cylinder(46.0, 190.0, sections=64, transform=across),
    ]
    arm = np.concatenate([*body, *(part.triangles for part in parts)])
    wall_z_mm, table_y_mm = background
    side = 3000.0
    wall = _quad([-side, -side, wall_z_mm], [2 * side, 0, 120.0], [0, 2 * side, 0])
    table = _quad([-side, table_y_mm, 300.0], [2 * side, 0, 0], [0, 0, side])
    triangles = np.concatenate([apply(scanner_T_jig, np.concatenate([faces, arm])), wall, table])
    return triangles, _labels(len(triangles))


def _labels(count: int) -> NDArray[np.int8]:
    """Labels (count,) of triangles of which the first three are the jig's faces."""
    label = np.zeros(count, dtype=np.int8)
    label[:3] = (1, 2, 3)
    return label


def _quad(corner: list[float], side: list[float], other_side: list[float]) -> Array:
    """Parallelogram as two triangles (2, 3, 3), from a corner and its two sides."""
    p, u, v = np.array(corner), np.array(side), np.array(other_side)
    return np.array([[p, p + u, p + u + v], [p, p + u + v, p + v]])


FLYING = -1
"""Label of a point on no surface: a flying pixel or an outlier. Other labels: see `calib.simulation.scanner`."""

SHORT_WAVES = 0.15
"""Correlation length of the short waves over that of the long ones.

With `short_share` 0.3 and long waves of 25 mm the correlation has the shape by which views of one sheet differ that a
structured-light scanner took from several sides (RegHEC, `data/Plane`; what is the sheet's own shape all views share):
over that at 2 mm it is 0.88, 0.71, 0.57, 0.26, 0.01 at 4.5, 9, 18, 36, 72 mm, where the median pair of views has 0.8,
0.7, 0.54, 0.3, 0. Neither one Gaussian nor one exponential has that shape.
"""

_CELLS_A_LENGTH = 4.0
_REACH = 4.0  # standard deviations of the filter


@dataclass(frozen=True)
class ScanModel:
    """The errors of a structured-light scanner.

    Range noise along the ray is `scan_sigma_mm * (0.5 + 0.5 / cos^2(incidence))`. `flying_share` of the pixels at a
    depth edge report a range between foreground and background. Pixels fade out between the two incidences of
    `grazing_deg`, and where the projector, `baseline_mm` to the side, is shaded. `outlier_share` of the points are
    replaced by points anywhere in the view. `correlated_sigma_mm` adds range noise that is correlated over
    `correlation_length_mm` across the view, `short_share` of its variance over a seventh of that
    (`smooth_noise`), and drawn anew for each scan; a face's average keeps it.
    """

    points: int = 12_000
    scan_sigma_mm: float = 0.02
    window_mm: float = 150.0
    flying_share: float = 0.35
    grazing_deg: tuple[float, float] = (70.0, 86.0)
    baseline_mm: float = 120.0
    outlier_share: float = 0.0
    correlated_sigma_mm: float = 0.0
    correlation_length_mm: float = 15.0
    short_share: float = 0.0
    wall_z_mm: float = 1150.0
    table_y_mm: float = 280.0


PLAIN_MODEL = ScanModel()
"""White noise only, for which a bound can be computed; no real scanner has it."""

STRUCTURED_LIGHT = ScanModel(scan_sigma_mm=0.03, correlated_sigma_mm=0.06, correlation_length_mm=25.0, short_share=0.3)
"""A structured-light scanner: white noise, and twice as much smooth noise.

Shape: see `SHORT_WAVES`; the two views compared there have 0.035 mm of white noise and 0.02 to 0.05 mm of smooth noise
each. Size: corners of a 60 mm jig at rest scatter by some 0.06 to 0.1 mm (3D), as in Table 1 of Jang 2025.
"""


@dataclass(frozen=True)
class SimulatedScan:
    """A scan with its true apex, normals, labels and noise."""

    scan: Scan
    apex_mm: Array  # (3,) scanner frame
    normals: Array  # (3, 3) outward unit normals of faces 1, 2, 3, scanner frame
    label: NDArray[np.int8]  # (N,) 1, 2, 3: face; SCENE: anything else; FLYING: flying pixels and outliers
    noise_sigma_mm: Array  # (N,) the range noise's standard deviation, along the ray; NaN where label is FLYING


def simulate_scan(
    scanner_T_jig: ArrayLike,
    jig: Jig = CUBE_CORNER,
    *,
    rng: np.random.Generator,
    name: str = "scan",
    model: ScanModel = PLAIN_MODEL,
    flange_mm: float = 88.0,
    arm_turn_rad: float = 0.0,
    on_plate: bool = False,
    window_offset_mm: tuple[float, float] = (0.0, 0.0),
) -> SimulatedScan:
    """Simulated scan of a jig at `scanner_T_jig` (4, 4).

    Args:
        flange_mm: distance of the flange's front from the apex, or of the plate's where the jig is fixed in the world.
        arm_turn_rad: turn of the arm behind the flange about the jig's axis.
        on_plate: the jig is fixed in the world on a plate, for a scanner that moves; else it is on an arm's flange.
        window_offset_mm: shift of the window's middle from the apex, across the view.

    Raises:
        ScanError: the jig is not in the scanner's view.
    """
    scanner_T_jig = np.asarray(scanner_T_jig, dtype=float)
    apex_mm = scanner_T_jig[:3, 3]
    if apex_mm[2] < 100.0:
        raise ScanError(
            f"{name}: the jig's apex is at z = {apex_mm[2]:.0f} mm of the scanner; it must be 100 mm or more"
        )
    triangles, triangle_label = scene_triangles(
        scanner_T_jig,
        jig,
        flange_mm=flange_mm,
        arm_turn_rad=arm_turn_rad,
        background=None if on_plate else (model.wall_z_mm, model.table_y_mm),
    )
    scene = _Scene(triangles, triangle_label)

    coarse = scene.cast(_window(apex_mm, model, window_offset_mm, 64))
    lit_share = _lit(coarse, scene, model).mean()
    if not np.any(coarse.label > 0):
        raise ScanError(
            f"{name}: the scanner does not see the jig at {np.round(apex_mm, 1).tolist()} mm; turn its faces here"
        )
    view = scene.cast(
        _window(apex_mm, model, window_offset_mm, max(8, round(float(np.sqrt(model.points / lit_share)))))
    )

    cos_incidence = np.maximum(view.cos_incidence, 1e-3)
    noise_sigma_mm = model.scan_sigma_mm * (0.5 + 0.5 / cos_incidence**2)
    range_mm = view.range_mm + noise_sigma_mm * rng.standard_normal(view.range_mm.shape)
    if model.correlated_sigma_mm > 0:
        across_mm = view.direction[..., :2] / view.direction[..., 2:] * apex_mm[2]
        range_mm += model.correlated_sigma_mm * smooth_noise(
            across_mm, model.correlation_length_mm, model.short_share, rng=rng
        )
    fade = (np.degrees(np.arccos(cos_incidence)) - model.grazing_deg[0]) / np.ptp(model.grazing_deg)
    keep = _lit(view, scene, model) & (rng.random(range_mm.shape) >= fade)

    label = view.label.copy()
    at_edge, other_mm = _depth_edges(view)
    flying = at_edge & (rng.random(range_mm.shape) < model.flying_share)
    beyond_mm = np.subtract(other_mm, view.range_mm, where=flying, out=np.zeros_like(range_mm))
    mixed_mm = view.range_mm + rng.random(range_mm.shape) * beyond_mm
    range_mm = np.where(flying, mixed_mm, range_mm)
    keep &= np.isfinite(range_mm)
    outlier = rng.random(range_mm.shape) < model.outlier_share
    range_mm = np.where(outlier, rng.uniform(0.6 * apex_mm[2], 1.4 * apex_mm[2], range_mm.shape), range_mm)
    label[flying | outlier] = FLYING
    noise_sigma_mm = np.where(label == FLYING, np.nan, noise_sigma_mm)

    points_mm = view.direction[keep] * range_mm[keep][:, None]
    _, normals = jig_geometry(jig)
    return SimulatedScan(
        scan=Scan(name=name, points_mm=points_mm),
        apex_mm=apex_mm.copy(),
        normals=normals @ scanner_T_jig[:3, :3].T,
        label=label[keep],
        noise_sigma_mm=noise_sigma_mm[keep],
    )


@dataclass(frozen=True)
class _View:
    """Surfaces hit by the rays of a pixel grid (H, W); a ray without a hit has range inf."""

    direction: Array  # (H, W, 3) unit
    range_mm: Array  # (H, W)
    cos_incidence: Array  # (H, W)
    normal: Array  # (H, W, 3) unit, towards the scanner
    label: NDArray[np.int8]  # (H, W)
    pitch: float  # tangent of the angle between neighbouring pixels


class _Scene:
    """Triangles that rays are cast at. Hits come from Open3D in float32; ranges are computed again in float64."""

    def __init__(self, triangles: Array, label: NDArray[np.int8]) -> None:
        import open3d as o3d

        core: Any = o3d.core
        self.label = label  # (T,)
        self.corner_mm = triangles[:, 0]  # (T, 3)
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self.normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        self._caster: Any = o3d.t.geometry.RaycastingScene()
        vertices = core.Tensor(triangles.reshape(-1, 3).astype(np.float32))
        faces = core.Tensor(np.arange(3 * len(triangles), dtype=np.uint32).reshape(-1, 3))
        self._caster.add_triangles(vertices, faces)

    def cast(self, grid: tuple[Array, float]) -> _View:
        """Surfaces hit by the rays of a grid: unit directions (H, W, 3) and pitch."""
        direction, pitch = grid
        rays = np.concatenate([np.zeros_like(direction), direction], axis=-1).astype(np.float32)
        triangle = self._caster.cast_rays(rays)["primitive_ids"].numpy()
        hit = triangle < len(self.label)
        triangle = np.where(hit, triangle, 0)
        normal = self.normal[triangle]
        slope = np.einsum("...i,...i->...", normal, direction)
        hit &= np.abs(slope) > 1e-6
        distance = np.einsum("...i,...i->...", normal, self.corner_mm[triangle])
        range_mm = np.where(hit, distance / np.where(hit, slope, 1.0), np.inf)
        label = np.where(hit, self.label[triangle], SCENE).astype(np.int8)
        return _View(direction, range_mm, np.abs(slope), -np.sign(slope)[..., None] * normal, label, pitch)

    def is_shaded(self, view: _View, light_mm: Array) -> BoolArray:
        """Mask (H, W) of points that the light does not reach: occluded, or on a surface turned away from it."""
        hit = np.isfinite(view.range_mm)
        point_mm = view.direction * np.where(hit, view.range_mm, 1.0)[..., None]
        start_mm = point_mm + 0.05 * view.normal  # off the surface, past float32's resolution
        to_light_mm = light_mm - start_mm
        rays = np.concatenate([start_mm, to_light_mm], axis=-1).astype(np.float32)
        shaded = self._caster.test_occlusions(rays, tnear=0.0, tfar=1.0).numpy()
        return shaded | (np.einsum("...i,...i->...", view.normal, to_light_mm) <= 0)


def _window(apex_mm: Array, model: ScanModel, offset_mm: tuple[float, float], pixels: int) -> tuple[Array, float]:
    """Unit ray directions (H, W, 3) of a square window around the apex, and the grid's pitch."""
    pitch = model.window_mm / apex_mm[2] / pixels
    steps = (np.arange(pixels) - 0.5 * (pixels - 1)) * pitch
    u, v = np.meshgrid(
        steps + (apex_mm[0] + offset_mm[0]) / apex_mm[2], steps + (apex_mm[1] + offset_mm[1]) / apex_mm[2]
    )
    direction = np.stack([u, v, np.ones_like(u)], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True), pitch


def _lit(view: _View, scene: _Scene, model: ScanModel) -> BoolArray:
    """Mask (H, W) of the pixels that hit a surface lit by the projector."""
    return np.isfinite(view.range_mm) & ~scene.is_shaded(view, np.array([model.baseline_mm, 0.0, 0.0]))


def _depth_edges(view: _View) -> tuple[BoolArray, Array]:
    """Mask (H, W) of the pixels next to a jump in range, and the range on the other side of the jump.

    A jump is more than 4 mm and more than a surface at 80 degrees would rise within a pixel.
    """
    centre = view.range_mm
    limit_mm = np.maximum(4.0, np.tan(np.radians(80.0)) * view.pitch * np.where(np.isfinite(centre), centre, 0.0))
    largest_mm, other_mm = np.zeros_like(centre), centre.copy()
    padded = np.pad(centre, 1, mode="edge")
    for dy, dx in ((0, 1), (2, 1), (1, 0), (1, 2)):
        neighbour = padded[dy : dy + centre.shape[0], dx : dx + centre.shape[1]]
        both = np.isfinite(neighbour) & np.isfinite(centre)
        jump_mm = np.abs(np.subtract(neighbour, centre, where=both, out=np.zeros_like(centre)))
        other_mm = np.where(jump_mm > largest_mm, neighbour, other_mm)
        largest_mm = np.maximum(largest_mm, jump_mm)
    return largest_mm > limit_mm, other_mm


def smooth_noise(across_mm: Array, length_mm: float, short_share: float, *, rng: np.random.Generator) -> Array:
    """Random field (...) of variance 1 at positions across the view, `across_mm` (..., 2): error that points share.

    Its correlation is (1 - s) exp(-r^2 / 2 l^2) + s exp(-r^2 / 2 (0.15 l)^2) with l = length_mm, s = short_share. Each
    part is drawn on a lattice that is fine compared with its waves, and interpolated: over one view it is the same
    surface for any number of rays.
    """
    field = np.zeros(across_mm.shape[:-1])
    for share, length in ((1.0 - short_share, length_mm), (short_share, SHORT_WAVES * length_mm)):
        if share > 0:
            field += np.sqrt(share) * _gaussian_field(across_mm, length, rng)
    return field


def _gaussian_field(across_mm: Array, length_mm: float, rng: np.random.Generator) -> Array:
    """Random field with correlation exp(-r^2 / 2 l^2): white noise filtered by a Gaussian with sigma l / sqrt(2)."""
    cell_mm = length_mm / _CELLS_A_LENGTH
    width = _CELLS_A_LENGTH / np.sqrt(2.0)  # of the filter, in cells
    margin = int(np.ceil(_REACH * width)) + 2
    flat = across_mm.reshape(-1, 2)
    start = flat.min(axis=0)
    cells = np.ceil((flat.max(axis=0) - start) / cell_mm).astype(int) + 1
    white = rng.standard_normal(tuple(cells + 2 * margin))
    lattice = gaussian_filter(white, width, truncate=_REACH) * (2.0 * np.sqrt(np.pi) * width)
    place = (flat - start).T / cell_mm + margin
    return np.asarray(map_coordinates(lattice, place, order=3)).reshape(across_mm.shape[:-1])
