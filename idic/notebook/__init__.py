"""idic from Python: an experiment from arrays, its identification in memory or in a RUN, tables and pictures of the
result."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
