"""Figures of the polycarbonate study: maps over the strip and over time, residual maps, spectrum."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from idic.report import DIVERGING, SEQUENTIAL, Colour, Picture, look, new_figure, to_picture
from idic_studies.pages.case_record import CaseRecord

Y_LINE_MM = 8.0  # mm: the line of the maps over place and time, as published
SYMBOLS = {
    "strip.Gr": "$G_r$",
    "strip.Sa": "$S_a$",
    "strip.r0": "$r_0$",
    "strip.r1": "$r_1$",
    "strip.r2": "$r_2$",
    "strip.tau0": "$\\tau_0$",
    "strip.mu": "$\\mu$",
    "strip.kappa": "$\\kappa$",
    "strip.G1": "$G_1$",
    "strip.eta0": "$\\eta_0$",
}
PLAIN = {
    "strip.Gr": "Gr",
    "strip.Sa": "Sa",
    "strip.r0": "r0",
    "strip.r1": "r1",
    "strip.r2": "r2",
    "strip.tau0": "τ0",
    "strip.mu": "µ",
    "strip.kappa": "κ",
    "strip.G1": "G1",
    "strip.eta0": "η0",
}
SHOWN_TIMES_S = (60.0, 120.0, 200.0)  # s


class Lattice:
    """The visible nodes of the strip as columns along x with nodes along y; fields on them and on the line y = 8 mm.

    nodes : (n_x, n_y) numbers into the stored fields, y ascending; x, y : (n_x, n_y) mm
    """

    def __init__(self, places: np.ndarray):
        columns = [np.flatnonzero(np.isclose(places[:, 0], x)) for x in np.unique(places[:, 0].round(9))]
        longest = max(map(len, columns))
        full_columns = [column[np.argsort(places[column, 1])] for column in columns if len(column) == longest]
        self.nodes = np.array(full_columns)
        self.x, self.y = places[self.nodes, 0], places[self.nodes, 1]

    def on_line(self, field: np.ndarray) -> np.ndarray:
        """A field (n_frames, n, ...) along y = 8 mm, linear between its neighbours  # (n_frames, n_x, ...)"""
        above = np.array([np.searchsorted(y, Y_LINE_MM) for y in self.y])
        rows = np.arange(len(self.y))
        low, high = self.y[rows, above - 1], self.y[rows, above]
        part = ((Y_LINE_MM - low) / (high - low)).reshape((1, -1) + (1,) * (field.ndim - 2))
        return (1.0 - part) * field[:, self.nodes[rows, above - 1]] + part * field[:, self.nodes[rows, above]]


def displacements(record: CaseRecord) -> Picture:
    """u_x and u_y at three times, and along y = 8 mm over time."""
    lattice, times = Lattice(record.arrays["x"]), record.arrays["times"]
    return _maps_and_line(
        record,
        record.arrays["u_true"][..., :2],
        lattice,
        times,
        "mm",
        ("$u_x$", "$u_y$"),
        "fig05_displacements",
        "Displacement of the reference simulation (paper: fig. 5)",
        "Three times and the line y = 8 mm over time: the neck starts at about 50 s and grows along the strip.",
        1.0,
    )


def displacement_errors(record: CaseRecord) -> Picture:
    """Identified less true displacement at three times, and along y = 8 mm over time, µm."""
    lattice, times = Lattice(record.arrays["x"]), record.arrays["times"]
    error = 1e3 * record.arrays["u_error"][..., :2]
    pixel = 1e3 * record.facts["pixel_mm"]
    worst, rms = np.abs(error).max(), np.sqrt(np.mean(error**2))
    caption = (
        f"Identified less true. Largest {worst:.3g} µm = {worst / pixel:.2g} px, rms {rms:.2g} µm; paper: 0.3 µm, "
        "at the onset of necking."
    )
    return _maps_and_line(
        record,
        error,
        lattice,
        times,
        "µm",
        ("error of $u_x$", "error of $u_y$"),
        "fig08_displacement_errors",
        "Error of the displacement (paper: fig. 8)",
        caption,
        None,
    )


