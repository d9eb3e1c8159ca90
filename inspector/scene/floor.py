"""Scale of the 3D view: a grid on the floor of the robot's base, and a bar of known length."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from inspector.markup.parts.palette import MEASURE, rgb
from inspector.scene.model_nodes import pose_of
from inspector.scene.scene_view import M_PER_MM, Nodes, Pen, SceneView

CELL_MM, SECTION_MM = 100.0, 500.0
LENGTHS_MM = (10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
BAR_SHARE = 0.4  # of the field's radius: the longest that a bar may be
TICK_SHARE = 0.08  # of the bar


def draw_floor(scene: SceneView, scanner_T_base: Array | None, reach_mm: float) -> None:
    """Draw the x-y plane of the base up to the arm's reach; nothing before the base's place is known."""
    half_mm = SECTION_MM * max(1.0, float(np.ceil(reach_mm / SECTION_MM)))

    def make(pen: Pen) -> Nodes:
        if scanner_T_base is None:
            return []
        wxyz, position = pose_of(scanner_T_base)
        size = 2.0 * half_mm * M_PER_MM
        return [
            pen.api.add_grid(
                pen.of("grid"), width=size, height=size, plane="xy", cell_size=CELL_MM * M_PER_MM,
                section_size=SECTION_MM * M_PER_MM, cell_color=rgb(MEASURE), section_color=rgb(MEASURE),
                cell_thickness=0.4, section_thickness=0.9, shadow_opacity=0.0, wxyz=wxyz, position=position,
            )
        ]  # fmt: skip

    key = None if scanner_T_base is None else (scanner_T_base.tobytes(), half_mm)
    scene.draw("floor", make, key=key)


def draw_scale(scene: SceneView, middle_mm: Array, along: Array, up: Array, field_mm: float) -> None:
    """Draw a bar of known length about a middle (3,); `along` and `ticks` are unit vectors (3,)."""
    length_mm = max((length for length in LENGTHS_MM if length <= BAR_SHARE * field_mm), default=LENGTHS_MM[0])
    ends = middle_mm + 0.5 * length_mm * np.outer([-1.0, 1.0], along)
    ticks = [np.stack([end, end + TICK_SHARE * length_mm * up]) for end in ends]
    scene.draw(
        "scale",
        lambda pen: [
            pen.lines("bar", np.stack([ends, *ticks]), rgb(MEASURE), 3.0),
            pen.label("label", scale_words(length_mm), middle_mm, "top-center", 0.8),
        ],
        key=(ends.tobytes(), up.tobytes()),
    )


def scale_words(length_mm: int) -> str:
    """Label of the bar: "100 mm", "2 m"."""
    return f"{length_mm} mm" if length_mm < 1000 else f"{length_mm // 1000} m"
