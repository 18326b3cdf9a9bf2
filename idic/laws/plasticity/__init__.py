"""Elastoplasticity: common parts of all laws of this kind, Hill's surface and the free surface."""
