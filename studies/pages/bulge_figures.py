"""Figures of the bulge study: maps over place and time, residual maps, model error."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize

from idic.report import DIVERGING, Picture, SEQUENTIAL, look, new_figure, to_picture
from idic_studies.pages.case_record import CaseRecord

STRIP_UM = 50.0  # half width of the strip
PAPER_SCALES = {"elastomer.C10": 84.36, "strip.E": 0.34, "strip.yield_stress": 1.42, "strip.K": 0.80, "strip.n": 1.69}
SYMBOLS = {"elastomer.C10": "$C_{10}$", "strip.E": "$E$", "strip.yield_stress": "$\\sigma_y$", "strip.K": "$K$",
           "strip.n": "$n$", "strip.K0": "$K_0$"}
PLAIN = {"elastomer.C10": "C10", "strip.E": "E", "strip.yield_stress": "σy", "strip.K": "K", "strip.n": "n",
         "strip.K0": "K0"}


def displacements(record: CaseRecord) -> Picture:
    """u_x and u_z over place and time."""
    x, u = _both_halves(record.arrays["x"], record.arrays["u_true"])
    with look():
        figure = new_figure(10.0, 3.6)
        for axis, field, label, colours in zip(figure.subplots(1, 2, sharey=True), np.moveaxis(1e3 * u, 2, 0),
                                               ("$u_x$ [µm]", "$u_z$ [µm]"), (DIVERGING, SEQUENTIAL), strict=True):
            limit = np.abs(field).max()
            norm = Normalize(-limit, limit) if colours == DIVERGING else Normalize(0.0, limit)
            _map(figure, axis, x, record.arrays["times"], field, norm, colours, label)
            axis.set_xlabel("x [µm]")
        figure.axes[0].set_ylabel("time [s]")
        peak = 1e3 * np.abs(u).max(axis=(0, 1))
        return to_picture(figure, "fig13_displacements", "Displacement of the reference simulation (paper: fig. 13)",
                      f"Along the section (left) and upwards (right); dotted: edges of the strip. Largest here: u_x "
                      f"{peak[0]:.2f} µm, u_z {peak[1]:.1f} µm; the paper's colour bars end at 2 µm and 90 µm.")


def scaling_constants(record: CaseRecord) -> dict[str, float]:
    """Largest |lambda du/dlambda| of each parameter in the field of view, px."""
    phi = record.arrays["phi"] / record.facts["pixel_mm"]
    return dict(zip(record.names, np.abs(phi).max(axis=(0, 1, 2)).tolist(), strict=True))


def sensitivities(record: CaseRecord) -> Picture:
    """lambda du/dlambda over place and time, both components of a parameter over the same constant."""
    scales = scaling_constants(record)
    with look():
        figure = new_figure(10.4, 4.6)
        axes = figure.subplots(2, len(scales), sharex=True, sharey=True)
        for column, (name, scale) in enumerate(scales.items()):
            x, phi = _both_halves(record.arrays["x"], record.arrays["phi"][..., column])
            for row in range(2):
                field = phi[..., row] / record.facts["pixel_mm"] / scale
                image = _map(None, axes[row, column], x, record.arrays["times"], field, Normalize(-1, 1), DIVERGING, "")
            axes[0, column].set_title(f"{SYMBOLS[name]}  ({scale:.2f} px;\npaper {PAPER_SCALES[name]:.2f})")
            axes[1, column].set_xlabel("x [µm]")
        for row, label in enumerate(("$u_x$", "$u_z$")):
            axes[row, 0].set_ylabel(f"time [s]   of {label}")
        figure.colorbar(image, ax=axes, label="λ ∂u/∂λ / its largest [–]", shrink=0.8)
        return to_picture(figure, "fig14_sensitivities", "Scaled sensitivity fields (paper: fig. 14)",
                      "λ ∂u/∂λ at the true parameters, both components of a parameter divided by the same constant "
                      "(above each column, in px, with that of the paper).")


def residual_maps(record: CaseRecord) -> Picture:
    """Residual of three frames at the start and at the end."""
    start, end = record.arrays["residual_start"], 1e3 * record.arrays["residual_end"]
    times = record.arrays["times"][record.arrays["residual_frames"]]
    half = 0.5e3 * record.facts["pixel_mm"] * np.array(start.shape[:0:-1])
    extent = (-half[0], half[0], half[1], -half[1])
    with look():
        figure = new_figure(10.0, 5.0)
        axes = figure.subplots(2, len(times), sharex=True, sharey=True)
        for row, (maps, unit) in enumerate(((start, "µm"), (end, "nm"))):
            limit = float(np.nanmax(np.abs(maps))) if row == 0 else float(np.nanpercentile(np.abs(maps), 99.5))
            for axis, image, time in zip(axes[row], maps, times, strict=True):
                artist = axis.imshow(image, extent=extent, cmap=DIVERGING, norm=Normalize(-limit, limit),
                                    interpolation="nearest", aspect="equal")
                rms = float(np.sqrt(np.nanmean(np.square(image))))
                axis.set_title(f"t = {time:.2g} s, rms {rms:.2g} {unit}")
                axis.grid(False)
            figure.colorbar(artist, ax=axes[row], label=f"r, {('start', 'end')[row]} [{unit}]", shrink=0.85)
        for axis in axes[1]:
            axis.set_xlabel("x [µm]")
        for axis in axes[:, 0]:
            axis.set_ylabel("y [µm]")
        return to_picture(figure, "fig15_residuals", "Residual at the start and at the end (paper: fig. 15a, c)",
                      "f + u_z − g(x + u): start at 130 % of all parameters (above, µm), identified (below, nm). "
                      "Colour bars of the paper: 7 … 12 µm before, ±10 nm after.")


def displacement_errors(record: CaseRecord) -> Picture:
    """Identified less true displacement over place and time, nm."""
    x, u = _both_halves(record.arrays["x"], 1e6 * record.arrays["u_error"])
    with look():
        figure = new_figure(10.0, 3.6)
        for axis, field, label in zip(figure.subplots(1, 2, sharey=True), np.moveaxis(u, 2, 0),
                                      ("error of $u_x$ [nm]", "error of $u_z$ [nm]"), strict=True):
            limit = np.abs(field).max() or 1.0
            _map(figure, axis, x, record.arrays["times"], field, Normalize(-limit, limit), DIVERGING, label)
            axis.set_xlabel("x [µm]")
        figure.axes[0].set_ylabel("time [s]")
        worst, rms = np.abs(u).max(axis=(0, 1)), np.sqrt(np.mean(u**2))
        return to_picture(figure, "fig16_displacement_errors", "Error of the displacement (paper: fig. 16)",
                      f"Identified less true, no noise. Largest here: u_x {worst[0]:.2g} nm, u_z {worst[1]:.2g} nm, "
                      f"rms {rms:.2g} nm; paper: 0.1 nm and 0.4 nm.")


def model_error(records: list[CaseRecord], windows: np.ndarray) -> Picture:
    """E and C10 of the elastic strip over the part of the test that was used."""
    e, c10 = (np.array([r.relative_error[r.names.index(name)] for r in records])
              for name in ("strip.E", "elastomer.C10"))
    with look():
        figure = new_figure(8.4, 3.0)
        E_axis, C10_axis = figure.subplots(1, 2)
        E_axis.plot(windows, 1.0 + e, "-s", color="#E69F00")
        E_axis.set(xlabel="frames used (of 200)", ylabel="identified E / true E [–]", ylim=(0.0, 1.1))
        C10_axis.plot(windows, 100.0 * c10, "-o", color="#0072B2")
        C10_axis.set(xlabel="frames used (of 200)", ylabel="error of C10 [%]", ylim=(-0.2, 0.2))
        for axis in (E_axis, C10_axis):
            axis.set_xticks(windows)
            axis.tick_params(axis="x", labelsize=7.0)
        return to_picture(figure, "table2_model_error", "Moduli of an elastic strip (paper: table II, fig. 18c, d)",
                      "Paper: E is right up to frame 75 and too small afterwards; C10 hardly changes.")


def _map(figure, axis, x, times, field, norm, colours, label):
    image = axis.pcolormesh(1e3 * x, times, field, norm=norm, cmap=colours, shading="gouraud", rasterized=True)
    axis.grid(False)
    for edge in (-STRIP_UM, STRIP_UM):
        axis.axvline(edge, color="black", lw=0.7, ls=":")
    axis.set(xlim=(1e3 * x[0], 1e3 * x[-1]), ylim=(times[0], times[-1]))
    if figure is not None:
        figure.colorbar(image, ax=axis, label=label)
    return image


def _both_halves(x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The section with its mirror image  # x (n, 2), u (n_frames, n, 2) -> (m,), (n_frames, m, 2)

    At the edge of the strip the surface has two nodes at the same x: both stay.
    """
    place = x[:, 0]
    mirrored = np.concatenate([-place[:0:-1], place])
    field = np.concatenate([u[:, :0:-1] * np.array([-1.0, 1.0]), u], axis=1)
    return mirrored, field
