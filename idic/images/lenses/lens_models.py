"""The lens models by their name in experiment.toml, ``model`` of a camera."""

from __future__ import annotations

from idic.images.lens_camera import LensCamera
from idic.images.lenses.brown import PinholeCamera
from idic.images.lenses.division import DivisionCamera

LENS_MODELS: dict[str, type[LensCamera]] = {"pinhole": PinholeCamera, "division": DivisionCamera}
LENS_PARAMETERS = tuple(dict.fromkeys(name for model in LENS_MODELS.values() for name in model.parameters))
