"""The 3D scene as a .glb file: the arm at one pose, measured and predicted points, and the residuals between them.

glTF is read by Blender, MeshLab, web viewers and office programs; viser's own recording only by viser. As glTF asks,
lengths are metres and y points up; the base's z axis is up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import LINKS, fitted_version
from calib.calibration.result import Calibration
from calib.fitting.observations import Observations
from inspector.markup.parts.palette import ARM, JOINT, MODEL_COLOURS, SLIDE, UNKNOWN, rgb, role_colour
from inspector.scene.arm_shape import ArmShape, arm_shape

M_PER_MM = 1e-3
BALL_SHARE = 0.006  # of the field that the points lie in
PREDICTED = "predicted"
_PARTS = {"revolute": JOINT, "prismatic": SLIDE, "link": ARM, "tool": UNKNOWN}
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def scene_glb(calibration: Calibration, pose: int, arrows: float) -> bytes:
    """Content of a .glb file with the scene, in the base frame of the calibrated robot.

    Args:
        pose: at which the arm stands.
        arrows: how many times longer residuals are drawn; their node's name says it.
    """
    dataset = calibration.dataset
    scene = trimesh.Scene()
    version = fitted_version(LINKS, calibration)
    shape = arm_shape(version.model, version.x, dataset.poses, pose, version.flange_T_scanner(pose))
    for part, mesh in _arm(shape).items():
        scene.add_geometry(mesh, node_name=f"arm {part}", geom_name=f"arm {part}")
    observed = Observations.of_all(dataset).points
    base_T_scanner = frames.invert(version.scanner_T_base_of_points)
    measured_mm = frames.apply(base_T_scanner, observed.xyz_mm)
    error_mm = np.einsum("mij,mj->mi", base_T_scanner[:, :3, :3], calibration.after.error_mm)
    radius = max(BALL_SHARE * float(np.linalg.norm(np.ptp(measured_mm, axis=0))), 1.0)
    roles = dataset.poses.role[observed.pose]
    for role in map(str, np.unique(roles)):
        balls = _balls(measured_mm[roles == role], radius, role_colour(role))
        scene.add_geometry(balls, node_name=f"measured {role}", geom_name=f"measured {role}")
    colour = MODEL_COLOURS["with effects" if calibration.model.family_names else "link errors"]
    end_mm = measured_mm + arrows * error_mm
    scene.add_geometry(_balls(measured_mm + error_mm, 0.6 * radius, colour), node_name=PREDICTED, geom_name=PREDICTED)
    sticks = [_stick(a, b, 0.2 * radius) for a, b in zip(measured_mm, end_mm, strict=True)]
    sticks = [stick for stick in sticks if stick is not None]
    if sticks:
        name = f"residuals x {arrows:g}"
        scene.add_geometry(_coloured(sticks, colour), node_name=name, geom_name=name)
    scene.apply_transform(_Y_UP)
    return bytes(scene.export(file_type="glb"))


def _arm(shape: ArmShape) -> dict[str, Any]:
    """Solids of each kind as one mesh."""
    solids: dict[str, list[Any]] = {}
    for start, end, radius, part in zip(shape.start_mm, shape.end_mm, shape.radius_mm, shape.part, strict=True):
        stick = _stick(start, end, float(radius))
        if stick is not None:
            solids.setdefault(str(part), []).append(stick)
    for centre, radius in zip(shape.ball_mm, shape.ball_radius_mm, strict=True):
        solids.setdefault("link", []).append(_ball(centre, float(radius)))
    return {part: _coloured(meshes, _PARTS.get(part, UNKNOWN)) for part, meshes in solids.items()}


def _ball(centre_mm: Array, radius_mm: float) -> Any:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=radius_mm * M_PER_MM)
    return ball.apply_translation(centre_mm * M_PER_MM)


def _balls(centres_mm: Array, radius_mm: float, colour: str) -> Any:
    return _coloured([_ball(centre, radius_mm) for centre in centres_mm], colour)


def _stick(start_mm: Array, end_mm: Array, radius_mm: float) -> Any:
    """Cylinder between two points; None where they coincide."""
    if np.linalg.norm(end_mm - start_mm) < 1e-6:
        return None
    ends = np.stack([start_mm, end_mm]) * M_PER_MM
    return trimesh.creation.cylinder(radius=radius_mm * M_PER_MM, segment=ends, sections=16)


def _coloured(meshes: list[Any], colour: str) -> Any:
    mesh = trimesh.util.concatenate(meshes)
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*rgb(colour), 255], metallicFactor=0.0, roughnessFactor=0.7
    )
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    return mesh
