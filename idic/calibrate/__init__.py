"""Calibration of one camera or a pair from views of a flat target: start, bundle adjustment, covariance."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
