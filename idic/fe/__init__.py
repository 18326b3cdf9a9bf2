"""Finite elements: time integration of equilibrium, exact sensitivities, first-order responses; external solvers.

``body/`` holds the record of a body, ``time_march.py`` simulates it frame by frame: ``increment_size.py`` and
``predictor.py`` prepare an increment, ``equilibrium.py`` solves it, ``sensitivity.py`` differentiates it
(docs/method.md, section 12).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
