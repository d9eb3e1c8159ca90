"""The public face as type checkers see it: what `__init__.py` loads when it is first asked for."""

from calib.calibration.calibrate import calibrate as calibrate
from calib.compensation.target_correction import corrected_joints as corrected_joints
from calib.corners.batch import find_corners as find_corners
from calib.corners.search import find_corner as find_corner
from calib.dataset.files.folder import load_dataset as load_dataset
from calib.dataset.files.folder import write_dataset as write_dataset
from calib.diagnosis.diagnose import diagnose as diagnose
from calib.effects.effect import Effect as Effect
from calib.effects.effect import Parameter as Parameter
from calib.errors import CalibError as CalibError
from calib.models.model_file import load_model as load_model
from calib.models.model_file import save_model as save_model
from calib.options import FitOptions as FitOptions
from calib.scans.scan import load_scan as load_scan
from calib.simulation.simulate import simulate_dataset as simulate_dataset

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
