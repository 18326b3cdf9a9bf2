"""Virtual experiments with known truth: the renderer, the built-in examples, `idic simulate`.

``render.py`` makes grey images of a moving mesh, ``section_images.py`` height images of a section; neither shares code
with the correlation. ``virtual_test.py`` is the record of a test before noise, made by ``demo.py`` and by the studies;
``examples.py`` writes it to a folder, ``simulated_experiment.py`` does the same for any experiment. ``stereo_plate.py``
is the example `stereo`: perspective cameras, rays traced to deformed surfaces, a speckle in space.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
