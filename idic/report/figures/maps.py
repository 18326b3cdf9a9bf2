"""Maps on the specimen: residuals before and after, displacements, sensitivities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import LinearTriInterpolator, Triangulation

from idic.report.figures import profiles
from idic.report.figures.picture import Picture
from idic.report.figures.style import DIVERGING, SEQUENTIAL, look, new_figure, show_pixels, to_picture
from idic.report.result.record import RunRecord
from idic.report.result.words import short_names

PAGE_WIDTH_INCH = 10.0  # inch: the page's width
MAX_ROW_HEIGHT_INCH = 3.4  # inch per row: a tall specimen must not fill the screen
LETTER_WIDTH_INCH = 0.072  # inch, mean width of a letter of a title
N_RASTER_SAMPLES = 420  # samples along the longer side of a field that is laid over the image
RESIDUAL_RANGE = 4.0  # times the noise level
MIN_CHI2_WINDOWS = 16  # windows of the local chi² across the shorter side of the specimen
OTHER_THAN_CURVE = 0.03  # relative difference of the rms of a map of the starting values from their curve: is explained
MAX_SHARED_POWER = 3.0  # of the smaller maximum: beyond it one scale for both rows would hide the lower one
BAR_SHARE = 0.8  # height of a colour bar over that of its maps
MARGINS_INCH = 0.4  # inch, of a figure of maps, without room for bars below
TICK_INCH = 0.17  # inch, a number of a colour bar and the space above it
FACES_APART = 1e-3  # of the way to the middle of their triangles: how far the faces of a crack are drawn apart
MIN_SHOWN_MOTION = 1e-9  # of a sensitivity field, in px or std of a point: below, rounding
MIN_CHI2_REACH = 2.0  # the colour scale reaches at least to this factor above (and below) noise
TRIANGLES = {
    "tri3": ((0, 1, 2),),
    "quad4": ((0, 1, 2), (0, 2, 3)),
    "tri6": ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    "quad8": ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 7), (5, 6, 7)),
}


def residuals(record: RunRecord) -> Picture | None:
    """Residual maps of some frames over the noise: starting values above, identified values below."""
    data = record.residuals
    if data is None or not len(data.frames):
        return None
    units = noise_units(record)
    limit = float(np.nanpercentile(np.abs(data.start), 99)) if units is None else RESIDUAL_RANGE
    name = record.value_unit if units is None else "σ"
    scale = np.ones(len(data.frames)) if units is None else units
    stacks = [stack / scale[:, None, None].astype(stack.dtype) for stack in (data.start, data.identified)]
    label = f"residual [{record.value_unit}]" if units is None else "residual / σ [–]"
    caption = (
        f"{'f − g(x + u)' if record.value_unit == 'grey values' else 'f + h − g(x + u)'} in the reference image; "
        "σ is the residual of image noise alone: a map with rms 1 σ holds noise only. "
        "A structure in the lower row is what the model does not explain." + _start_note(record)
    )
    return _before_and_after(
        record, stacks, [Normalize(-limit, limit)], label, lambda m: f"rms {np.sqrt(np.nanmean(m**2)):.2f} {name}",
        ("residual_maps", "Residual maps", caption),
    )  # fmt: skip


def local_chi2(record: RunRecord) -> Picture | None:
    """Mean of (r / σ)² over small windows: where the residual exceeds the noise."""
    data, units = record.residuals, noise_units(record)
    if data is None or not len(data.frames) or units is None:
        return None
    window = residual_window(data.identified)
    size = 2 * (int(min(window[1] - window[0], window[3] - window[2]) / MIN_CHI2_WINDOWS) // 2) + 1
    size = max(size, 9)
    stacks = [_window_mean(((part / unit) ** 2 for part, unit in zip(stack, units, strict=True)), size)
              .astype(np.float32) for stack in (data.start, data.identified)]
    caption = (
        f"Residual² / noise², averaged over {size} × {size} px. 1 (white) is noise; red is motion or brightness "
        "(height) that the simulation lacks. "
    )
    reaches = [max(float(np.nanmax(stack)) if np.isfinite(stack).any() else 1.0, MIN_CHI2_REACH) for stack in stacks]
    if max(reaches) <= min(reaches) ** MAX_SHARED_POWER:
        reaches, scale = [max(reaches)], "The logarithmic scale ends at the maximum of both rows."
    else:
        scale = "Each row has its own logarithmic scale, which ends at its maximum."
    caption += scale + _start_note(record)
    return _before_and_after(
        record, stacks, [LogNorm(1.0 / reach, reach) for reach in reaches], "local χ² [–]",
        lambda m: f"max {_ratio(np.nanmax(m))}",
        ("local_chi2", "Local residual", caption),
    )  # fmt: skip


def _start_note(record: RunRecord) -> str:
    """A note if the maps of the start values have another rms than their curve."""
    data, curve = record.residuals, record.rms_before
    if curve is None:
        return ""
    map_rms = np.array([np.sqrt(np.nanmean(values.astype(float) ** 2)) for values in data.start])
    at = curve[list(data.frames)]
    if not (np.abs(map_rms - at) > OTHER_THAN_CURVE * at).any():
        return ""
    return (" Upper row: edges as logged or as measured by a free FE-DIC; for the curve of the start values the edges "
            "are fitted to images and channels.")


def _before_and_after(record: RunRecord, stacks, norms: Sequence[Normalize], label: str, describe, text) -> Picture:
    """Two rows of maps, starting values above and identified values below; `describe` gives the number of a map.

    norms : one for both rows, or one each
    """
    data = record.residuals
    window = residual_window(data.identified)
    with look():
        figure, axes = grid(2, len(data.frames), window)
        for column, frame in enumerate(data.frames):
            for row, stack in enumerate(stacks):
                axis = axes[row, column]
                show_pixels(axis, stack[column], window, cmap=DIVERGING, norm=norms[min(row, len(norms) - 1)],
                            interpolation="nearest")
                bare(axis, window)
                entitle(axis, *((f"frame {frame},  ",) if row == 0 else ()), describe(stack[column]))
        for row, name in enumerate(("start", "identified")):
            axes[row, 0].set_ylabel(name)
        for row, norm in enumerate(norms):
            row_axes = axes if len(norms) == 1 else axes[row, :]
            bar = figure.colorbar(axes[row, 0].images[0], ax=row_axes, label=label, shrink=BAR_SHARE,
                                  aspect=30 if len(norms) == 1 else 15,
                                  pad=0.01, extend="neither" if isinstance(norm, LogNorm) else "both")
            if isinstance(norm, LogNorm):
                _ratio_ticks(bar, norm, BAR_SHARE * (figure.get_figheight() - MARGINS_INCH) / len(norms))
        return to_picture(figure, *text, as_photo=True)  # type: ignore[misc]


def _ratio_ticks(bar, norm: Normalize, height_inch: float) -> None:
    """Ticks at 1, at the largest value, and at powers, as many as there is room for: 8, or 1/8.

    The lower end mirrors the upper one and is no value of the map: it has no label.
    """
    reach = float(norm.vmax)
    base = 2.0 if reach <= 20.0 else 10.0
    steps = base ** np.arange(1, int(np.log(reach) / np.log(base)) + 1)
    steps = steps[np.log(steps) < 0.7 * np.log(reach)]  # room for the label of the end
    n = max(int(height_inch / TICK_INCH) - 3, 0) // 2  # beside 1 and the ends
    if n < len(steps):
        steps = steps[np.unique(np.linspace(0, len(steps) - 1, n + 2).round().astype(int)[1:-1])]
    bar.set_ticks([*(1.0 / t for t in reversed(steps)), 1.0, *steps, reach],
                  labels=[*(f"1/{_ratio(t)}" for t in reversed(steps)), "1", *(_ratio(t) for t in (*steps, reach))])
    bar.minorticks_off()


def _ratio(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def noise_units(record: RunRecord) -> np.ndarray | None:
    """Residual of noise alone in each shown frame  # (n_selected,) grey values"""
    levels, data = record.noise_level, record.residuals
    if levels is None or data is None:
        return None
    noise = levels[list(data.frames)]
    return np.where(np.isfinite(noise), noise, np.nanmedian(levels))


