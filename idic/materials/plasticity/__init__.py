"""Elastoplasticity: what all laws of this kind share, Hill's surface, and the short forms of the composed law."""
