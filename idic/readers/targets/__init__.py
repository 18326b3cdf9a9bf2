"""Calibration targets in images: dot grids and chessboards to points with their place on the target."""
