"""Perspective (pinhole) cameras: the surface point that a pixel shows, and its image under a motion of the nodes."""