def residual_window(stack: np.ndarray) -> tuple[float, float, float, float]:
    """Columns from, to, rows from, to, of the compared pixels."""
    rows, columns = np.nonzero(np.isfinite(stack).any(axis=0))
    if not len(rows):
        return -0.5, stack.shape[2] - 0.5, -0.5, stack.shape[1] - 0.5
    return columns.min() - 1.5, columns.max() + 1.5, rows.min() - 1.5, rows.max() + 1.5


def _window_mean(stack: Iterable[np.ndarray], size: int) -> np.ndarray:
    """Mean over size x size windows of the finite values; NaN stays NaN, and so does a window with less than half of
    them. One map at a time: it takes some arrays of its size  # maps (ny, nx) -> (n, ny, nx)"""
    def mean(values: np.ndarray) -> np.ndarray:
        is_finite = np.isfinite(values)
        total, count = (_window_sum(np.where(is_finite, part, 0.0), size) for part in (values, 1.0))
        well_filled = is_finite & (count >= 0.5 * size**2)
        return np.where(well_filled, total / np.maximum(count, 1.0), np.nan)

    return np.stack([mean(values) for values in stack])


def _window_sum(values: np.ndarray, size: int) -> np.ndarray:
    """Sum over size x size windows (odd), zero beyond the image, through running sums  # (ny, nx)"""
    half = size // 2
    sums = np.pad(values.astype(float), half + 1)[:-1, :-1].cumsum(axis=0).cumsum(axis=1)
    return sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]


