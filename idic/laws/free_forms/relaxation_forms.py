"""Classical forms of a relaxation curve G(t), and a spectrum as a material card; slow.

    standard linear solid   G (1 - g (1 - exp(-t / tau)))
    stretched exponential   G (1 - g (1 - exp(-(t / tau)^beta)))           Kohlrausch; Williams & Watts
    power law               G (1 + t / tau)^-n
    fractional Zener        G (1 - g (1 - E_a(-(t / tau)^a)))              E_a: Mittag-Leffler's function
    logarithmic             G (1 - g ln(1 + t / tau))

Williams & Watts, Trans. Faraday Soc. 66 (1970) 80, doi:10.1039/TF9706600080; Bagley & Torvik, J. Rheol. 27 (1983) 201,
doi:10.1122/1.549724; E_a by its spectrum, Gorenflo & Mainardi (1997), arXiv:0805.3823.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from idic.laws.free_forms.free_curve import Form
from idic.laws.rate.free_relaxation import relaxing

LARGEST_ORDER = 0.999  # of a fractional derivative; 1 is the standard linear solid
STARTS = 5  # of a relaxation time


def mittag_leffler(order: float, x: np.ndarray) -> np.ndarray:
    """E_a(-x^a) of an order a within 0 and 1 at x >= 0 (m,), as a sum of exponentials over ln r in -40 ... 40."""
    a = min(order, LARGEST_ORDER)
    log_r = np.linspace(-40.0, 40.0, 241)
    scaled = np.exp(-np.abs(a * log_r))  # r^a or its inverse, both never above 1
    density = np.sin(a * np.pi) / np.pi * scaled / (scaled**2 + 2.0 * scaled * np.cos(a * np.pi) + 1.0)
    decay = np.exp(-np.exp(np.minimum(log_r[None] + np.log(np.maximum(x, 1e-300))[:, None], 50.0)))
    return np.where(x > 0.0, decay @ density / density.sum(), 1.0)


def _starts(*more: float):
    return lambda reach: [(1.0, *more, tau) for tau in np.geomspace(1e-2, 1.0, STARTS) * reach]


FORMS = {
    "standard linear solid": Form(("G", "g", "tau"), lambda t, G, g, tau: G * (1.0 + g * np.expm1(-t / tau)),
                                  _starts(0.5), ("G",), 1e-12),
    "stretched exponential": Form(
        ("G", "g", "beta", "tau"), lambda t, G, g, beta, tau: G * (1.0 + g * np.expm1(-(t / tau) ** beta)),
        _starts(0.5, 0.5), ("G",), 1e-12),
    "power law": Form(("G", "n", "tau"), lambda t, G, n, tau: G * (1.0 + t / tau) ** -n, _starts(0.2), ("G",), 1e-12),
    "fractional Zener": Form(
        ("G", "g", "a", "tau"), lambda t, G, g, a, tau: G * (1.0 - g * (1.0 - mittag_leffler(a, t / tau))),
        _starts(0.5, 0.5), ("G",), 1e-12),
    "logarithmic": Form(("G", "g", "tau"), lambda t, G, g, tau: G * (1.0 - g * np.log1p(t / tau)), _starts(0.1),
                        ("G",), 1e-12),
}


def grid_covariance(times: np.ndarray, taus: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Covariance of the share that has relaxed at times (m,) s by what may lie between the times of the grid  # (m, m)

    A relaxation time in the middle of two is met by weights of the grid up to a small rest. Of every interval, half of
    the weights at its ends may be there; the rests of all intervals are independent.

    taus, weights : (n,) s, -
    """
    grid = relaxing(times, taus)
    between = relaxing(times, np.sqrt(taus[:-1] * taus[1:])).T
    rests = np.array([share - grid @ scipy.optimize.nnls(grid, share)[0] for share in between])
    rests *= 0.5 * (weights[:-1] + weights[1:])[:, None]
    return rests.T @ rests


def relaxation_card(branches: Sequence[tuple[float, float]], values: Mapping[str, float],
                    program: str) -> tuple[list[str], list[str]]:
    """(lines, what they do not say) of a body whose shear modulus relaxes; branches : (weight, time in s)"""
    E, nu = values["E"], values["nu"]
    G, kappa = E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))
    active = [(g, tau) for g, tau in branches if g > 0.0]
    elastic = [f"{0.5 * G:.8g}, {2.0 / kappa:.8g}"]
    if program == "calculix":
        return ["*HYPERELASTIC, NEO HOOKE", *elastic], ["relaxation: CalculiX has no *VISCOELASTIC; this body is the "
                                                        "instantaneous one"] if active else []
    lines = ["*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS", *elastic]
    if not active:
        return lines, []
    return ([*lines, "*VISCOELASTIC, TIME=PRONY", *(f"{g:.8g}, 0, {tau:.8g}" for g, tau in active)],
            ["at large strains the branches are those of Abaqus, linear in the stress, not multiplicative ones"])
