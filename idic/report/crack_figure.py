"""Length, stress intensity factors and J of a crack over the frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.report.figures.hardening import WIDTH_95
from idic.report.figures.picture import CYCLE, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import RunRecord

MODES = {"K_I": r"$K_\mathrm{I}$", "K_II": r"$K_\mathrm{II}$"}


def crack_figure(record: RunRecord, name: str) -> Picture:
    """Length, K_I with K_II, and J with 95 % bars, one above the other."""
    entry = record.result["cracks"][name]
    x = np.asarray(record.abscissa, dtype=float)[entry["frames"]]
    panels = [("length [mm]", ("length_mm",)), ("K [MPa √m]", ("K_I", "K_II")), ("J [N/mm]", ("J",))]
    panels = panels[:1] if entry["why_not"] else panels
    with look():
        figure = new_figure(7.2, 1.6 + 1.5 * len(panels))
        axes = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
        for axis, (label, quantities) in zip(axes, panels, strict=True):
            for color, quantity in zip(CYCLE, quantities, strict=False):
                half = WIDTH_95 * _numbers(entry, f"{quantity}_std")
                axis.errorbar(x, _numbers(entry, quantity), yerr=half, fmt="o-", ms=3.5, lw=1.0, color=color,
                              label=MODES.get(quantity))
            axis.set_ylabel(label)
        if len(panels) > 1:
            axes[1].legend()
        axes[-1].set_xlabel(record.time_label)
        figure.align_ylabels(list(axes))
        return to_picture(figure, f"crack_{name}", f"Crack {name}", _caption(entry))


def _numbers(entry: Mapping, name: str) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in entry[name]])


def _caption(entry: Mapping) -> str:
    if entry["why_not"]:
        return f"Length along its path; bars: 95 %, from the covariance of the parameters. {entry['why_not']}."
    K, modes, J = (_numbers(entry, name) for name in ("K_I", "K_II", "J"))
    k = int(np.flatnonzero(np.isfinite(J))[-1])
    shares = f"K_I = {K[k]:.4g} and K_II = {modes[k]:.4g} MPa √m, " if np.isfinite(K[k]) else ""
    return (f"Length along its path, stress intensity factors and J by interaction and domain integrals; bars: 95 %, "
            f"from the covariance of the parameters. Frame {entry['frames'][k]}: {shares}J = {J[k]:.4g} N/mm.")
