"""Correlation of height images: of a surface, and of a cross-section seen from above."""
