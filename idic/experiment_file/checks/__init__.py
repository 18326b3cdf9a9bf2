"""Checks of what was read: laws, supports and view of the model, images that should be at rest."""
