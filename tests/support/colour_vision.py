"""Colours as they are seen: contrast on a background, and how far apart they look, also to colour-blind eyes.

Colour-blind eyes by Machado, Oliveira and Fernandes 2009 (severity 1), in linear RGB; differences are CIE 1976.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array
from inspector.markup.parts.palette import rgb

LIGHT, DARK = "#FFFFFF", "#141414"  # the 3D view's background
DARK_PANEL = "#242424"  # behind figures
EYES = {
    "normal": np.eye(3),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
}
_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = np.array([0.95047, 1.0, 1.08883])


def linear(colours: ArrayLike) -> Array:
    """sRGB (..., 3), 0-255, as linear light, 0-1."""
    c = np.asarray(colours, dtype=float) / 255.0
    return np.asarray(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4))


def contrast(one: str, other: str) -> float:
    """WCAG's contrast of two colours "#RRGGBB", 1 to 21."""
    low, high = sorted(float(linear(rgb(c)) @ _XYZ[1]) for c in (one, other))
    return (high + 0.05) / (low + 0.05)


def lab(light: ArrayLike) -> Array:
    """CIE L*a*b* of linear light (..., 3)."""
    xyz = np.asarray(light) @ _XYZ.T / _WHITE
    f = np.where(xyz > 216 / 24389, np.cbrt(np.maximum(xyz, 0)), (24389 / 27 * xyz + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def difference(one: str, other: str, eyes: str) -> float:
    """Perceived difference of two colours by the given eyes: about 2 can just be told, 20 at a glance."""
    a, b = (lab(np.clip(linear(rgb(c)) @ EYES[eyes].T, 0, 1)) for c in (one, other))
    return float(np.linalg.norm(a - b))
