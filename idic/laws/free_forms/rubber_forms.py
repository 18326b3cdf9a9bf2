"""Incompressible rubber in three modes: nominal stress of free and of classical energies, slow.

With stretch L along the pull and g1, g2 the derivatives of the energy by I1, I2:

    uniaxial       2 (L - L^-2) (g1 + g2 / L)       I1 = L^2 + 2 / L           I2 = 2 L + L^-2
    pure shear     2 (L - L^-3) (g1 + g2)           I1 = I2 = L^2 + 1 + L^-2
    equibiaxial    2 (L - L^-5) (g1 + L^2 g2)       I1 = 2 L^2 + L^-4          I2 = L^4 + 2 L^-2

Classical forms: Treloar, The Physics of Rubber Elasticity (1975); Yeoh, Rubber Chem. Technol. 63 (1990) 792; Gent,
ibid. 69 (1996) 59; Arruda & Boyce, J. Mech. Phys. Solids 41 (1993) 389, doi:10.1016/0022-5096(93)90013-6; Haines &
Wilson, ibid. 27 (1979) 345, doi:10.1016/0022-5096(79)90034-6; Ogden, Proc. R. Soc. Lond. A 326 (1972) 565,
doi:10.1098/rspa.1972.0026.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from idic.laws.free_forms.free_curve import Form, basis

UNIAXIAL, PURE_SHEAR, EQUIBIAXIAL = RUBBER_TESTS = ("uniaxial", "pure shear", "equibiaxial")
CHAIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)  # of the inverse Langevin function
Slopes = Callable[..., tuple[np.ndarray, np.ndarray]]


def invariants(mode: str, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(I1 - 3, I2 - 3) at stretches (m,)"""
    L = stretch
    if mode == UNIAXIAL:
        return L**2 + 2.0 / L - 3.0, 2.0 * L + L**-2 - 3.0
    if mode == PURE_SHEAR:
        return L**2 + L**-2 - 2.0, L**2 + L**-2 - 2.0
    return 2.0 * L**2 + L**-4 - 3.0, L**4 + 2.0 * L**-2 - 3.0


def weights(mode: str, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What g1 and g2 are multiplied by in the nominal stress  # (m,), (m,)"""
    L = stretch
    power, of_second = {UNIAXIAL: (2, 1.0 / L), PURE_SHEAR: (3, np.ones_like(L)), EQUIBIAXIAL: (5, L**2)}[mode]
    of_first = 2.0 * (L - L ** float(-power))
    return of_first, of_first * of_second


def stress_matrix(mode: str, stretch: np.ndarray, ends: tuple[float, ...], n: tuple[int, ...]) -> np.ndarray:
    """Nominal stress per value of g1 and g2 at their n knots, the last at `ends`  # (m, sum of n)"""
    parts = zip(invariants(mode, stretch), weights(mode, stretch), ends, n, strict=False)
    return np.hstack([w[:, None] * basis(x, reach, count) for x, w, reach, count in parts])


def classical_forms(mode: np.ndarray, stretch: np.ndarray) -> dict[str, Form]:
    """The classical forms at points of these modes (m,) and stretches (m,); the points of `Form.curve` are their
    places."""
    x, y, of_first, of_second = (np.zeros(len(stretch)) for _ in range(4))
    for test in RUBBER_TESTS:
        of_test = mode == test
        x[of_test], y[of_test] = invariants(test, stretch[of_test])
        of_first[of_test], of_second[of_test] = weights(test, stretch[of_test])

    def by_slopes(slopes: Slopes) -> Callable[..., np.ndarray]:
        def curve(places, *parameters):
            k = np.asarray(places, dtype=int)
            g1, g2 = slopes(x[k], y[k], *parameters)
            return of_first[k] * g1 + of_second[k] * g2
        return curve

    side = np.select([mode == UNIAXIAL, mode == PURE_SHEAR], [0.5, 1.0], 2.0)

    def ogden(places, mu1, a1, mu2, a2, mu3, a3):
        k = np.asarray(places, dtype=int)
        L, s = stretch[k], side[k]
        return sum(mu * (L ** (a - 1.0) - L ** (-s * a - 1.0)) for mu, a in ((mu1, a1), (mu2, a2), (-mu3, -a3)))

    most, zero = float(x.max()), 0.0
    return {
        "neo_hooke": Form(("C10",), by_slopes(lambda x, y, C: (C + zero * x, zero * x)), lambda r: [(0.3,)], ("C10",)),
        "mooney_rivlin": Form(("C10", "C01"), by_slopes(lambda x, y, C, D: (C + zero * x, D + zero * x)),
                              lambda r: [(0.3, 0.05)], ("C10", "C01"), -np.inf),
        "yeoh": Form(("C10", "C20", "C30"),
                     by_slopes(lambda x, y, a, b, c: (a + 2.0 * b * x + 3.0 * c * x * x, zero * x)),
                     lambda r: [(0.3, 0.0, 0.0)], ("C10", "C20", "C30"), -np.inf),
        "gent": Form(("mu", "Jm"), by_slopes(lambda x, y, mu, J: (0.5 * mu * _locking(x, J), zero * x)),
                     lambda r: [(0.5, f * most) for f in (1.5, 5.0, 30.0)], ("mu",)),
        "arruda_boyce": Form(("mu", "stretch_m"), by_slopes(
            lambda x, y, mu, m: (mu * sum((i + 1) * c * ((x + 3.0) / (m * m)) ** i for i, c in enumerate(CHAIN)),
                                 zero * x)),
            lambda r: [(0.5, f * np.sqrt(1.0 + most / 3.0)) for f in (1.2, 2.0, 5.0)], ("mu",)),
        "haines_wilson": Form(("C10", "C01", "C11", "C20", "C02", "C30"), by_slopes(
            lambda x, y, a, b, c, d, e, f: (a + c * y + 2.0 * d * x + 3.0 * f * x * x, b + c * x + 2.0 * e * y)),
            lambda r: [(0.3, 0.05, 0.0, 0.0, 0.0, 0.0)], ("C10", "C01", "C11", "C20", "C02", "C30"), -np.inf),
        "ogden": Form(("mu1", "alpha1", "mu2", "alpha2", "minus_mu3", "minus_alpha3"), ogden,
                      lambda r: [(0.3, a, 0.01, b, 0.01, c) for a in (1.3, 2.0) for b in (4.0, 6.0)
                                 for c in (1.0, 2.0)],
                      ("mu1", "mu2", "minus_mu3")),
    }


def _locking(x: np.ndarray, J: float) -> np.ndarray:
    """J / (J - x), straight on from nine tenths of the locking: trial values of the search lie beyond."""
    share = np.minimum(x / J, 0.9)
    return 1.0 / (1.0 - share) + (x / J - share) * 100.0
