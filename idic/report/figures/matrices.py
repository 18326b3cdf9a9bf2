"""The correlation matrix M, its eigenvalues D and eigenvectors Q (as Fig. 9 of the paper), and the correlations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from idic.model import is_mode
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import DIVERGING, SEQUENTIAL, look, new_figure, to_picture
from idic.report.result.record import RunRecord
from idic.report.result.words import hardly_determined, short_names

MAX_ROWS_WITH_NUMBERS = 12  # rows up to which numbers fit into the cells
MIN_STRONG_CORRELATION = 0.9
MAX_ROUNDING_EIGENVALUE = 1e-12  # of the largest eigenvalue: nothing is known along the direction


def spectrum(record: RunRecord) -> Picture | None:
    """M (magnitude, logarithmic), D with the standard deviation along each direction, Q (Eq. 21 of the paper)."""
    if record.M is None or not len(record.names):
        return None
    M = np.asarray(record.M, dtype=float)
    values, vectors = np.linalg.eigh(M)
    values, vectors = values[::-1], vectors[:, ::-1]
    names = [short_names(record.result["parameters"]).get(n, n) for n in record.names]
    n = len(names)
    with look():
        size = min(0.42 * n + 1.9, 6.0)
        figure = new_figure(10.0, max(2.9, 0.75 * size))
        M_axis, D_axis, Q_axis = figure.subplots(1, 3, width_ratios=(1.15, 0.9, 1.0))
        with np.errstate(divide="ignore"):
            magnitude = np.log10(np.abs(M))
        finite = magnitude[np.isfinite(magnitude)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
        drawn = M_axis.imshow(magnitude, cmap=SEQUENTIAL, vmin=max(low, high - 8.0), vmax=max(high, low + 1e-9))
        figure.colorbar(drawn, ax=M_axis, label="log$_{10}$ |M|", shrink=0.8, aspect=15)
        _numbers(M_axis, magnitude, "{:.1f}", dark_above=None)
        _names(M_axis, names, names)
        M_axis.set_title("M")
        _eigenvalues(D_axis, values)
        largest = Q_axis.imshow(_signed(vectors), cmap=DIVERGING, vmin=-1.0, vmax=1.0)
        figure.colorbar(largest, ax=Q_axis, label="component [–]", shrink=0.8, aspect=15)
        _numbers(Q_axis, _signed(vectors), "{:z.2f}", dark_above=0.6)
        _names(Q_axis, [str(i + 1) for i in range(n)], names)
        Q_axis.set(title="Q", xlabel="eigenvector")
        caption = (
            "M counts information per unit change of ln(value) (positive parameters) or of value/scale. "
            "1/√D is the standard deviation along an eigenvector: 0.01 stands for 1 %. The last columns of Q are the "
            "combinations that this test determines worst."
        )
        return to_picture(figure, "spectrum", "Correlation matrix M, eigenvalues D, eigenvectors Q", caption)


def correlation(record: RunRecord) -> Picture | None:
    """Correlation coefficients between the identified parameters."""
    table = record.result.get("correlation", {})
    positions = [i for i, name in enumerate(table.get("names", ())) if not is_mode(name)]
    names = [table["names"][i] for i in positions]
    if len(names) < 2:
        return None
    matrix = np.array(table["matrix"], dtype=float)[np.ix_(positions, positions)]
    short = short_names(record.result["parameters"])
    labels = [short.get(n, n) for n in names]
    with look():
        size = min(0.5 * len(names) + 2.0, 8.0)
        figure = new_figure(size + 1.2, size)
        axis = figure.subplots()
        drawn = axis.imshow(matrix, cmap=DIVERGING, vmin=-1.0, vmax=1.0)
        _numbers(axis, matrix, "{:z.2f}", dark_above=0.6)
        _names(axis, labels, labels)
        figure.colorbar(drawn, ax=axis, label="correlation [–]", shrink=0.8, aspect=18)
        off = np.triu(np.abs(matrix), 1)  # of a pair the two entries may differ in the last bit
        i, j = np.unravel_index(np.nanargmax(off), off.shape)
        caption = f"Largest: {labels[i]} with {labels[j]}, {matrix[i, j]:z.2f}. "
        open_ = any(not is_mode(entry["name"]) for entry in record.result.get("not_identifiable", ()))
        if off[i, j] > MIN_STRONG_CORRELATION:
            caption += "An error in one largely compensates an error in the other."
        else:
            loose_names = [short.get(name, name) for name in hardly_determined(record.result)]
            caption += f"The test separates {'these' if open_ or loose_names else 'all'} parameters."
            caption += f" The interval of {', '.join(loose_names)} reaches zero all the same." if loose_names else ""
        if open_:
            caption += " Those that it does not determine are not shown."
        return to_picture(figure, "correlation", "Correlation of the identified values", caption)


def _eigenvalues(axis: Axes, values: np.ndarray) -> None:
    """Needles on a logarithmic axis; values that are zero to rounding are marked and do not stretch the axis."""
    index = np.arange(1, len(values) + 1)
    positive = values > MAX_ROUNDING_EIGENVALUE * max(values.max(initial=0.0), 1e-300)
    bottom = values[positive].min() / 10.0 if positive.any() else 0.1
    axis.set_yscale("log")
    axis.vlines(index[positive], bottom, values[positive], color=Colour.BLUE, lw=2.0)
    axis.plot(index[positive], values[positive], "o", color=Colour.BLUE, ms=6)
    for i in index[~positive]:
        axis.annotate("0", (i, bottom), (0, 4), textcoords="offset points", color=Colour.RED, ha="center",
                      weight="bold")
    axis.set(title="D", xlabel="eigenvector", ylabel="eigenvalue [–]", xticks=index, xlim=(0.4, len(values) + 0.6))
    axis.set_ylim(bottom=bottom)
    second = axis.secondary_yaxis("right", functions=(_to_std, _from_std))
    second.set_ylabel("std along it, 1/√D [–]")
    second.tick_params(colors=Colour.GREY)


def _to_std(values):
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 / np.sqrt(np.maximum(values, 1e-300))


def _from_std(stds):
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return 1.0 / np.maximum(stds, 1e-150) ** 2


def _signed(vectors: np.ndarray) -> np.ndarray:
    """Eigenvectors with their largest component positive: a sign that does not change from run to run."""
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None, :], axis=0)
    return vectors * np.sign(largest)


def _names(axis: Axes, columns: list[str], rows: list[str]) -> None:
    axis.set_xticks(
        range(len(columns)),
        columns,
        rotation=0 if max(map(len, columns)) < 3 else 40,
        ha="center" if max(map(len, columns)) < 3 else "right",
        rotation_mode="anchor" if max(map(len, columns)) >= 3 else None,
    )
    axis.set_yticks(range(len(rows)), rows)
    axis.grid(False)
    axis.tick_params(length=0)
    for spine in axis.spines.values():
        spine.set_visible(False)


def _numbers(axis: Axes, matrix: np.ndarray, form: str, dark_above: float | None) -> None:
    """Values in the cells, in white on dark cells (sequential map: dark where small; diverging: dark where large)."""
    if len(matrix) > MAX_ROWS_WITH_NUMBERS:
        return
    finite = matrix[np.isfinite(matrix)]
    middle = finite.mean() if len(finite) else 0.0
    for (i, j), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            dark = value < middle if dark_above is None else abs(value) > dark_above
            axis.text(
                j, i, form.format(value), ha="center", va="center", fontsize=7, color="white" if dark else "#222222"
            )