def displacements(record: RunRecord) -> Picture | None:
    """Column and row displacement of some frames over the reference image."""
    if profiles.is_profile(record):
        return profiles.displacements(record)
    if record.fields is None or record.nodes_px is None:
        return None
    data, (scale, unit) = record.fields, record.motion_unit
    with look():
        figure, axes = grid(2, len(data.frames), specimen_window(record))
        for row, name in enumerate((f"u, columns [{unit}]", f"v, rows (down) [{unit}]")):
            values = scale * data.u_px[:, used_nodes(record), row]
            norm = _norm(values, diverging=values.min() * values.max() < 0)
            for column, frame in enumerate(data.frames):
                drawn = draw(axes[row, column], record, scale * data.u_px[column, :, row], norm)
                axes[row, column].set_title(f"frame {frame}" if row == 0 else "", fontsize=8.5)
            figure.colorbar(drawn, ax=axes[row, :], label=name, shrink=0.85, aspect=15, pad=0.01)
        return to_picture(
            figure, "displacements", "Displacement",
            "Simulated with the identified values, shown on the undeformed specimen.", as_photo=True,
        )


def nodal_field(record: RunRecord, name: str) -> Picture | None:
    """One further nodal field (say the equivalent plastic strain) of some frames over the reference image."""
    if record.fields is None or name not in record.fields.extra or profiles.is_profile(record):
        return None
    values = np.asarray(record.fields.extra[name])
    with look():
        figure, axes = grid(1, len(record.fields.frames), specimen_window(record))
        norm = _norm(values[:, used_nodes(record)], diverging=False)
        for column, frame in enumerate(record.fields.frames):
            drawn = draw(axes[0, column], record, values[column], norm)
            axes[0, column].set_title(f"frame {frame}", fontsize=8.5)
        figure.colorbar(drawn, ax=axes, label=name, shrink=0.85, aspect=15, pad=0.01)
        file = "field_" + "".join(c if c.isalnum() else "_" for c in name.split("[", maxsplit=1)[0].strip())
        return to_picture(figure, file, name.split("[", maxsplit=1)[0].strip().capitalize(),
                      "Shown on the undeformed specimen.",
                      as_photo=True)


