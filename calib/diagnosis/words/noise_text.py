"""The shape of the noise as a fact, and what it says of the instrument, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.noise_shape import IDENTITY, CorrelatedDrift, NoiseShape

_ALIGNED = 0.98  # cosine from which a direction is told as an axis of the scanner's frame


@dataclass(frozen=True)
class NoiseShaped:
    """The noise has another shape than was declared; its size is what is left."""

    shape: NoiseShape
    isotropic_mm: float  # rms of a coordinate
    rival: str  # an effect that a slow wander explains as well, so that it is not claimed; "" where there is none
    from_repeats: bool  # else from what the fit left

    @property
    def axes_mm(self) -> tuple[float, float, float] | None:
        """Sigmas along three axes, across the line of sight twice and along it, or along those of the shape; else None.

        With a growth they are those at the mean distance.
        """
        shape = self.shape
        if shape.depth != 1.0:
            sizes = np.array([1.0, 1.0, abs(shape.depth)])
        elif shape.axes != IDENTITY:
            sizes = np.linalg.eigvalsh(np.array(shape.axes))
        else:
            return None
        first, second, third = (sizes * self.isotropic_mm / np.sqrt(np.mean(sizes**2))).tolist()
        return first, second, third


def noise_text(noise: NoiseShaped) -> str:
    """A few sentences: directions, distance, time, tails, and that the size stays."""
    shape = noise.shape
    said = (
        _directions(noise),
        _growth(shape.growth_per_m),
        _wander(shape.wander),
        _tail(shape.tail),
        _rival(noise.rival),
    )
    shows = "The repeated measurements show" if noise.from_repeats else "What is left shows"
    end = f"{shows} this; the fit weighs the points by it, and the size of the noise stays as it was."
    return " ".join([*filter(None, said), end])


def _directions(noise: NoiseShaped) -> str:
    axes_mm, shape = noise.axes_mm, noise.shape
    if axes_mm is None:
        return ""
    if shape.depth != 1.0:
        ratio, where = abs(shape.depth), "in depth, along the line of sight,"
    else:
        sizes, directions = np.linalg.eigh(np.array(shape.axes))
        odd = 2 if sizes[2] / sizes[1] > sizes[1] / sizes[0] else 0  # the axis that differs most from the others
        others = np.delete(sizes, odd)
        ratio, where = float(sizes[odd] / np.sqrt(np.mean(others**2))), _axis(directions[:, odd])
    how = f"{ratio:.1f} times coarser" if ratio > 1.0 else f"{1.0 / ratio:.1f} times finer"
    sizes_mm = ", ".join(f"{size:.3g}" for size in axes_mm)
    return f"Your scanner is {how} {where} than across it (sigmas along the three axes {sizes_mm} mm)."


def _axis(direction: np.ndarray) -> str:
    """Along which axis of the scanner's frame, or else along which direction of it."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) > _ALIGNED:
        return "in depth, along z of its frame," if k == 2 else f"along {'xyz'[k]} of its frame"
    x, y, z = direction * np.sign(direction[k])
    return f"along ({x:.2f}, {y:.2f}, {z:.2f}) of its frame"


def _growth(per_m: float) -> str:
    if per_m == 0.0:
        return ""
    more = float(np.expm1(per_m))
    how = f"grows by {100.0 * more:.0f} %" if per_m > 0.0 else f"falls by {-100.0 * more:.0f} %"
    return f"The scanner's noise {how} with each metre of distance."


def _wander(wander: CorrelatedDrift | None) -> str:
    if wander is None:
        return ""
    unit = "poses" if wander.in_poses else "s"
    return (
        f"{100.0 * wander.share:.0f} % of the noise's variance is a slow wander: what is measured moves as a whole, and "
        f"points within about {wander.time:.3g} {unit} of each other move alike."
    )


def _tail(tail: float | None) -> str:
    if tail is None:
        return ""
    return (
        f"The noise has heavier tails than a normal distribution (Student's t, {tail:g} degrees of freedom): single points "
        "far out are part of it, not mistakes."
    )


def _rival(rival: str) -> str:
    if not rival:
        return ""
    return (
        f"Such a wander explains as much as {rival} would, so {rival} is not claimed. To tell them apart, measure one pose "
        "again and again through the session."
    )
