"""The error of a model by its own mesh and by plane stress, known before any cause is blamed for it."""