def sensitivities(record: RunRecord) -> Picture | None:
    """Sensitivity field of every free parameter: its components, each parameter on its own scale."""
    if profiles.is_profile(record):
        return profiles.sensitivities(record)
    data = record.sensitivities
    if data is None or not len(data.names) or record.nodes_px is None:
        return None
    short, (scale, name_of_unit) = short_names(record.result["parameters"]), record.motion_unit
    with look():
        third = "slices" if record.result.get("quantity") == "volume" else "height"
        components = ("columns", "rows (down)", third)[:data.phi_px.shape[2]]
        column_from, column_to, row_from, row_to = window = specimen_window(record)
        tall = abs(row_to - row_from) > abs(column_to - column_from)  # no room for many numbers side by side
        figure, axes = grid(len(components), len(data.names), window, bottom=0.75)
        for column, (name, step) in enumerate(zip(data.names, data.steps, strict=True)):
            phi = scale * data.phi_px[column]
            largest = float(np.abs(phi[used_nodes(record)]).max())
            if largest < MIN_SHOWN_MOTION:
                phi, largest = np.zeros_like(phi), 0.0
            unit, text = _power(largest)
            norm = Normalize(-largest / unit or -1.0, largest / unit or 1.0)
            for row in range(len(components)):
                drawn = draw(axes[row, column], record, phi[:, row] / unit, norm, DIVERGING)
            parts = short.get(name, name).split(".")
            entitle(axes[0, column], *(f"{part}." for part in parts[:-1]), parts[-1], below=f"per {step}")
            figure.colorbar(drawn, ax=axes[:, column], location="bottom", shrink=0.9, aspect=18, pad=0.02,
                            label=f"{text}{name_of_unit}" if largest else "no motion",
                            ticks=MaxNLocator(2 if tall else 4, symmetric=True) if largest else [0.0])
        for row, text in enumerate(components):
            axes[row, 0].set_ylabel(text)
        rises = "" if len(components) == 2 or third == "slices" else "and rises (over the size of a pixel) "
        small = "0.01 px (about what one pixel shows) are determined by many pixels" if name_of_unit == "px" else (
            "the noise of one point are determined by many points")
        caption = (
            f"Motion of the pattern {rises}in frame {data.frame} when one parameter changes by the step stated above "
            f"its map. Values below {small} and frames together. The test does not separate two parameters whose maps "
            "have the same shape in all frames."
        )
        return to_picture(figure, "sensitivities", f"Sensitivity fields, frame {data.frame}", caption, as_photo=True)


def used_nodes(record: RunRecord) -> np.ndarray:
    """Indices of the nodes that belong to a visible cell."""
    return np.unique(np.concatenate([np.ravel(conn) for _, conn in record.cells]))


def triangulate(record: RunRecord) -> Triangulation:
    """The visible cells cut into triangles (for drawing only)."""
    parts = [np.asarray(conn)[:, list(local)] for cell, conn in record.cells for local in TRIANGLES[cell]]
    triangles = np.concatenate(parts)
    return Triangulation(*_apart(record.nodes_px, triangles).T, triangles)


