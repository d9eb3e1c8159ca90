"""Robot calibration from scans of a three-faced jig: corners, five-parameter kinematics, which effect is missing.

This is the public face: what a script needs, each loaded when it is first asked for, so that `import calib` is quick.

    import calib

    dataset = calib.load_dataset("my_cell")
    result = calib.diagnose(dataset)
    print(result.summary())
"""

from importlib import import_module

# Type checkers read the same list in __init__.pyi: nothing is imported here, not even for them, so that no module that
# imports a part of calib stands in a circle with it.
_HOME = {
    "CalibError": "calib.errors",
    "Effect": "calib.effects.effect",
    "FitOptions": "calib.options",
    "Parameter": "calib.effects.effect",
    "calibrate": "calib.calibration.calibrate",
    "corrected_joints": "calib.compensation.target_correction",
    "diagnose": "calib.diagnosis.diagnose",
    "find_corner": "calib.corners.search",
    "find_corners": "calib.corners.batch",
    "load_dataset": "calib.dataset.files.folder",
    "load_model": "calib.models.model_file",
    "load_scan": "calib.scans.scan",
    "save_model": "calib.models.model_file",
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
    "load_model",
    "load_scan",
    "save_model",
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
