"""Readers of files: images, videos, meshes and logs as arrays with units; sets by position."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
