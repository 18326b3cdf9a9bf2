"""A free hardening curve with its band, the plastic strain that the test has reached, and classical forms beside it."""

from __future__ import annotations

import numpy as np

from idic.materials.composed.free_curve import ClassicalFit
from idic.materials.composed.smoothness import ROOT
from idic.report.figures.style import BLUE, CYCLE, GREY, Picture, look, new_figure, to_picture
from idic.report.record import HardeningCurve, RunRecord
from idic.report.stress_scale import stress_unit

WIDTH_95 = 1.96
EQUATIONS = {"linear": "yield_stress + H p", "voce": "yield_stress + Q (1 - exp(-b p))",
             "ludwik": "yield_stress + K p^n", "swift": "K (strain_0 + p)^n", "power": "K p^n"}


def hardening_curve(record: RunRecord, curve: HardeningCurve) -> Picture:
    """Flow stress over plastic strain with the 95 % band; below, the classical forms minus the curve, in the band."""
    unit, size = stress_unit(record.result, curve.name)
    p, half = 100.0 * curve.plastic_strain, WIDTH_95 * curve.std / size
    with look():
        figure = new_figure(7.2, 5.2)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.2))
        top.fill_between(p, curve.stress / size - half, curve.stress / size + half, color=BLUE, alpha=0.3, lw=0,
                         label="95 %")
        top.plot(p, curve.stress / size, color=BLUE, label="free curve")
        inside = curve.knots <= curve.reached
        top.plot(100.0 * curve.knots[inside], np.interp(curve.knots[inside], curve.plastic_strain, curve.stress / size),
                 "|",
                 color=GREY, label="knots")
        top.set(ylabel=f"flow stress [{unit}]")
        top.legend()
        bottom.fill_between(p, -half, half, color=BLUE, alpha=0.3, lw=0)
        at = np.append(curve.knots[inside], curve.reached)  # between them the curve is a chord
        for i, fit in enumerate(curve.fits):
            difference = np.interp(at, curve.plastic_strain, (fit.stress - curve.stress) / size)
            bottom.plot(100.0 * at, difference, "-o" if fit.inside else ":.", color=CYCLE[i % len(CYCLE)], lw=1.2, ms=3,
                        label=fit.form + (" (as near as noise)" if fit.inside else ""))
        largest = 3.0 * float(np.max(half[len(half) // 4:]))
        bottom.set(xlabel="plastic strain [%]", ylabel=f"form - curve [{unit}]", ylim=(-largest, largest),
                   xlim=(0.0, 100.0 * curve.reached))
        bottom.legend(ncols=3, fontsize=8)
        figure.align_ylabels([top, bottom])
        return to_picture(figure, f"hardening_{curve.name}", f"Free hardening curve: {curve.name}",
                          _caption(curve, unit, size))


def _caption(curve: HardeningCurve, unit: str, size: float) -> str:
    forms = "; ".join(_form(fit, unit, size) for fit in curve.fits)
    return (f"Flow stress up to the plastic strain that 99 % of the seen nodes stay within ({100 * curve.reached:.3g} "
            f"%); beyond it "
            "the curve is not measured. The band follows from the covariance of the parameters; the smoothness prior "
            f"({_prior(curve)}) is part of it. Below: classical forms at the knots, "
            "fitted in that covariance, solid where their loss in chi2 is no more than noise explains (about the "
            f"number in brackets). {forms}.")


def _prior(curve: HardeningCurve) -> str:
    strength = f"{curve.smoothness.strength:g}"
    if curve.smoothness.over == ROOT:
        return (f"second differences of the values at the knots: std {strength} of the rise of the starting curve over "
                "the number of intervals")
    return f"changes of slope from interval to interval: std {strength} of the mean starting slope"


def _form(fit: ClassicalFit, unit: str, size: float) -> str:
    stresses = ("yield_stress", "H", "Q", "K")
    values = ", ".join(f"{name} = {value / size:.4g} {unit}" if name in stresses else f"{name} = {value:.3g}"
                       for name, value in fit.parameters.items())
    return f"{fit.form}: {EQUATIONS[fit.form]}, {values}, chi2 {fit.chi2:.3g} ({max(fit.freedom, 0)})"
