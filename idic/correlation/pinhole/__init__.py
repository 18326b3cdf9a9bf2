"""Cameras with a lens: which point of a surface a pixel shows, and what motion of the nodes does to its image."""
