"""Volumes in experiment.toml: the scans, the scanner, checks of axes and size."""
