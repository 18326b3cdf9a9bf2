"""A free relaxation spectrum: shear modulus over time with its band and the nearest forms, and the weights."""

from __future__ import annotations

from idic.laws import ClassicalFit
from idic.report.figures.hardening import WIDTH_95
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import RelaxationCurve, RunRecord
from idic.report.result.stress_scale import stress_unit

DRAWN = 3  # classical forms


def relaxation_curve(record: RunRecord, curve: RelaxationCurve) -> Picture:
    """Shear modulus after a jump over the logarithm of time; below, the weight of every relaxation time."""
    unit, size = stress_unit(record.result, curve.name)
    with look():
        figure = new_figure(7.2, 5.2)
        top, bottom = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
        half = WIDTH_95 * curve.std / size
        top.fill_between(curve.time, curve.modulus / size - half, curve.modulus / size + half, color=CYCLE[0],
                         alpha=0.3, lw=0)
        top.plot(curve.time, curve.modulus / size, color=CYCLE[0], label="free spectrum")
        for i, fit in enumerate(curve.fits[:DRAWN]):
            top.plot(curve.time, fit.stress / size, color=CYCLE[(i + 1) % len(CYCLE)], lw=1.0,
                     ls="-" if fit.inside else ":", label=fit.form)
        top.set(xscale="log", xlabel="time after a jump [s]", ylabel=f"shear modulus [{unit}]")
        top.legend()
        bottom.errorbar(curve.taus, curve.weights, yerr=WIDTH_95 * curve.weight_std, fmt="o", color=CYCLE[0], ms=4)
        bottom.axhline(0.0, color=Colour.GREY, lw=0.8)
        for end in (curve.time[0], curve.time[-1]):
            bottom.axvline(end, color=Colour.GREY, lw=0.8, ls=":")
        bottom.set(xscale="log", xlabel="relaxation time [s] (dotted: what the frames show)", ylabel="weight [-]")
        figure.align_ylabels([top, bottom])
        return to_picture(figure, f"relaxation_{curve.name}", f"Free relaxation spectrum: {curve.name}",
                          _caption(curve, unit, size))


def _caption(curve: RelaxationCurve, unit: str, size: float) -> str:
    forms = "; ".join(_form(fit, unit, size) for fit in curve.fits)
    return ("Shear modulus at small strain after a jump, from the interval between two frames to the length of the "
            "test. Shaded and bars: 95 %, from the covariance of the parameters and the smoothness prior (second "
            f"differences of the weights: std {curve.strength:g} of their mean at the start); the shading also counts "
            "the spacing of the grid. Weights are non-negative; neighbours are anticorrelated, their sum is better "
            "determined than each. Classical forms, fitted in that covariance, the nearest first; "
            "\"inside\": the loss in chi2 is no more than noise explains (about "
            f"the number in brackets). {forms}.")


def _form(fit: ClassicalFit, unit: str, size: float) -> str:
    values = ", ".join(f"{name} = {value / size:.4g} {unit}" if name == "G" else
                       f"{name} = {value:.4g}{' s' if name == 'tau' else ''}" for name, value in fit.parameters.items())
    return f"{fit.form}{' (inside)' if fit.inside else ''}: {values}, chi2 {fit.chi2:.3g} ({max(fit.freedom, 0)})"
