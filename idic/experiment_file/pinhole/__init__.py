"""Perspective (pinhole) cameras in an experiment file: calibration, placement of the mesh,
pairing of images."""