def _maps_and_line(record, field, lattice, times, unit, labels, name, title, caption, part) -> Picture:
    frames = [int(np.abs(times - time).argmin()) for time in SHOWN_TIMES_S]
    with look():
        figure = new_figure(10.4, 3.9)
        axes = figure.subplots(2, 4, width_ratios=(1, 1, 1, 1), sharex="row")
        for row, label in enumerate(labels):
            component = field[..., row]
            limit = float(np.abs(component).max()) * (part or 1.0) or 1.0
            norm = Normalize(-limit, limit)
            for axis, frame in zip(axes[row], frames, strict=False):
                axis.pcolormesh(
                    lattice.x,
                    lattice.y,
                    component[frame][lattice.nodes],
                    norm=norm,
                    cmap=DIVERGING,
                    shading="gouraud",
                    rasterized=True,
                )
                axis.set_title(f"t = {times[frame]:.0f} s")
                axis.set_aspect("equal")
                axis.grid(False)
            axes[row, 0].set_ylabel(f"{label}\ny [mm]")
            image = _over_time(axes[row, 3], lattice, times, lattice.on_line(component), norm)
            axes[row, 3].set(title="y = 8 mm", ylabel="time [s]")
            figure.colorbar(image, ax=axes[row], label=f"{label} [{unit}]", aspect=12)
        for axis in axes[1]:
            axis.set_xlabel("x [mm]")
        return to_picture(figure, name, title, caption)


def scaling_constants(record: CaseRecord) -> dict[str, float]:
    """Largest |lambda du/dlambda| of each parameter among the visible nodes, mm."""
    phi = record.arrays["phi"][:, :, :2]
    return dict(zip(record.names, np.abs(phi).max(axis=(0, 1, 2)).tolist(), strict=True))


def sensitivities(record: CaseRecord) -> Picture:
    """lambda du/dlambda along y = 8 mm over time over its largest, and lambda dF/dlambda."""
    lattice, times, scales = Lattice(record.arrays["x"]), record.arrays["times"], scaling_constants(record)
    line = lattice.on_line(record.arrays["phi"])  # (n_frames, n_x, 3, m)
    with look():
        figure = new_figure(13.0, 5.4)
        axes = figure.subplots(3, len(scales), sharex="row", sharey="row", height_ratios=(1, 1, 0.75))
        for column, (name, scale) in enumerate(scales.items()):
            for row in range(2):
                image = _over_time(axes[row, column], lattice, times, line[:, :, row, column] / scale, Normalize(-1, 1))
            rho = record.arrays["rho"][:, 0, column]
            axes[2, column].plot(times, rho / np.abs(rho).max(), color=Colour.BLUE)
            axes[2, column].set(title=f"{np.abs(rho).max():.4g} N", ylim=(-1.1, 1.1))
            axes[2, column].set_xlabel("time [s]")
            axes[0, column].set_title(f"{SYMBOLS[name]}  ({scale:.3g} mm)")
            axes[1, column].set_xlabel("x [mm]")
        for row, label in enumerate(
            ("of $u_x$\ntime [s]", "of $u_y$\ntime [s]", "of the force [–]")
        ):
            axes[row, 0].set_ylabel(label)
        figure.colorbar(image, ax=axes[:2], label="λ ∂u/∂λ / its largest [–]", shrink=0.8, aspect=25)
        return to_picture(
            figure,
            "fig06_sensitivities",
            "Scaled sensitivity fields (paper: fig. 6)",
            "Along y = 8 mm at the true parameters, both components of a parameter over the same constant, which "
            "stands above it; below, the sensitivity of the force over its largest. The paper's smallest constants are "
            "those of r1, then µ and η0.",
        )


