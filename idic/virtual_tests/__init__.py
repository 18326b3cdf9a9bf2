"""Virtual experiments with known truth: the renderer, the built-in examples, `idic simulate`.

``render.py`` makes grey images of a moving mesh, ``section_images.py`` height images of a section; neither shares code
with the correlation. ``virtual_test.py`` is the record of a test before noise, made by ``demo.py`` and by the studies;
``examples.py`` writes it to a folder, ``simulate.py`` does the same for any experiment.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
