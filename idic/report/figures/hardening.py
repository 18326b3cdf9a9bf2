"""Free plasticity with its band and classical forms: hardening curve over plastic strain, yield surface over stress."""

from __future__ import annotations

import numpy as np

from idic.experiment_file import SPREAD
from idic.laws import ClassicalFit, FAMILY_ERROR, ROOT
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import HardeningCurve, RunRecord, YieldSurface
from idic.report.result.stress_scale import stress_unit

WIDTH_95 = 1.96
NEAR_PLANE = 0.35  # share of shear below which a visited direction is marked in the section
EQUATIONS = {"linear": "yield_stress + H p", "voce": "yield_stress + Q (1 - exp(-b p))",
             "ludwik": "yield_stress + K p^n", "swift": "K (strain_0 + p)^n", "power": "K p^n"}


def hardening_curve(record: RunRecord, curve: HardeningCurve) -> Picture:
    """Flow stress over plastic strain with the 95 % band; below, the classical forms minus the curve, in the band."""
    unit, size = stress_unit(record.result, curve.name)
    p, half = 100.0 * curve.plastic_strain, WIDTH_95 * curve.std / size
    with look():
        figure = new_figure(7.2, 5.2)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.2))
        top.fill_between(p, curve.stress / size - half, curve.stress / size + half, color=Colour.BLUE, alpha=0.3, lw=0,
                         label="95 %")
        top.plot(p, curve.stress / size, color=Colour.BLUE, label="free curve")
        inside = curve.knots <= curve.reached
        top.plot(100.0 * curve.knots[inside], np.interp(curve.knots[inside], curve.plastic_strain, curve.stress / size),
                 "|",
                 color=Colour.GREY, label="knots")
        top.set(ylabel=f"flow stress [{unit}]")
        top.legend()
        bottom.fill_between(p, -half, half, color=Colour.BLUE, alpha=0.3, lw=0)
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
            "the curve is not measured. The band follows from the covariance of the parameters and from what the curve "
            f"may do between its knots; the smoothness prior ({_prior(curve)}) is part of it. Below: classical forms "
            "at the knots, "
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


def yield_surface(record: RunRecord, surface: YieldSurface) -> Picture:
    """Left the section without shear with its 95 % band; right, along visited stresses, band and classical forms."""
    unit, size = stress_unit(record.result, surface.name)
    with look():
        figure = new_figure(7.2, 3.9)
        section_axis, visited_axis = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
        d, r, half = surface.section, surface.radius / size, WIDTH_95 * surface.std / size
        section_axis.fill(np.append(d[:, 0] * (r + half), (d[:, 0] * (r - half))[::-1]),
                  np.append(d[:, 1] * (r + half), (d[:, 1] * (r - half))[::-1]), color=Colour.BLUE, alpha=0.3, lw=0,
                  label="95 %")
        section_axis.plot(d[:, 0] * r, d[:, 1] * r, color=Colour.BLUE, label="free surface")
        in_plane = np.abs(surface.visited[:, 2]) < NEAR_PLANE
        for sign in (1.0, -1.0):
            stresses = sign * surface.visited[in_plane] * surface.visited_radius[in_plane, None] / size
            section_axis.plot(stresses[:, 0], stresses[:, 1], "o", color=Colour.GREY, ms=3,
                              label="visited" if sign > 0 else None)
        section_axis.set(xlabel=f"stress along axis 1 [{unit}]", ylabel=f"stress along axis 2 [{unit}]", aspect="equal")
        section_axis.legend(fontsize=8)
        at, band = np.arange(len(surface.visited)), 100.0 * WIDTH_95 * surface.visited_std / surface.visited_radius
        visited_axis.fill_between(at, -band, band, color=Colour.BLUE, alpha=0.3, lw=0, label="95 %", step="mid")
        for i, fit in enumerate(surface.fits):
            visited_axis.plot(at, 100.0 * (fit.stress / surface.visited_radius - 1.0), "-o" if fit.inside else ":.",
                       color=CYCLE[i % len(CYCLE)], lw=1.2, ms=3,
                       label=fit.form + (" (as near as noise)" if fit.inside else ""))
        visited_axis.set(xlabel="visited stress, by biaxial angle", ylabel="form - free surface [%]", xticks=[])
        if len(at):
            largest = 3.0 * float(np.max(band))
            visited_axis.set(ylim=(-largest, largest), xlim=(0, max(len(at) - 1, 1)))
            visited_axis.legend(fontsize=8)
        return to_picture(figure, f"yield_surface_{surface.name}", f"Free yield surface: {surface.name}",
                          _surface_caption(surface, unit, size))


def _surface_caption(surface: YieldSurface, unit: str, size: float) -> str:
    forms = "; ".join(_surface_form(fit, unit, size) for fit in surface.fits)
    visited_text = (f"Right: along the {len(surface.visited)} directions of stress in which the test has flowed "
                    "(tension and "
             "compression as one; cells of 15 degrees), the band and classical forms minus the surface, fitted in "
             f"its covariance and the {FAMILY_ERROR:.1%} by which the weights miss such forms, solid where their loss "
             "in chi2 is no more than noise explains (about the number in "
             f"brackets). {forms}. " if len(surface.visited) else "No stresses are known that the test has visited. ")
    return ("Left: initial yield without shear in material axes; dots are visited directions with little shear, the "
            f"rest of the section follows the prior. {visited_text}The band counts the covariance of the parameters "
            f"and the {FAMILY_ERROR:.1%} by which the weights miss a surface of Hill. The prior (weights 1 with std "
            f"{SPREAD:g}, neighbours differ by 0 with std {surface.smoothness:g}) is part of it.")


def _surface_form(fit: ClassicalFit, unit: str, size: float) -> str:
    values = ", ".join(f"{name} = {value / size:.4g} {unit}" if name == "yield_stress" else f"{name} = {value:.3g}"
                       for name, value in fit.parameters.items())
    return f"{fit.form}: {values}, chi2 {fit.chi2:.3g} ({max(fit.freedom, 0)})"