def residual_maps(record: CaseRecord) -> Picture:
    """Residual of three frames at the start and at the end."""
    start, end = record.arrays["residual_start"], record.arrays["residual_end"]
    times = record.arrays["times"][record.arrays["residual_frames"]]
    pixel, (_, ny, nx) = record.facts["pixel_mm"], start.shape
    extent = (0.0, pixel * nx, pixel * ny, 0.0)
    with look():
        figure = new_figure(10.0, 4.2)
        axes = figure.subplots(2, len(times), sharex=True, sharey=True)
        for row, maps in enumerate((start, end)):
            limit = float(np.nanpercentile(np.abs(maps), 99.5))
            for axis, image, time in zip(axes[row], maps, times, strict=True):
                artist = axis.imshow(
                    image,
                    extent=extent,
                    cmap=DIVERGING,
                    norm=Normalize(-limit, limit),
                    interpolation="nearest",
                    aspect="equal",
                )
                axis.set_title(f"t = {time:.0f} s, rms {np.sqrt(np.nanmean(np.square(image))):.2g} GV")
                axis.grid(False)
            figure.colorbar(artist, ax=axes[row], label=f"r, {('start', 'end')[row]} [GV]", shrink=0.85)
        for axis in axes[1]:
            axis.set_xlabel("column [mm]")
        for axis in axes[:, 0]:
            axis.set_ylabel("row [mm]")
        return to_picture(
            figure,
            "fig07_residuals",
            "Residual at the start and at the end (paper: fig. 7a, c)",
            f"f − g(x + u): from 110 % of all parameters (above), identified (below); {record.facts['case']['bits']} "
            "bits, no noise: the residual is rounding. White: off the specimen, or outside the image.",
        )


def spectrum(record: CaseRecord) -> Picture:
    """M, its eigenvalues and eigenvectors, of relative changes."""
    M = record.arrays["M"]
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    names = [SYMBOLS.get(name, name) for name in record.names]
    vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(len(values))])
    with look():
        figure = new_figure(10.4, 3.5)
        M_axis, D_axis, Q_axis = figure.subplots(1, 3, width_ratios=(1.1, 0.9, 1.1))
        size = np.abs(M)
        image = M_axis.imshow(
            size, cmap=SEQUENTIAL, norm=LogNorm(max(size[size > 0].min(), 1e-8 * size.max()), size.max())
        )
        figure.colorbar(image, ax=M_axis, label="|M| [–]", shrink=0.85)
        at = np.arange(1, len(values) + 1)
        D_axis.semilogy(at, values, "o", color=Colour.BLUE)
        D_axis.vlines(at, values.min() / 3, values, color=Colour.BLUE)
        D_axis.set(title="D", xlabel="eigenvector", ylabel="eigenvalue [–]", xticks=at, ylim=(values.min() / 3, None))
        image = Q_axis.imshow(vectors, cmap=DIVERGING, norm=Normalize(-1, 1))
        figure.colorbar(image, ax=Q_axis, label="component [–]", shrink=0.85)
        M_axis.set_xticks(np.arange(len(names)), names)
        Q_axis.set_xticks(np.arange(len(names)), [str(k) for k in at])
        for axis, title in ((M_axis, "M"), (Q_axis, "Q")):
            axis.set_yticks(np.arange(len(names)), names)
            axis.set_title(title)
            axis.grid(False)
        Q_axis.set_xlabel("eigenvector")
        return to_picture(
            figure,
            "fig09_spectrum",
            "M, D and Q (paper: fig. 9)",
            "Information per unit of relative change, weakest eigenvector first. " + weakest_words(record),
        )


def weakest_words(record: CaseRecord) -> str:
    """What the three weakest eigenvectors are made of, in words."""
    M = record.arrays["M"]
    _, vectors = np.linalg.eigh(0.5 * (M + M.T))
    named = [PLAIN.get(record.names[k], record.names[k]) for k in np.abs(vectors[:, :3]).argmax(axis=0)]
    return f"The three weakest are mostly {', '.join(dict.fromkeys(named))}; in the paper µ, η0 and r1."


def _over_time(axis, lattice: Lattice, times: np.ndarray, field: np.ndarray, norm: Normalize):
    image = axis.pcolormesh(
        lattice.x[:, 0], times, field, norm=norm, cmap=DIVERGING, shading="gouraud", rasterized=True
    )
    axis.grid(False)
    return image
