"""Correlation with measured fields instead of images: point displacements exported by another DIC system.

Every point is two "pixels", one per component, whose grey value is a displacement in µm and whose gradient is the scale
(docs/method.md, section 15). So all sums, weights and error bars are those of images.
"""
