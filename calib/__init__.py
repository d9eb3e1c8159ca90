"""Robot calibration from scans of a three-faced jig: corners, five-parameter kinematics, which effect is missing.

This is the public face: what a script needs, each loaded when it is first asked for, so that `import calib` is quick.

    import calib

    dataset = calib.load_dataset("my_cell")
    result = calib.diagnose(dataset)
    print(result.summary())
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.calibration.calibrate import calibrate
    from calib.compensation.target_correction import corrected_joints
    from calib.corners.batch import find_corners
    from calib.corners.search import find_corner
    from calib.dataset.files.folder import load_dataset, write_dataset
    from calib.diagnosis.stepwise import diagnose
    from calib.effects.effect import Effect, Parameter
    from calib.errors import CalibError
    from calib.options import FitOptions
    from calib.scans.scan import load_scan
    from calib.simulation.simulate import simulate_dataset

_HOME = {
    "CalibError": "calib.errors",
    "Effect": "calib.effects.effect",
    "FitOptions": "calib.options",
    "Parameter": "calib.effects.effect",
    "calibrate": "calib.calibration.calibrate",
    "corrected_joints": "calib.compensation.target_correction",
    "diagnose": "calib.diagnosis.stepwise",
    "find_corner": "calib.corners.search",
    "find_corners": "calib.corners.batch",
    "load_dataset": "calib.dataset.files.folder",
    "load_scan": "calib.scans.scan",
    "simulate_dataset": "calib.simulation.simulate",
    "write_dataset": "calib.dataset.files.folder",
}

__all__ = [
    "CalibError",
    "Effect",
    "FitOptions",
    "Parameter",
    "calibrate",
    "corrected_joints",
    "diagnose",
    "find_corner",
    "find_corners",
    "load_dataset",
    "load_scan",
    "simulate_dataset",
    "write_dataset",
]


def __getattr__(name: str) -> object:
    """What a script needs, from the module that has it (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
