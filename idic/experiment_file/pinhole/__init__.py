"""Perspective (pinhole) cameras in an experiment file: calibration, placement of the mesh, degrees of freedom,
pairing of images."""
