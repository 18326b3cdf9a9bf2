"""Axes of figures."""
