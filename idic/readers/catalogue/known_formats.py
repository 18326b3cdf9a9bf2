"""All formats that idic reads, as their readers declare them."""

from __future__ import annotations

from idic.readers import images, logs, meshes
from idic.readers.calibration import read as calibration
from idic.readers.fields import series
from idic.readers.formats.format import Format

FORMATS: tuple[Format, ...] = (*images.FORMATS, *logs.FORMATS, *series.FORMATS, *meshes.FORMATS, *calibration.FORMATS)
