"""Robot calibration from scans of a three-faced jig: corners, five-parameter kinematics, and which effect is missing.

The public names of the library, each imported when it is first used, so that `import calib` is quick. Datasets, robots
and scans may be given as paths, effects by their names, and options of a fit as keywords:

    import calib

    found = calib.diagnose("my_cell")
    print(found.summary())
    found.save("model.json")
"""

from importlib import import_module

_DISTRIBUTION = "robot-calibration-inspector"

# Public names by the module that has them. Type checkers read the same in __init__.pyi: nothing is imported here, not
# even for them, so that no module that imports a part of calib is in a circle with this one.
_NAMES = {
    "calib.api.causes": ("diagnose", "screen"),
    "calib.api.corners": ("find_corners",),
    "calib.api.correction": ("corrected_joints",),
    "calib.api.fits": ("calibrate", "redundancy"),
    "calib.api.plans": ("plan",),
    "calib.api.validation": ("check", "compare", "cross_validate", "learning_curve", "repeat"),
    "calib.calibration.result": ("Calibration",),
    "calib.compensation.correction": ("Correction",),
    "calib.corners.batch": ("CornerBatch",),
    "calib.corners.intersection": ("Corner", "Intersection", "intersect_planes"),
    "calib.corners.search": ("CornerSearch", "find_corner"),
    "calib.dataset.dataset": ("Dataset", "Points", "Poses"),
    "calib.dataset.files.folder": ("load_dataset", "write_dataset"),
    "calib.diagnosis.result": ("Diagnosis",),
    "calib.effects.catalogue": ("catalogue_names",),
    "calib.effects.effect": ("Effect", "Family", "Parameter"),
    "calib.errors": ("CalibError",),
    "calib.identifiability.redundancy": ("Redundancy",),
    "calib.jig": ("Jig",),
    "calib.kinematics.robot": ("Robot",),
    "calib.models.fitted_model": ("FittedModel",),
    "calib.models.model_file": ("load_model", "save_model"),
    "calib.noise_shape": ("NoiseShape",),
    "calib.options": ("FitOptions",),
    "calib.planning.plan": ("Plan",),
    "calib.robot_formats.robots": ("load_robot", "save_robot"),
    "calib.scans.scan": ("Scan", "load_scan"),
    "calib.screening.candidates": ("Candidate", "Screening"),
    "calib.simulation.simulate": ("Simulation", "simulate_dataset"),
    "calib.validation.acceptance": ("Check",),
    "calib.validation.comparison": ("Comparison",),
    "calib.validation.cross_validation": ("CrossValidation", "LearningCurve"),
    "calib.validation.repeat": ("Recurrence",),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(["__version__", *_HOME])


def __getattr__(name: str) -> object:
    """Attribute of the package: a public name, imported from its module on first use (PEP 562)."""
    value: object
    if name == "__version__":
        from importlib.metadata import version

        value = version(_DISTRIBUTION)
    elif name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
    else:
        value = _of_plugin(name)
    globals()[name] = value
    return value


def _of_plugin(name: str) -> object:
    """Value of a public name that a plug-in brings. Raises AttributeError."""
    if not name.startswith("_"):  # Python itself asks for some of those
        from calib.plugins import PublicNames, contributions

        for brought in contributions(PublicNames):
            if name in brought.names:
                return getattr(import_module(brought.module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
