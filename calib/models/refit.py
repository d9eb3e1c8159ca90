"""Refit of a saved model to a later recording of its arm: effects and curves are held, frame, tool and links are not.

Effects and learned curves of a joint last for months, while the instrument's frame, the tool and, by less, the links
change with every set-up; a few new poses tell these anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.calibration.evaluation import evaluate_all
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect, Parameter, apply_values, corrects_robot, full_name
from calib.effects.link_errors import LinkErrors, TargetOffsets
from calib.effects.place_errors import PlaceErrors
from calib.effects.state import RobotState
from calib.errors import FitError
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.tool_point import behind_last_axis
from calib.kinematics.robot import TOOL_POINT, Robot, Target
from calib.kinematics.tool_point import tool_point_of
from calib.models.fitted_model import FittedModel
from calib.options import REFITS, FitOptions


@dataclass(frozen=True)
class HeldEffects:
    """Effects with their values, as one effect without parameters."""

    effects: tuple[Effect, ...]
    values: tuple[Array, ...]
    parameters: tuple[Parameter, ...] = ()
    name = "held_effects"

    def apply(self, state: RobotState) -> RobotState:
        """Robot state with all effects applied in order."""
        for effect, values in zip(self.effects, self.values, strict=True):
            state = apply_values(effect, state, values)
        return state


def refit(model: FittedModel, dataset: Dataset, what: str, options: FitOptions | None = None) -> Calibration:
    """Calibration of a later recording by an earlier model whose effects and curves keep their values.

    The tool and, by `what="links"`, the links are fitted near their values in the model, by the usual tolerances. What
    is held has a sigma of zero: by how much it is off shows in the residual, and so in the noise of all else.

    Args:
        model: an earlier model of the arm.
        dataset: the later recording, with measured points.
        what: "frame" for the instrument's frame and the tool, "links" for the links too.
        options: options of the fit.

    Raises:
        FitError: a model of another arm, missing conditions, too few poses, or another `what`.

    >>> import calib
    >>> from calib.models.refit import refit
    >>> model = calib.calibrate("sample_data/hidden_effect_a", effects=["transmission_error"]).fitted_model
    >>> refit(model, calib.load_dataset("sample_data/hidden_effect_a"), "links")
    Calibration(hidden_effect_a: 64 poses, test RMSE 2.32 -> ... mm, effects: transmission_error)
    """
    if what not in REFITS:
        raise FitError(f"option refit: found {what!r:.80}; expected {' or '.join(REFITS)}")
    model.require_same_arm(dataset)
    model.require_conditions(dataset.poses)
    options = options or FitOptions()
    dataset = model.as_measured(dataset)
    old = model.robot
    start = replace(old, targets=tuple(target for target in old.targets if not target.in_world))
    free = (*behind_last_axis(old), *(name for name in model.model.geometry_names if "." in name))
    held_links = () if what == "links" else tuple(name for name in old.parameter_names if name not in free)
    values = model.model.values_by_effect(model.x)
    pairs = [(e, v) for e, v in zip(model.model.effects, values, strict=True) if not corrects_robot(e)]
    held = HeldEffects(tuple(effect for effect, _ in pairs), tuple(of for _, of in pairs))
    of_links = {*old.parameter_names, *model.model.geometry_names}
    fixed = tuple(dict.fromkeys((*options.fixed, *(name for name in model.options.fixed if name in of_links))))
    asked = replace(options, fixed=(*fixed, *(name for name in held_links if name not in fixed)))
    fitted = fit_measured(replace(dataset, robot=start), asked, effects=[held] if pairs else [])
    whole = _whole_model(model, fitted, held.effects)
    fit = _whole_fit(fitted, whole, np.concatenate([np.zeros(0), *held.values]))
    before, after = evaluate_all(whole, [whole.delivered(fit.x), fit.x], dataset, fitted.outliers)
    averaged = None if fitted.averaged is None else replace(fitted.averaged, robot=dataset.robot)
    return replace(
        fitted,
        dataset=dataset,
        model=whole,
        options=replace(options, fixed=fixed),
        fit=fit,
        before=before,
        after=after,
        averaged=averaged,
    )


def _whole_model(old: FittedModel, fitted: Calibration, effects: tuple[Effect, ...]) -> Model:
    """The refitted model on the nominal robot of the old one, with the effects themselves in place of held ones."""
    nominal = _nominal(old.model.robot, fitted.model.robot)
    links = LinkErrors(nominal, fitted.options.tolerances)
    measured = [e for e in fitted.model.effects if isinstance(e, TargetOffsets)]
    names = {target.name for effect in measured for target in effect.targets}
    offsets = [TargetOffsets(tuple(t for t in nominal.targets if t.name in names), e.tolerances) for e in measured]
    model = Model(
        nominal,
        (links, *offsets, *(e for e in fitted.model.effects if isinstance(e, PlaceErrors)), *effects),
        prior_sigmas={**old.model.prior_sigmas, **fitted.model.prior_sigmas},
        loads_of=fitted.model.loads_of,
        tool_found=fitted.model.tool_found or old.model.tool_found,
    )
    return model.with_fixed([name for name in sorted(old.model.fixed) if name in {p.name for p in model.parameters}])


def _nominal(old: Robot, fitted: Robot) -> Robot:
    """Nominal robot with the targets of the refitted one: new places in the room, nominal ones on the arm."""
    known = {target.name: target for target in old.targets}

    def nominal(target: Target) -> Target:
        if target.in_world:
            return target
        if target.name == TOOL_POINT and TOOL_POINT not in known:  # found far from where it was
            x, y, z = tool_point_of(old).tolist()
            return replace(target, xyz_mm=(x, y, z))
        return known[target.name]

    return replace(old, targets=tuple(map(nominal, fitted.targets)))


def _whole_fit(fitted: Calibration, whole: Model, held: Array) -> Fit:
    """The fit with all parameters of the whole model, the held ones at their old values with a sigma of zero."""
    to_whole = _to_whole(fitted, whole, held)
    index = {p.name: i for i, p in enumerate(whole.parameters)}
    of_fit = [(i, index[p.name]) for i, p in enumerate(fitted.fit.parameters)]
    own, at = ([pair[k] for pair in of_fit] for k in (0, 1))
    covariance = np.zeros((len(index), len(index)))
    covariance[np.ix_(at, at)] = fitted.fit.covariance[np.ix_(own, own)]
    undetermined = np.zeros(len(index), dtype=bool)
    undetermined[at] = fitted.fit.undetermined[own]
    return replace(
        fitted.fit,
        parameters=whole.parameters,
        x=to_whole(fitted.fit.x),
        covariance=covariance,
        undetermined=undetermined,
        iterations=tuple(replace(each, x=to_whole(each.x)) for each in fitted.fit.iterations),
    )


def _to_whole(fitted: Calibration, whole: Model, held: Array) -> Callable[[Array], Array]:
    """Function that gives the whole model's parameters for those of the fit that ran with held effects."""
    kept = np.array([p.name not in whole.fixed for e in whole.effects if corrects_robot(e) for p in e.parameters])
    free = [p.name for p in whole.parameters]
    added = [full_name(effect, p) for effect in whole.added_effects for p in effect.parameters]
    is_free = np.array([name in free for name in added], dtype=bool)

    def to_whole(x: Array) -> Array:
        robot = fitted.model.calibrated_robot(x)
        places = {target.name: np.array(target.xyz_mm) for target in robot.targets}
        corrections = [(robot.table - whole.robot.table).ravel()]
        for effect in whole.effects:
            if isinstance(effect, TargetOffsets):
                corrections += [places[target.name] - np.array(target.xyz_mm) for target in effect.targets]
        corrections += [
            of
            for e, of in zip(fitted.model.effects, fitted.model.values_by_effect(x), strict=True)
            if isinstance(e, PlaceErrors)
        ]
        return np.concatenate([np.concatenate(corrections)[kept], held[is_free]])

    return to_whole
