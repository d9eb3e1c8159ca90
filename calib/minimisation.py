"""Minima of smooth functions of one or a few numbers.

scipy.optimize has the same, but takes a quarter of a second to load, half of what a whole diagnosis takes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array

_GOLDEN = 0.5 * (3.0 - np.sqrt(5.0))
_MOST_STEPS = 500
_ENOUGH = 1e-4  # share of the fall that the slope promises, which a step has to bring (Armijo)
_SHORTEST = 1e-10  # share of a step, below which it is given up
_DIFFERENCE = 1e-6  # of forward differences


def minimum_on_line(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Place of a minimum between `low` and `high`, by Brent's method: parabolas, and golden sections where these fail.

    Source: Brent 1973, chapter 5; Forsythe, Malcolm and Moler 1977, fmin.
    """
    best = second = third = low + _GOLDEN * (high - low)
    f_best = f_second = f_third = function(best)
    step = before = 0.0
    for _ in range(_MOST_STEPS):
        middle = 0.5 * (low + high)
        near = 1.5e-8 * abs(best) + tolerance / 3.0
        if abs(best - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        parabola = False
        if abs(before) > near:
            r = (best - second) * (f_best - f_third)
            q = (best - third) * (f_best - f_second)
            p = (best - third) * q - (best - second) * r
            q = 2.0 * (q - r)
            p, q = (-p, q) if q > 0.0 else (p, -q)
            parabola = abs(p) < abs(0.5 * q * before) and q * (low - best) < p < q * (high - best)
            before = step
            if parabola:
                step = p / q
                if best + step - low < 2.0 * near or high - best - step < 2.0 * near:
                    step = near if middle >= best else -near
        if not parabola:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        tried = best + (step if abs(step) >= near else np.copysign(near, step))
        f_tried = function(tried)
        if f_tried <= f_best:
            low, high = (best, high) if tried >= best else (low, best)
            third, f_third, second, f_second, best, f_best = second, f_second, best, f_best, tried, f_tried
            continue
        low, high = (tried, high) if tried < best else (low, tried)
        if f_tried <= f_second or second == best:
            third, f_third, second, f_second = second, f_second, tried, f_tried
        elif f_tried <= f_third or third in (best, second):
            third, f_third = tried, f_tried
    return float(best)


def with_differences(function: Callable[[Array], float]) -> Callable[[Array], tuple[float, Array]]:
    """A function with its gradient by forward differences."""

    def both(at: Array) -> tuple[float, Array]:
        value = function(at)
        steps = _DIFFERENCE * np.eye(len(at))
        return value, np.array([(function(at + step) - value) / _DIFFERENCE for step in steps])

    return both


def descend(
    function: Callable[[Array], tuple[float, Array]],
    start: Array,
    *,
    steps: int,
    settled: float = 0.0,
    flat: float = 1e-5,
    bounds: tuple[Array, Array] | None = None,
) -> tuple[float, Array]:
    """Least value reached from a start and its place (K,), by the quasi-Newton method BFGS (Nocedal and Wright, ch 6).

    Args:
        function: value and gradient (K,).
        start: (K,).
        steps: largest number of steps.
        settled: relative change of the value that ends the descent.
        flat: largest entry of the gradient that ends it.
        bounds: lowest and highest places (K,), each; numbers that lean on a bound rest there.
    """
    low, high = bounds or (np.full(len(start), -np.inf), np.full(len(start), np.inf))
    at = np.clip(start, low, high)
    value, gradient = function(at)
    hessian = np.eye(len(at)) * max(float(np.linalg.norm(gradient)), 1e-300)  # a first step of length 1
    for k in range(steps):
        free = ~(((at <= low) & (gradient > 0.0)) | ((at >= high) & (gradient < 0.0)))
        if not free.any() or float(np.abs(gradient[free]).max()) <= flat:
            break
        step = np.zeros(len(at))
        step[free] = -np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        share, found = 1.0, None
        while share > _SHORTEST:
            there = np.clip(at + share * step, low, high)
            there_value, there_gradient = function(there)
            slope = float(gradient @ (there - at))
            if np.isfinite(there_value) and there_value <= value + _ENOUGH * slope:
                found = there, there_value, there_gradient
                break
            rise = there_value - value - slope if np.isfinite(there_value) else np.inf
            share *= float(np.clip(-0.5 * slope / rise, 0.1, 0.5)) if rise > 0.0 else 0.5
        if found is None:
            break
        moved, turned, fell = found[0] - at, found[2] - gradient, value - found[1]
        at, value, gradient = found
        if fell <= settled * max(abs(value), abs(value + fell), 1.0):
            break
        bend = float(moved @ turned)
        if bend > 1e-8 * float(np.linalg.norm(moved) * np.linalg.norm(turned)):
            if k == 0:
                hessian = np.eye(len(at)) * float(turned @ turned) / bend
            pushed = hessian @ moved
            hessian = hessian + np.outer(turned, turned) / bend - np.outer(pushed, pushed) / float(moved @ pushed)
    return value, at
