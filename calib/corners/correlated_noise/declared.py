"""Correlated error of a scanner as declared in dataset.toml, where the scan itself does not show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.planes.robust_fit import PlaneFit, height_lever


@dataclass(frozen=True)
class DeclaredNoise:
    """Correlated error of the scanner as declared under [scanner] of dataset.toml; 0 where nothing is declared."""

    correlated_sigma_mm: float = 0.0  # of the error that neighbouring points share, along the ray
    correlation_length_mm: float = 0.0  # l of its correlation exp(-r^2 / 2 l^2)
    registration_sigma_mm: float = 0.0  # by which surfaces that were joined of several views are off, each axis


NOTHING_DECLARED = DeclaredNoise()
MESH_NOTE = (
    "neighbouring points share their errors, as in a mesh or where views were joined; how well those were joined no "
    "scan shows: give registration_sigma_mm or, of one view, correlated_sigma_mm under [scanner] in dataset.toml"
)


def note_on_views(assumed_mm: float) -> str:
    """Warning on points of several views whose registration is not declared, with what is assumed of it, mm."""
    if assumed_mm:
        return (
            "the points are those of several views that were joined; by how much these differ where they overlap the "
            f"corner is taken as off by {assumed_mm:.2g} mm (each axis): give registration_sigma_mm under [scanner] in "
            "dataset.toml, or scan one view"
        )
    return (
        "the points lie at random, as those of several views that were joined and thinned: if they are, give "
        "registration_sigma_mm under [scanner] in dataset.toml, of which no scan shows anything"
    )


def note_on_cells(cells_mm: float, assumed_mm: float) -> str:
    """Warning on points that are means over cells, with the cells' width and what is assumed of several views, mm."""
    return (
        f"the points are means over cells of {cells_mm:.2g} mm, as of joined views; how well those were joined no scan "
        f"shows, so they are taken as off by twice the points' scatter ({assumed_mm:.2g} mm, each axis): give "
        "registration_sigma_mm under [scanner] in dataset.toml, of one view a small one, or the scans as measured"
    )


def apex_variance_mm2(planes: Sequence[PlaneFit], covariance: Array) -> Array:
    """Trace (...), mm^2, of the covariance of three planes' intersection, from the planes' covariance (..., 9, 9)."""
    normals = np.array([plane.normal for plane in planes])
    apex = np.linalg.solve(normals, np.array([plane.offset_mm for plane in planes]))
    moved = np.linalg.solve(normals, height_lever(planes, apex))
    return np.einsum("jk,...jk->...", moved.T @ moved, covariance)


def share_of_declared(planes: Sequence[PlaneFit], shown: Array, declared: Array) -> float:
    """Share of the covariance (9, 9) by the declared correlated error that is added to that which a scan shows.

    It is above 0 where `shown` makes the apex more certain than `declared` alone would, and 1 where a scan shows none.
    """
    declared_mm2 = float(apex_variance_mm2(planes, declared))
    if declared_mm2 <= 0:
        return 0.0
    return max(0.0, 1 - float(apex_variance_mm2(planes, shown) / declared_mm2))


def registration_covariance(planes: Sequence[PlaneFit], sigma_mm: float) -> Array:
    """Covariance (9, 9) of three planes by a common shift of sigma_mm per axis, which no single scan reveals."""
    normals = np.array([plane.normal for plane in planes])
    covariance = np.zeros((9, 9))
    covariance[::3, ::3] = sigma_mm**2 * normals @ normals.T
    return covariance
