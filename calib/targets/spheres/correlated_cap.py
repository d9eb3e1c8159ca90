"""Fit of a sphere's cap where neighbouring points share errors: declared of the scanner, or shown by the residuals.

The error lies along the ray and is smooth over the scanner's image, as with the jig's faces, so a distance over the
surface has its share cos i. What the points show of it is estimated from their means over patches of the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.correlated_noise.declared import DeclaredNoise
from calib.corners.correlated_noise.likelihood import LENGTHS, SHAPE_LENGTHS, SHAPES, evidence_of, gaussian_kernels
from calib.corners.correlated_noise.patches import PatchPlaces, ScannerView
from calib.corners.correlated_noise.posterior import SIZES, generalised_fit, patch_covariance, posterior_variances
from calib.corners.correlated_noise.surroundings import (
    evidence_of_surroundings,
    flat_surroundings,
    patches_of_surroundings,
)
from calib.planes.clustering import PlaneGroup
from calib.planes.robust_fit import PlaneFit
from calib.statistics import group_numbers
from calib.targets.spheres.cap_fit import CapFit

_PATCHES_A_DIAMETER = 12
_POINTS_A_PATCH = 4  # at least, on average: otherwise the patches are larger
_FEWEST_PATCHES = 12
_PRIOR = 0.5  # of a correlated error
_LONGEST = 1.2  # diameters: longer errors leave nothing in the residuals


def surroundings_of(points: Array, flat: Sequence[PlaneFit], fit: CapFit) -> tuple[PlaneFit, ...]:
    """Flat surfaces around a sphere that show the scanner's errors over more than its cap, about its centre.

    points  # (N, 3) scanner frame; flat are planes through some of them, those with the most points first
    """
    groups = [PlaneGroup(np.zeros(1, dtype=np.int64), p.centre_mm, p.normal, p.offset_mm) for p in flat]
    return flat_surroundings(points, groups, (), fit.centre_mm, 2 * fit.radius_mm, fit.sigma_mm)


def with_correlated_errors(
    points: Array, fit: CapFit, declared: DeclaredNoise, surroundings: Sequence[PlaneFit] = ()
) -> CapFit:
    """Fit with the covariance of correlated errors and, where they are found or declared, fitted anew with it.

    points  # (N, 3) scanner frame, those that `fit` counts its indices in; surroundings as from `surroundings_of`
    """
    on = points[fit.indices]
    diameter_mm = 2 * fit.radius_mm
    view = ScannerView.of(fit.centre_mm, diameter_mm)
    image = view.image_mm(on - fit.centre_mm)
    area_mm2 = float(np.prod(np.ptp(image, axis=0)))
    side_mm = max(diameter_mm / _PATCHES_A_DIAMETER, float(np.sqrt(area_mm2 * _POINTS_A_PATCH / len(on))))
    patch = _cells(image, side_mm)
    count = np.bincount(patch)
    if len(count) < _FEWEST_PATCHES:
        return fit
    weight = 1 / fit.growth.sigma(fit.sine) ** 2
    total = np.bincount(patch, weight)

    def mean(column: Array) -> Array:
        return np.bincount(patch, weight * column) / total

    values = mean(fit.pseudo_mm)
    design = np.column_stack([mean(column) for column in fit.design.T])
    cosine = mean(np.sqrt(np.maximum(1 - fit.sine**2, 0.0)))
    places = _places(image, patch, count)
    # Differences within a patch have no smooth part, so this is the white one, in units of the noise's growth.
    squares = float(np.sum(weight * (fit.pseudo_mm - values[patch]) ** 2))
    variance = max(squares / max(len(on) - len(count), 1), 1e-24)
    white_mm2 = variance / total
    white: Array = np.asarray(np.linalg.inv((design.T * total) @ design) * variance)
    influence = (design * total[:, None]) @ white / variance  # (B, P)

    def along_sight(lengths_mm: Array) -> Array:
        return gaussian_kernels(places, lengths_mm) * np.outer(cosine, cosine)

    def moved(kernels: Array) -> Array:
        return influence.T @ kernels @ influence

    kernels = along_sight(LENGTHS * diameter_mm)
    sizes_mm = SIZES * fit.sigma_mm
    evidence = evidence_of(values, white_mm2, design, kernels, sizes_mm)
    of_kernel = moved(kernels)
    harm = np.multiply.outer(SHAPES @ _centre_mm2(of_kernel), sizes_mm**2) / _centre_mm2(white)
    likelihood, loss, flat = evidence.log_likelihood, evidence.expected_loss, 0.0
    beside = [p for p in (patches_of_surroundings(plane, view, diameter_mm) for plane in surroundings) if p]
    for patches in beside:
        waves, none, expected_loss = evidence_of_surroundings(patches, diameter_mm, sizes_mm)
        likelihood, loss, flat = likelihood + waves, loss + expected_loss, flat + none
    allowed = (SHAPE_LENGTHS < _LONGEST) | bool(beside)
    posterior = posterior_variances(likelihood[None], flat, harm[None], loss[None], (_PRIOR,), allowed[None], sizes_mm)
    shown = np.einsum("s,sl,lij->ij", posterior.size_mm2[0], SHAPES, of_kernel)
    declared_mm2 = 0.0
    covariance, moves = white + shown, np.zeros(design.shape[1])
    if declared.correlated_sigma_mm > 0:
        unit = moved(along_sight(np.array([declared.correlation_length_mm])))[0]
        share = max(0.0, 1 - float(_centre_mm2(shown) / _centre_mm2(unit)) / declared.correlated_sigma_mm**2)
        declared_mm2 = share * declared.correlated_sigma_mm**2
    if posterior.found or declared_mm2 > 0:
        correlated = patch_covariance(
            (along_sight,), posterior.size_mm2, declared_mm2, declared.correlation_length_mm, diameter_mm
        )
        moves, covariance = generalised_fit(design, values, correlated + np.diag(white_mm2))
    factor = float(np.sqrt(_centre_mm2(covariance) / _centre_mm2(white)))
    known = 3 if fit.fixed else 4
    whole = fit.unfitted_mm2.copy()
    whole[:known, :known] += covariance[:known, :known]
    whole[:3, :3] += declared.registration_sigma_mm**2 * np.eye(3)
    return replace(
        fit,
        centre_mm=fit.centre_mm + moves[:3],
        radius_mm=fit.radius_mm + (0.0 if fit.fixed else float(moves[3])),
        covariance_mm2=whole,
        smooth_factor=factor,
    )


def _centre_mm2(covariance: Array) -> Array:
    """Trace (...), mm^2, of the centre's part of the parameters' covariance (..., P, P)."""
    return np.asarray(np.trace(covariance[..., :3, :3], axis1=-2, axis2=-1))


def _cells(image_mm: Array, side_mm: float) -> IndexArray:
    """Number (K,), from 0 without gaps, of the square cell of the image that each point (K, 2) lies in."""
    cell = np.floor(image_mm / side_mm).astype(np.int64)
    cell -= cell.min(axis=0)
    return group_numbers(cell[:, 0] * (int(cell[:, 1].max()) + 1) + cell[:, 1])


def _places(image_mm: Array, patch: IndexArray, count: IndexArray) -> PatchPlaces:
    """Centres and spreads of patches in the image, from the points' coordinates (K, 2)."""
    centres = np.column_stack([np.bincount(patch, column) / count for column in image_mm.T])
    away = image_mm - centres[patch]
    spreads = np.empty((len(count), 2, 2))
    for i, j in ((0, 0), (0, 1), (1, 1)):
        spreads[:, i, j] = spreads[:, j, i] = np.bincount(patch, away[:, i] * away[:, j]) / count
    return PatchPlaces(centres, spreads)
