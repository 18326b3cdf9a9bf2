"""The same test by a finer model: a refined mesh, solid elements of the real thickness."""
