"""Common parts of all laws: declaration and registry, compilation, loops over points, tensor algebra."""

import lazy_loader

# modules that the door of the room names as they are
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["point", "tensors"])
