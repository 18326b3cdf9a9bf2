"""Calibration files of other systems: one reader per format, one record for all."""
