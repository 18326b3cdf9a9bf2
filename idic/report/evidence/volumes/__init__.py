"""Volumes in a report: sections of the mesh, and the facts of `idic check`."""
