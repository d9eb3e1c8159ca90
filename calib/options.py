"""Names and defaults of users' options. Nothing slow is imported here, so that `inspector --help` is quick."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from numbers import Real
from typing import NoReturn, TypedDict

from calib.errors import FitError
from calib.noise_shape import NoiseShape

RESIDUAL_KINDS = ("position", "distance", "pairs", "pose")
"""Residuals that a fit can minimise, defined in `calib.fitting.residual_kinds`."""
CORRECTION_KINDS = ("position", "pose")
"""Parts of the tool frame that a correction can meet, see `calib.compensation.target_correction`."""
REFITS = ("frame", "links")
"""What a refit of a saved model fits anew besides the instrument's frame: the tool, or the links too
(`calib.models.refit`)."""
PLAN_REGIONS = ("auto", "test", "measurable", "all")
"""Regions over which a plan minimises the predicted error, see `calib.planning.plan`."""
"""Optimality criteria of a plan for a calibration, see `calib.planning.criterion`."""
NEW_ARM_POSES = 20
"""Training poses of an arm that is left out of its fleet, by which its fit begins from the others' type."""
DEFAULT_FOLDS = 5  # of a cross-validation
BUILTIN_ROBOTS = ("rb5", "panda")
"""Robots that come with the library, read by `calib.dataset.files.robot_toml`."""
MAX_TOLERANCE = 1e6  # mm or rad; `prior=False` is the way to have none
GREEK_LETTERS = {"alpha": "α", "beta": "β", "theta": "θ"}
"""Letters by which tables and figures show the parameters whose names begin with these words."""
LINKS = "links"
"""Word among `FitOptions.fixed` for all link parameters of robot.toml but the tool's: the arm is held as it is."""
_SHOWN_NAME = re.compile(rf"([{''.join(GREEK_LETTERS.values())}])(\d+|TCP)")


def parameter_name(typed: str) -> str:
    """Name of a parameter that was typed by that name or as tables show it: "theta1" for "θ1"."""
    shown = _SHOWN_NAME.fullmatch(typed)
    if shown is None:
        return typed
    letter, row = shown.groups()
    return next(word for word, symbol in GREEK_LETTERS.items() if symbol == letter) + row


@dataclass(frozen=True)
class TypePrior:
    """Prior of an arm's parameters by full name, mm, rad or an effect's own units."""

    means: Mapping[str, float] = field(default_factory=dict)
    sigmas: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit, checked when made; a result keeps its options for every refit.

    Raises FitError, which names the option, the value that was found, and the values that are possible.

    >>> from calib import FitOptions
    >>> FitOptions(residual="pairs", fixed=["d5"])
    FitOptions(residual='pairs', prior=True, fixed=('d5',), tolerances={}, robust=False, noise=None, type_prior=None)
    >>> FitOptions("positon")
    Traceback (most recent call last):
    calib.errors.FitError: option residual: found 'positon'; expected position, distance, pairs or pose, ...
    """

    residual: str = "position"
    """"position" (scanner frames are free), "distance" (Jang), "pairs", or "pose" (with orientations)."""
    prior: bool = True
    """Whether parameters have a Gaussian prior, with their tolerance as its standard deviation."""
    fixed: tuple[str, ...] = ()
    """Names of parameters that stay at their nominal value; "θ1", as tables show it, is "theta1"; "links": all."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Tolerances of single link parameters by name, mm or rad, in place of the default of 1 mm and 0.5 deg."""
    robust: bool = False
    """Whether outlying poses are left out of the fit (`calib.fitting.robust`); not for "distance"."""
    noise: NoiseShape | None = None
    """Shape of the measured points' noise, where it is known to differ from the declared one."""
    type_prior: TypePrior | None = None
    """What other arms of the type tell of the parameters, in place of zero and the usual tolerances."""

    def __post_init__(self) -> None:
        if self.residual not in RESIDUAL_KINDS:
            near = get_close_matches(str(self.residual), RESIDUAL_KINDS, n=1)
            nearest = f", most like {near[0]!r}" if near else ""
            _refuse("residual", self.residual, f"{', '.join(RESIDUAL_KINDS[:-1])} or {RESIDUAL_KINDS[-1]}{nearest}")
        for name in ("prior", "robust"):
            if not isinstance(getattr(self, name), bool):
                _refuse(name, getattr(self, name), "True or False")
        fixed: object = self.fixed
        if not isinstance(fixed, Collection) or isinstance(fixed, str) or not all(isinstance(f, str) for f in fixed):
            _refuse("fixed", fixed, "a list of parameters' names, such as ['d5']")
        object.__setattr__(self, "fixed", tuple(map(parameter_name, fixed)))
        tolerances: object = self.tolerances
        if not isinstance(tolerances, Mapping):
            _refuse("tolerances", tolerances, "sizes by parameters' names, such as {'a2': 0.1}")
        for name, size in tolerances.items():
            if not isinstance(size, Real) or not 0.0 < float(size) <= MAX_TOLERANCE:
                needed = f"a size above 0 and up to {MAX_TOLERANCE:g} is needed, in mm or rad"
                raise FitError(f"tolerance of {name}: found {size!r:.80}; {needed}")
        named = {parameter_name(name) if isinstance(name, str) else name: size for name, size in tolerances.items()}
        object.__setattr__(self, "tolerances", named)
        if self.noise is not None and not isinstance(self.noise, NoiseShape):
            _refuse("noise", self.noise, "a NoiseShape")
        if self.type_prior is not None and not isinstance(self.type_prior, TypePrior):
            _refuse("type_prior", self.type_prior, "a TypePrior")

    def with_residual(self, residual: str) -> FitOptions:
        """The options with another kind of residual."""
        return replace(self, residual=residual)

    def for_parameters(self, names: Collection[str]) -> FitOptions:
        """The options with only those fixed parameters that are among `names`, for a model with fewer parameters."""
        return replace(self, fixed=tuple(name for name in self.fixed if name in names or name == LINKS))


class FitFields(TypedDict, total=False):
    """Fields of `FitOptions` as keywords of a function that fits."""

    residual: str
    prior: bool
    fixed: Sequence[str]
    tolerances: Mapping[str, float]
    robust: bool
    noise: NoiseShape | None
    type_prior: TypePrior | None


def fit_options(options: FitOptions | None, keywords: FitFields) -> FitOptions:
    """The given or default options, with fields replaced by keywords. Raises FitError on an unknown keyword."""
    known = [one.name for one in fields(FitOptions)]
    for name in keywords:
        if name not in known:
            raise FitError(f"no option named {name!r}; the options of a fit are {', '.join(known)}")
    return replace(options or FitOptions(), **keywords)  # type: ignore[arg-type]  # a sequence becomes a tuple


def _refuse(name: str, found: object, expected: str) -> NoReturn:
    """Raise FitError for the value of an option."""
    raise FitError(f"option {name}: found {found!r:.80}; expected {expected}")
