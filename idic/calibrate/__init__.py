"""Calibration of one camera or a pair from views of a flat target: start, bundle adjustment, covariance."""
