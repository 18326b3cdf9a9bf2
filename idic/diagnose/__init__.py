"""Diagnosis of model error: place, onset and missing physics of a misfit, judged by refits on held-out data."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
