"""Content of model.json as structs that msgspec checks: lengths mm, angles rad, other values with their unit."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from calib.brief import Brief
from calib.calibration.evaluation import Figures
from calib.dataset.files.origin import SavedOrigin
from calib.noise_shape import NoiseShape
from calib.options import FitOptions, TypePrior
from calib.strict_json import Finite, Size, SizeOrSign, Text

KIND, VERSION = "robot-calibration-inspector model", 1
Row = tuple[Finite, ...]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e300)]


def options_document(options: FitOptions) -> dict[str, Any]:
    """Options of a fit as saved in model.json, where the fixed parameters have the key `held`."""
    document = asdict(options)
    return document | {"held": document.pop("fixed")}


class SavedOptions(msgspec.Struct, frozen=True):
    """Options of a fit, as `options_document` writes them."""

    residual: str = "position"
    prior: bool = True
    held: tuple[str, ...] = ()
    tolerances: dict[str, float] = {}
    robust: bool = False
    noise: NoiseShape | None = None
    type_prior: TypePrior | None = None

    def options(self) -> FitOptions:
        """Options of a fit, from the saved ones. Raises FitError for a value that no fit can have."""
        return FitOptions(
            self.residual, self.prior, self.held, self.tolerances, self.robust, self.noise, self.type_prior
        )


class SavedMember(msgspec.Struct, frozen=True):
    """One effect in model.json: its name and fields."""

    family: Text
    fields: dict[str, Any]


class SavedParameter(msgspec.Struct, frozen=True):
    """A free parameter, whose value is nominal + change."""

    name: Text
    unit: str
    nominal: SizeOrSign
    change: SizeOrSign
    prior_sigma: Size
    sigma: NotNegative | None = None  # null: no bound


@dataclass(frozen=True)
class RoleErrors(Brief):
    """Errors of the training poses and of the test poses; None for a role without poses."""

    train: Figures | None = None
    test: Figures | None = None


class SavedSource(msgspec.Struct, frozen=True):
    """The dataset that the model was fitted to."""

    name: Text
    files: dict[str, Any]  # hash by file name; checked one by one
    training_poses: tuple[Text, ...]
    left_out: tuple[Text, ...] = ()  # poses left out of the fit, by request or as outliers


class SavedRange(msgspec.Struct, frozen=True):
    """Least and largest value of each joint, rad or mm."""

    low: Row
    high: Row


class SavedDiscrepancy(msgspec.Struct, frozen=True):
    """What a model is known to miss, by the distance from its training poses."""

    constant_mm2: NotNegative
    growth_mm2: NotNegative
    trained: tuple[Row, ...]
    scale: Row


class ModelDocument(msgspec.Struct, frozen=True):
    """Content of model.json, apart from its format and version."""

    program_version: Text
    dataset: SavedSource
    options: dict[str, Any]
    robot: dict[str, Any]  # nominal, angles in rad
    table: tuple[Row, ...]  # fitted; right only together with the effects
    effects: tuple[SavedMember, ...]  # in the order in which they act
    parameters: tuple[SavedParameter, ...]
    held: tuple[Text, ...]
    covariance: tuple[Row, ...]  # the lower triangle, diagonal included
    scanner_T_base: dict[str, Any]  # 4 x 4 by setup; checked one by one
    needs: tuple[Text, ...]  # columns of poses.csv that a prediction depends on
    before: RoleErrors
    after: RoleErrors
    origin: SavedOrigin = SavedOrigin()
    loads_table: tuple[Row, ...] | None = None  # links with which gravity's loads are computed
    found_tool_mm: Row | None = None  # tool point in the last joint's frame, where that of the robot is far off
    trained: SavedRange | None = None  # of the joints at the training poses
    discrepancy: SavedDiscrepancy | None = None
    sigma_mm: NotNegative | None = None
    scanner_T_flange: dict[str, Any] = {}  # in place of scanner_T_base where the arm carries the scanner
