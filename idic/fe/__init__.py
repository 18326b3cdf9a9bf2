"""Finite elements: time integration of equilibrium, exact sensitivities, first-order responses; external solvers.

``model.py`` is the record of a body, ``march.py`` simulates it frame by frame: ``increment_size.py`` and
``predictor.py`` prepare an increment, ``equilibrium.py`` solves it, ``sensitivity.py`` differentiates it
(docs/method.md, section 12).
"""
