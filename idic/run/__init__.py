"""What a command does, from the experiment to the RUN folder. No equation and no threshold lives here."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
