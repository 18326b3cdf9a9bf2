"""Temperature dependence of a law: the factors on its parameters over the temperatures of the test, with their
bands."""

from __future__ import annotations

from collections.abc import Sequence

from idic.report.figures.hardening import WIDTH_95
from idic.report.figures.picture import CYCLE, Colour, Picture
from idic.report.figures.style import look, new_figure, to_picture
from idic.report.result.record import TemperatureFactor

UNITS = {"slope": " 1/K", "m": "", "melting": " °C", "activation": " K"}


def temperature_dependence(factors: Sequence[TemperatureFactor]) -> Picture:
    """The factors of one material."""
    name, reference = factors[0].name, factors[0].reference
    with look():
        figure = new_figure(7.2, 3.4)
        axis = figure.subplots()
        for i, dependence in enumerate(factors):
            color = CYCLE[i % len(CYCLE)]
            half = WIDTH_95 * dependence.std
            axis.fill_between(dependence.temperature, dependence.factor - half,
                              dependence.factor + half, color=color, alpha=0.3, lw=0)
            axis.plot(dependence.temperature, dependence.factor, color=color,
                      label=f"{', '.join(dependence.targets)} ({dependence.kind})")
        axis.plot(reference, 1.0, "o", color=Colour.GREY, ms=4, label="reference temperature")
        axis.set(xlabel="temperature [°C]", ylabel="factor [-]")
        axis.legend()
        return to_picture(figure, f"temperature_dependence_{name}", f"Temperature dependence: {name}",
                          _caption(factors))


def _caption(factors: Sequence[TemperatureFactor]) -> str:
    terms = "; ".join(f"{', '.join(dependence.targets)}: {dependence.kind}, " + ", ".join(
        f"{name} = {value:.4g}{UNITS[name]}" for name, value in dependence.values.items()) for dependence in factors)
    return (f"Factors on the parameters over the temperatures of the test, 1 at {factors[0].reference:g} °C; shaded: "
            f"95 %, from the covariance of the parameters. {terms}.")
