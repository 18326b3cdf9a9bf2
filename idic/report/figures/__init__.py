"""Figures that any page may use, and their common style."""
