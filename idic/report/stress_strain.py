"""Stress-strain curves of the identified laws, with the band of the error bars of the parameters."""

from __future__ import annotations

import numpy as np

from idic.laws import PRODUCT_SIGN
from idic.report.figures.picture import Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import LawCurve, RunRecord
from idic.report.result.stress_scale import stress_unit
from idic.report.result.words import number_text, two_digits

WIDTH_95 = 1.96


def stress_strain(record: RunRecord, curve: LawCurve) -> Picture | None:
    """Uniaxial stress with the 95 % band, and the half-width of the band below; None where a parameter is open."""
    if curve.missing or len(curve.strain) < 2:
        return None
    unit, size = stress_unit(record.result, curve.name)
    strain, half = 100.0 * curve.strain, WIDTH_95 * curve.std / size
    stress, started = curve.stress / size, curve.started / size
    with look():
        figure = new_figure(7.2, 4.6)
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        top.plot(strain, started, "--", color=Colour.ORANGE, lw=1.1, label="starting values")
        top.fill_between(strain, stress - half, stress + half, color=Colour.BLUE, alpha=0.3, lw=0, label="95 %")
        top.plot(strain, stress, color=Colour.BLUE, label="identified")
        top.set(ylabel=f"nominal stress [{unit}]")
        top.legend()
        bottom.fill_between(strain, 0.0, half, color=Colour.BLUE, alpha=0.3, lw=0)
        bottom.plot(strain, half, color=Colour.BLUE, lw=1.0)
        bottom.set(xlabel="nominal strain [%]", ylabel=f"± 95 % [{unit}]",
                   xlim=(min(0.0, strain[-1]), max(0.0, strain[-1])),
                   ylim=(0.0, 1.15 * max(float(np.nanmax(half)), 1e-12)))
        figure.align_ylabels([top, bottom])
        end_stress = f"{number_text(stress[-1], half[-1])} ± {two_digits(half[-1])} {unit}"
        caption = (
            f"The law {curve.law} in uniaxial {'tension' if strain[-1] > 0 else 'compression'} along {curve.axis}, the "
            f"main direction of the test, in {curve.seconds:.4g} {record.time_label_unit}, up to "
            f"the 99th percentile of the specimen's strain ({strain[-1]:.3g} %): {end_stress} there. The band "
            "(half-width "
            "below) follows from the standard deviations and correlations of the parameters; a wrong law is not in it."
            f"{' It is drawn at the reference temperature.' if PRODUCT_SIGN in curve.law else ''}"
        )
        return to_picture(figure, f"stress_strain_{curve.name}", f"Identified law: {curve.name}", caption)


def open_curves(record: RunRecord) -> tuple[str, ...]:
    """A sentence per law whose curve cannot be drawn."""
    return tuple(f"{curve.name}: no stress-strain curve, as this test does not determine {', '.join(curve.missing)}."
                 for curve in record.curves if curve.missing)
