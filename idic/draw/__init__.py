"""`idic draw`: a local page that draws the mesh on the reference image, writes experiment.toml and starts `idic
identify`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