def _apart(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The points (n, 2), those of the triangles that lie on each other (faces of a crack) moved into their own ones."""
    used = np.unique(triangles)
    _, place, counts = np.unique(np.round(points[used], 6), axis=0, return_inverse=True, return_counts=True)
    double = used[counts[place.ravel()] > 1]
    if not len(double):
        return points
    middles, drawn = points[triangles].mean(axis=1), points.copy()
    for node in double:
        drawn[node] += FACES_APART * (middles[(triangles == node).any(axis=1)].mean(axis=0) - points[node])
    return drawn


def draw(axis: Axes, record: RunRecord, values, norm, cmap: str | None = None):
    """A nodal field over the reference image, sampled on a raster so that no seams of triangles show through."""
    window = specimen_window(record)
    if record.reference is not None:
        grey = record.value_unit == "grey values"
        show_pixels(axis, record.reference, window, cmap="gray", interpolation="bilinear",
                    vmin=0.0 if grey else np.nanmin(record.reference), vmax=np.nanmax(record.reference))
    column_from, column_to, row_from, row_to = window
    step = max(column_to - column_from, row_to - row_from) / N_RASTER_SAMPLES
    columns, rows = np.meshgrid(np.arange(column_from, column_to, step), np.arange(row_from, row_to, step))
    field = LinearTriInterpolator(triangulate(record), values)(columns, rows)
    cmap = cmap or (DIVERGING if norm.vmin < 0 < norm.vmax else SEQUENTIAL)
    drawn = axis.imshow(
        field,
        cmap=cmap,
        norm=norm,
        alpha=0.8,
        interpolation="nearest",
        extent=(column_from - step / 2, columns[0, -1] + step / 2, rows[-1, 0] + step / 2, row_from - step / 2),
    )
    bare(axis, window)
    return drawn


def specimen_window(record: RunRecord) -> tuple[float, float, float, float]:
    """Columns from, to, rows from, to: the specimen with a margin, inside the image."""
    points = record.nodes_px[used_nodes(record)]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.04 * (high - low).max()
    low, high = low - margin, high + margin
    if record.reference is not None:
        limit = np.array(record.reference.shape[::-1]) - 0.5
        low, high = np.clip(low, -0.5, limit), np.clip(high, -0.5, limit)
    return low[0], high[0], low[1], high[1]


def grid(rows: int, columns: int, window, bottom: float = 0.0):
    """Axes of the specimen's proportions, with room (inch) for colour bars below  # (rows, columns)"""
    aspect = (window[3] - window[2]) / max(window[1] - window[0], 1e-9)
    label_width = 0.35 if bottom else 1.3
    width = min((PAGE_WIDTH_INCH - label_width) / columns, MAX_ROW_HEIGHT_INCH / max(aspect, 1e-9), 4.2)
    figure = new_figure(min(PAGE_WIDTH_INCH, columns * width + label_width),
                        rows * ((width - 0.1) * aspect + 0.12) + MARGINS_INCH + bottom)
    return figure, np.asarray(figure.subplots(rows, columns, squeeze=False))


def entitle(axis: Axes, *parts: str, below: str = "") -> None:
    """A title of one line, or of a line for each part where the map of a narrow specimen has no room for more.

    below : a further line in any case
    """
    columns = axis.get_subplotspec().get_gridspec().ncols
    room = axis.figure.get_size_inches()[0] / (columns + 0.5) / LETTER_WIDTH_INCH  # letters
    title = "".join(parts)
    lines = [title] if len(title) <= room else [part.rstrip(", ") for part in parts]
    axis.set_title("\n".join([*lines, below] if below else lines), fontsize=8.5)


def bare(axis: Axes, window) -> None:
    axis.set(xlim=window[:2], ylim=(window[3], window[2]), aspect="equal", xticks=[], yticks=[])
    axis.grid(False)
    for spine in axis.spines.values():
        spine.set_visible(False)


def _norm(values, diverging: bool) -> Normalize:
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if diverging:
        high = max(-low, high)
        low = -high
    return Normalize(low, high if high > low else low + 1e-12)


def _power(largest: float) -> tuple[float, str]:
    """A power of ten that makes the numbers of a colour bar readable, and its text."""
    if largest <= 0 or 0.1 <= largest < 1000:
        return 1.0, ""
    exponent = int(np.floor(np.log10(largest)))
    return 10.0**exponent, f"10$^{{{exponent}}}$ "
