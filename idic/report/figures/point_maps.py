"""Measured fields point by point: displacement, and residual of the model in µm and in units of its noise."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize

from idic.report.figures.maps import RESIDUAL_RANGE, entitle, grid
from idic.report.figures.picture import Picture
from idic.report.figures.style import DIVERGING, SEQUENTIAL, look, to_picture
from idic.report.result.record import PointMaps, RunRecord

COMPONENTS = ("x", "y", "z")
MARKER = 1.35  # side of a marker in distances of neighbours: no seams between them


def point_maps(record: RunRecord) -> Picture | None:
    """Displacement (mean taken off) and residual of the points along x, y and, of a solid, z; None of images."""
    data, sigma = record.points, record.noise_gv
    if data is None or not sigma or not len(data.frames):
        return None
    low, high = data.positions_mm.min(axis=0) - data.pitch_mm, data.positions_mm.max(axis=0) + data.pitch_mm
    with look():
        names = COMPONENTS[:data.measured.shape[2]]
        n = len(names)
        figure, axes = grid(2 * n, len(data.frames), (low[0], high[0], low[1], high[1]))
        size = _marker_points(axes[0, 0], data, high - low)
        for component, name in enumerate(names):
            noise = sigma if component < 2 else data.depth_noise_um
            moved = data.measured[:, :, component] - np.nanmean(data.measured[:, :, component], axis=1)[:, None]
            drawn = _row(axes[component], data, moved, _norm(moved), size,
                         lambda m: (f"{_short(np.nanmax(m) - np.nanmin(m))} µm",))
            figure.colorbar(drawn, ax=axes[component], label=f"u{name} − mean [µm]", shrink=0.85, aspect=15, pad=0.01)
            residual = data.residual[:, :, component]
            norm = Normalize(-RESIDUAL_RANGE * noise, RESIDUAL_RANGE * noise)
            drawn = _row(axes[n + component], data, residual, norm, size,
                         lambda m, noise=noise: (f"{_short(rms(m))} µm, ", f"{_short(rms(m) / noise)} σ"))
            figure.colorbar(drawn, ax=axes[n + component], label=f"residual {name} [µm]", shrink=0.85,
                            aspect=15, pad=0.01, extend="both")
        for row, name in enumerate((*(f"u{c}" for c in names), *(f"residual {c}" for c in names))):
            axes[row, 0].set_ylabel(name)
        for axis in axes.ravel():
            axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
            axis.grid(False)
        along_z, axes_shown = (f" ({data.depth_noise_um:.3g} µm along z)", "x, y and z") if n == 3 else ("", "x and y")
        caption = ("Measured displacement minus its mean (above each map: smallest to largest), and measured minus "
                   "simulated displacement with the identified values (above: rms). σ = "
                   f"{sigma:.3g} µm is the noise of a component of a point{along_z}, the colours of the residual end "
                   f"at {RESIDUAL_RANGE:g} σ. A map of noise alone has 1.0 to 1.4 σ, as the reference stage has noise "
                   f"too. {axes_shown} are those of the mesh.")
        return to_picture(figure, "point_maps", "Measured points", caption, as_photo=True)


def _row(axes, data: PointMaps, values: np.ndarray, norm: Normalize, size: float, describe):
    """One map per frame; values (k, n); describe : parts of the title of a map."""
    cmap = DIVERGING if norm.vmin < 0 < norm.vmax else SEQUENTIAL
    for k, frame in enumerate(data.frames):
        drawn = axes[k].scatter(*data.positions_mm.T, c=values[k], s=size, marker="s", lw=0, cmap=cmap, norm=norm)
        entitle(axes[k], f"frame {frame},  ", *describe(values[k]))
    return drawn


def rms(values: np.ndarray) -> float:
    """Root mean square, NaN left out."""
    return float(np.sqrt(np.nanmean(values**2)))


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}" if value >= 10 else f"{value:.2g}"


def _norm(values: np.ndarray) -> Normalize:
    reach = float(np.nanpercentile(np.abs(values), 99.5)) or 1.0
    return Normalize(-reach, reach)


def _marker_points(axis, data: PointMaps, span: np.ndarray) -> float:
    """Area of a square marker as wide as the distance of neighbours, in points squared."""
    box = axis.get_position()
    inches = np.array([box.width, box.height]) * axis.figure.get_size_inches()
    return float((MARKER * 72.0 * data.pitch_mm * (inches / span).min()) ** 2)
