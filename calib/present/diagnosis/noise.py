"""Presentation of the noise shape: sigma across and along the line of sight, growth with distance, drift, tails."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.dataset.repeats import find_repeats, pooled_sigma_mm
from calib.diagnosis.verdict import Findings
from calib.noise_shape import IDENTITY, NoiseShape
from calib.present.effects import title
from calib.rendering import numbers

_ALIGNED = 0.98  # cosine from which a direction is called an axis of the scanner's frame


def noise_sigma_mm(findings: Findings) -> float:
    """RMS noise per coordinate, mm: from repeats where these showed the noise shape, else from the residual."""
    if findings.noise is not None and findings.noise.from_repeats:
        return pooled_sigma_mm(find_repeats(findings.calibration.dataset))
    return findings.residual_tests.residual_mm


def axes_mm(shape: NoiseShape, sigma_mm: float) -> tuple[float, float, float] | None:
    """Noise sigmas, mm, along three axes, where the noise shape has different ones; None for isotropic noise.

    With a growth over distance they are those at the mean distance.
    """
    if shape.depth != 1.0:
        sizes = np.array([1.0, 1.0, abs(shape.depth)])
    elif shape.axes != IDENTITY:
        sizes = np.linalg.eigvalsh(np.array(shape.axes))
    else:
        return None
    first, second, third = (sizes * sigma_mm / np.sqrt(np.mean(sizes**2))).tolist()
    return first, second, third


def noise_sentences(findings: Findings) -> str:
    """Sentences on the noise shape and its meaning for the instrument; "" where the noise is as declared."""
    shown = findings.noise
    if shown is None:
        return ""
    shape, growth = shown.shape, float(np.expm1(shown.shape.growth_per_m))
    sentences = [_directions(shape, noise_sigma_mm(findings))]
    if growth:
        how = f"grows by {numbers.share(growth)}" if growth > 0.0 else f"falls by {numbers.share(-growth)}"
        sentences.append(f"The scanner's noise {how} with each metre of distance.")
    if (drift := shape.wander) is not None:
        unit = "poses" if drift.in_poses else "s"
        sentences.append(
            f"{numbers.share(drift.share)} of the noise's variance is a slow drift: what is measured moves as a whole, "
            f"and points within about {drift.time:.3g} {unit} of each other move alike."
        )
    if shape.tail is not None:
        sentences.append(
            f"The noise has heavier tails than a normal distribution (Student's t, {shape.tail:g} degrees of freedom): "
            "single points far out are part of it, not mistakes."
        )
    if shown.rival:
        sentences.append(
            f"Such a drift explains as much as {title(shown.rival)} would, so {shown.rival} is not claimed. To tell "
            "them apart, measure one pose again and again through the session."
        )
    shows = "The repeated measurements show" if shown.from_repeats else "The residual shows"
    end = f"{shows} this; the fit weights the points by it, and the size of the noise stays as it was."
    return " ".join([*filter(None, sentences), end])


def noise_document(findings: Findings) -> dict[str, Any] | None:
    """JSON keys on a noise shape other than the declared one; properties without evidence are None."""
    shown = findings.noise
    if shown is None:
        return None
    sigma_mm, shape, drift = noise_sigma_mm(findings), shown.shape, shown.shape.wander
    return {
        "isotropic_mm": sigma_mm,
        "axes_mm": axes_mm(shape, sigma_mm),
        "growth_per_m": shape.growth_per_m or None,
        "correlation_s": drift.time if drift and not drift.in_poses else None,
        "from": "repeats" if shown.from_repeats else "fit",
        "words": noise_sentences(findings),
    }


def _directions(shape: NoiseShape, sigma_mm: float) -> str:
    sigmas = axes_mm(shape, sigma_mm)
    if sigmas is None:
        return ""
    if shape.depth != 1.0:
        ratio, where = abs(shape.depth), "in depth, along the line of sight,"
    else:
        sizes, directions = np.linalg.eigh(np.array(shape.axes))
        odd = 2 if sizes[2] / sizes[1] > sizes[1] / sizes[0] else 0  # the axis that differs most from the others
        others = np.delete(sizes, odd)
        ratio, where = float(sizes[odd] / np.sqrt(np.mean(others**2))), _axis(directions[:, odd])
    how = f"{ratio:.1f} times coarser" if ratio > 1.0 else f"{1.0 / ratio:.1f} times finer"
    listed = ", ".join(numbers.length(sigma) for sigma in sigmas)
    return f"Your scanner is {how} {where} than across it (sigmas along the three axes: {listed})."


def _axis(direction: np.ndarray) -> str:
    """Name of the scanner's axis along a direction, or else the direction's components."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) > _ALIGNED:
        return "in depth, along z of its frame," if k == 2 else f"along {'xyz'[k]} of its frame"
    x, y, z = direction * np.sign(direction[k])
    return f"along ({x:.2f}, {y:.2f}, {z:.2f}) of its frame"
