"""A free rubber energy: nominal stress in three modes with its bands, and the derivatives by the invariants."""

from __future__ import annotations

from idic.laws import ClassicalFit
from idic.report.figures.hardening import WIDTH_95
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import RubberCurve, RunRecord
from idic.report.result.stress_scale import stress_unit

STRESSES = ("C10", "C01", "C20", "C02", "C11", "C30", "mu", "mu1", "mu2", "minus_mu3")


def rubber_energy(record: RunRecord, curve: RubberCurve) -> Picture:
    """Stress over stretch in tension, pure shear and equibiaxial tension; below, dW/dI1 and dW/dI2 at their knots."""
    unit, size = stress_unit(record.result, curve.name)
    with look():
        figure = new_figure(7.2, 5.6)
        top, bottom = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
        for i, mode in enumerate(curve.modes):
            half = WIDTH_95 * mode.std / size
            top.fill_between(mode.stretch, mode.stress / size - half, mode.stress / size + half, color=CYCLE[i],
                             alpha=0.3, lw=0)
            top.plot(mode.stretch, mode.stress / size, color=CYCLE[i], label=mode.mode)
        top.set(xlabel="stretch [-]", ylabel=f"nominal stress [{unit}]")
        top.legend()
        for i, slope in enumerate(curve.slopes):
            half = WIDTH_95 * slope.std / size
            color = CYCLE[(i + len(curve.modes)) % len(CYCLE)]
            bottom.fill_between(slope.invariant, slope.value / size - half, slope.value / size + half, color=color,
                                alpha=0.3, lw=0)
            bottom.plot(slope.invariant, slope.value / size, color=color, label=f"dW/d{slope.name}")
            inside = slope.knots <= slope.invariant[-1]
            at = slope.knots[inside]
            bottom.plot(at, slope.value_at(at) / size, "|", color=Colour.GREY, label="knots" if i == 0 else None)
        bottom.set(xlabel="I1 − 3, I2 − 3 [-]", ylabel=f"derivative [{unit}]")
        bottom.legend()
        figure.align_ylabels([top, bottom])
        return to_picture(figure, f"rubber_{curve.name}", f"Free rubber energy: {curve.name}",
                          _caption(curve, unit, size))


def _caption(curve: RubberCurve, unit: str, size: float) -> str:
    forms = "; ".join(_form(fit, unit, size) for fit in curve.fits)
    strengths = " and ".join(f"{strength:g}" for strength in curve.strengths)
    return (f"Incompressible rubber with the identified energy, up to the invariants that 99 % of the nodes stay "
            f"within (I1 − 3 = {curve.reached[0]:.3g}, I2 − 3 = {curve.reached[1]:.3g}). A mode that the specimen does "
            "not undergo is a prediction. Shaded: 95 %, from the covariance of the parameters, with the smoothness "
            f"prior (second differences of the values at the knots: std {strengths} of the starting C10 over the "
            "number of intervals; a tenth of that for I2). Classical forms, fitted to the three modes in that "
            "covariance, the nearest first; \"inside\": the loss in chi2 is no more than noise explains (about "
            f"the number in brackets). {forms}.")


def _form(fit: ClassicalFit, unit: str, size: float) -> str:
    values = ", ".join(f"{name} = {value / size:.4g} {unit}" if name in STRESSES else f"{name} = {value:.4g}"
                       for name, value in fit.parameters.items())
    return f"{fit.form}{' (inside)' if fit.inside else ''}: {values}, chi2 {fit.chi2:.3g} ({max(fit.freedom, 0)})"
