"""Motion and strain measured from the images alone: `dic/`, the free FE-DIC; `fields/`, strain and stress on the
surface."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
