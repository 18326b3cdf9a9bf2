from .camera_calibration import MIN_VIEWS, calibrate
from .judge import coverage, tilts_deg
from .records import Calibration, Lens

__all__ = [
    "MIN_VIEWS", "Calibration", "Lens", "calibrate", "coverage", "tilts_deg",
]
