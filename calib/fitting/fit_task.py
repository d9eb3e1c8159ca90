"""Fit of robot.toml's table and of effects, with a search for the tool point where robot.toml has it far off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.effects.effect import Effect
from calib.effects.link_errors import LinkErrors, TargetOffsets, target_parameter_names
from calib.fitting.fit import Fit, Iteration
from calib.fitting.model import Model
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.residual import Residuals
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.robust import solve_with_tails
from calib.fitting.tool_point import fitted_tool_point, search_tool_point, turning_tool_point, with_found_tool
from calib.fitting.trust_region import solve
from calib.kinematics.robot import Robot
from calib.options import FitOptions


@dataclass(frozen=True)
class Fitted:
    """A model and the fit of its parameters."""

    model: Model
    fit: Fit


@dataclass(frozen=True)
class FitTask:
    """All that a fit needs: model, measured points, and options."""

    model: Model
    geometry: tuple[Effect, ...]  # the first of its effects, with the tolerances that were asked for
    observed: Observations  # without the scanner's frames
    options: FitOptions

    @property
    def links(self) -> LinkErrors:
        assert isinstance(self.geometry[0], LinkErrors)
        return self.geometry[0]

    @property
    def offsets(self) -> TargetOffsets | None:
        """Effect that corrects the positions of further measured targets; None where there are none."""
        return next((effect for effect in self.geometry if isinstance(effect, TargetOffsets)), None)

    def of_geometry_alone(self) -> FitTask:
        """Task that fits robot.toml's corrections alone, as a start for the fit with all effects."""
        of = self.model
        model = Model(of.robot, self.geometry, of.fixed, prior_sigmas=of.prior_sigmas, prior_means=of.prior_means)
        return replace(self, model=model)

    def of(self, kept: BoolArray) -> FitTask:
        """Task restricted to the points where `kept` (M,) is True."""
        return replace(self, observed=self.observed.select(kept))

    def fitted_to_tool(self) -> Fitted:
        """Fit that looks for the tool point near robot.toml's or, where that is far off, near one found from the data.

        It is far off by the points alone, or by a fit that moves it further than tolerances allow or turns the tip to
        move it; a later fit overrules an earlier one. A scanner on the flange does not measure the tool, and lengths
        show too little of it.
        """
        if self.model.robot.carries_scanner or self.observed.points.lengths is not None:
            return self.fitted(None)
        fixed = self.model.fixed
        found = search_tool_point(self.observed, self.links, fixed)
        first = self.fitted(found)
        if not self.options.prior:  # then parameters that the data do not know move freely, and the tool with them
            return first
        settled = first
        confirmed = fitted_tool_point(first.model, first.fit, self.links, fixed)
        if (found is None) != (confirmed is None):
            second = self.fitted(confirmed)
            if confirmed is None or fitted_tool_point(second.model, second.fit, self.links, fixed) is not None:
                settled = second
        if settled.model.tool_found is None:
            turning = turning_tool_point(settled.model, settled.fit, self.links, fixed)
            settled = settled if turning is None else self.fitted(turning)
        return settled

    def fitted(self, tool_found: Robot | None, before: Fit | None = None) -> Fitted:
        """Fit that starts from an earlier fit, else from the nominal robot, whose tool point may be replaced.

        before: the earlier fit. tool_found: nominal robot with another tool point.
        """
        model, prior = self.model, self.options.prior
        if tool_found is not None:
            model = with_found_tool(model, self.links, self.offsets, self.observed, tool_found)
        observed = with_nominal_scanner_frames(self.observed, model.placed_robot)
        earlier: tuple[Iteration, ...] = ()  # iterations of the fits before this one
        if before is not None:
            earlier = _in_order_of(model, before)
        elif tool_found is not None:
            earlier = _to_found_tool(model, make_residuals(self.options.residual, model, observed))
        first_x = earlier[-1].x if earlier else np.zeros(len(model.parameters))
        if model.added_effects:
            model = model.with_loads_at(first_x)
        noise = self.options.noise
        if noise is not None and noise.tail is not None:
            fit = solve_with_tails(
                lambda weighted: make_residuals(self.options.residual, model, weighted),
                observed,
                noise.tail,
                start=first_x,
                prior=prior,
            )
        else:
            residuals = make_residuals(self.options.residual, model, observed)
            fit = solve(residuals, start=first_x, prior=prior)
        return Fitted(model, replace(fit, iterations=(*earlier[:-1], *fit.iterations)))


def _to_found_tool(model: Model, residuals: Residuals) -> tuple[Iteration, ...]:
    """First two iterations of a fit: the nominal robot, and the nominal robot with the found tool point."""
    nominal = np.zeros(len(model.parameters))
    own = model.placed_robot.own_tool_point
    assert own is not None
    place_mm = dict(zip(target_parameter_names(own), own.xyz_mm, strict=True))
    found = np.array([place_mm[p.name] - p.nominal if p.name in place_mm else 0.0 for p in model.parameters])

    def at(x: Array, step: float) -> Iteration:
        residual = residuals.residual(x)
        return Iteration(x, float(residual @ residual), step)

    return at(nominal, 0.0), at(found, float(np.linalg.norm(found / model.scales)))


def _in_order_of(model: Model, fit: Fit) -> tuple[Iteration, ...]:
    """Iterations of a fit, with x reordered to the parameters of another model; missing ones are zero."""

    def in_order(x: Array) -> Array:
        values = dict(zip((p.name for p in fit.parameters), x.tolist(), strict=True))
        return np.array([values.get(p.name, 0.0) for p in model.parameters])

    return tuple(replace(step, x=in_order(step.x)) for step in fit.iterations)
