"""Real surfaces and real noise: photographs of speckle, and the residual between repeated photographs.

The photographs are the user's own (`idic trial --photographs FOLDER`); no file of them is part of idic. A surface is
the part of a photograph that shows speckle alone. Its grey values between pixels are those of a spline of degree five,
which the correlator does not use. The noise is the residual between repeated photographs of a surface at rest, after
light and shift are fitted tile by tile.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from idic.errors import InputError
from idic.readers import read_image

DEGREE = 5  # of the spline of a photograph
TILE_PX = 32  # of the fit of light and shift between repeated photographs
ROWS_OVER_COLUMNS = 0.75  # of the images, about
SCALES = (1.3, 1.8)  # photograph pixels per image pixel: an image pixel averages the noise of the photograph


@dataclass(frozen=True)
class Surface:
    """Files below the folder: one photograph, repeated ones; rows and columns of each that show speckle alone (px)."""

    photograph: str
    window: tuple[slice, slice]
    repeated: tuple[str, ...]
    repeated_window: tuple[slice, slice]


_STEREO = tuple(f"stereo/stereo_auto/images/img_{k:04d}_0.tif" for k in range(6))
_STEREO_WINDOW = np.s_[285:545, 140:1180]
_COMPOSITE_WINDOW = np.s_[10:470, 545:845]
SURFACES = {
    "stereo": Surface(_STEREO[0], _STEREO_WINDOW, _STEREO, _STEREO_WINDOW),
    "composite": Surface("open-hole-composite/images/zoom-0050_1.tif", _COMPOSITE_WINDOW,
                         ("open-hole-composite/images/zoom-0070_1.tif", "open-hole-composite/images/zoom-0075_1.tif"),
                         _COMPOSITE_WINDOW),
    "necking": Surface("tension-necking/images/ut_151.tif", np.s_[320:1700, 320:530], _STEREO, _STEREO_WINDOW),
}


@dataclass(frozen=True)
class Photograph:
    """A surface at a place: the counterpart of `idic.images.pattern.Pattern`.

    Attributes
    ----------
    folder : of the user's photographs; surface : key of `SURFACES`
    row, column : of the photograph, at pixel (0, 0) of the image (px)
    scale : photograph pixels per image pixel
    """

    folder: str
    surface: str
    row: float
    column: float
    scale: float

    @property
    def content(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise of one photograph, rounding included (grey values)."""
        return float(_left_over(self.folder, self.surface).std())

    def value(self, points_px: np.ndarray) -> np.ndarray:
        """Grey values at points of the undeformed surface in image px; beyond the window it is mirrored.  (n, 2) → (n,)
        """
        x = np.asarray(points_px, dtype=float) * self.scale
        places = np.stack([self.row + x[:, 1], self.column + x[:, 0]])
        return map_coordinates(_spline(self.folder, self.surface), places, order=DEGREE, mode="mirror", prefilter=False)

    def noise(self, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
        """Noise of one image: a window of the residual between two photographs, at a random place  # (ny, nx)"""
        residuals = _left_over(self.folder, self.surface)
        field = residuals[rng.integers(len(residuals))] * rng.choice([-1.0, 1.0])
        first = [int(rng.integers(n)) for n in field.shape]
        return field[np.ix_(*((k + np.arange(n)) % size for k, n, size in zip(first, shape, field.shape, strict=True)))]


def drawn_photograph(rng: np.random.Generator, folder: str, columns: int) -> Photograph:
    """A surface, a scale and a place that shows an image of so many columns without mirrors, where there is one."""
    surface, scale = str(rng.choice(sorted(SURFACES))), float(rng.uniform(*SCALES))
    needed = scale * columns * np.array([ROWS_OVER_COLUMNS, 1.0])
    row, column = rng.uniform(0.0, np.maximum(_spline(folder, surface).shape - needed, 1.0))
    return Photograph(folder, surface, float(row), float(column), scale)


def check_photographs(folder: str | Path) -> None:
    """`InputError` where the folder does not hold all surfaces."""
    required = dict.fromkeys(name for s in SURFACES.values() for name in (s.photograph, *s.repeated))
    missing = [name for name in required if not (Path(folder) / name).is_file()]
    if missing:
        raise InputError("photographs are missing", key="--photographs", file=Path(folder), found=f"no {missing[0]}",
                         expected=", ".join(sorted({name.partition("/")[0] for name in required})),
                         remedy="name the folder that holds these recordings")


@lru_cache(maxsize=8)
def _spline(folder: str, surface: str) -> np.ndarray:
    photographed = SURFACES[surface]
    image = _grey(folder, photographed.photograph)[photographed.window]
    return spline_filter(image if image.shape[0] < image.shape[1] else image.T, order=DEGREE, mode="mirror")  # lying


@lru_cache(maxsize=8)
def _left_over(folder: str, surface: str) -> np.ndarray:
    """Noise of single photographs  # (n - 1, ny, nx) grey values, from n repeated ones"""
    photographed = SURFACES[surface]
    first, *repeats = (_grey(folder, name)[photographed.repeated_window] for name in photographed.repeated)
    return np.array([_beyond_light_and_shift(first, repeat) for repeat in repeats]) / np.sqrt(2.0)


def _beyond_light_and_shift(first: np.ndarray, repeat: np.ndarray) -> np.ndarray:
    """What no offset, gain and shift of a tile explains  # (ny, nx)"""
    slopes = np.gradient(gaussian_filter(first, 0.5))
    residual = np.empty_like(first)
    for i in range(0, first.shape[0], TILE_PX):
        for j in range(0, first.shape[1], TILE_PX):
            tile = np.s_[i:i + TILE_PX, j:j + TILE_PX]
            base = np.column_stack([np.ones(first[tile].size), *(a[tile].ravel() for a in (first, *slopes))])
            values = repeat[tile].ravel()
            residual[tile] = (values - base @ np.linalg.lstsq(base, values,
                                                              rcond=None)[0]).reshape(residual[tile].shape)
    return residual


def _grey(folder: str, name: str) -> np.ndarray:
    return np.asarray(read_image(Path(folder) / name), dtype=float)
