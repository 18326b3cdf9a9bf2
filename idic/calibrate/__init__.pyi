from .camera_calibration import MIN_VIEWS, calibrate
from .records import Calibration, Lens

__all__ = [
    "MIN_VIEWS", "Calibration", "Lens", "calibrate",
]
