"""The figure of docs/evidence/polycarbonate.md: stress over stretch of the polymer at three rates, and its two parts.

Run with ``python studies/evidence/polycarbonate/curves.py``; writes docs/evidence/polycarbonate.png.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.laws import compile, uniaxial
from idic.report import CYCLE, Colour, look, new_figure

STRAIN = np.linspace(0.0, 0.8, 401)
RATES = (1e-4, 1e-3, 1e-2)  # 1/s


def spectrum() -> tuple[str, np.ndarray]:
    """Law and parameters with 17 modes: the network and softening of one mode, viscosities over 17 decades."""
    k = np.arange(1, 17)
    modes = np.stack([56.0 * 0.87**k, 3.5e10 * 11.0**-k], axis=1)
    return "egp_17", np.concatenate([compile("egp").spec.defaults()[:8], [350.0, 2e11], modes.ravel()])


def stress(law: str, values: np.ndarray, rate: float) -> np.ndarray:
    """True stress along the tension, MPa  # (n_strains,)"""
    return uniaxial(compile(law), values, STRAIN, times=STRAIN / rate).cauchy[:, 0, 0]


def main() -> None:
    single_mode, several = ("egp", compile("egp").spec.defaults()), spectrum()
    with look():
        figure = new_figure(8.0, 3.6)
        stress_axis, yield_axis = figure.subplots(1, 2)
        for rate, colour in zip(RATES, CYCLE, strict=False):
            curve = stress(*single_mode, rate)
            stress_axis.plot(100 * STRAIN, curve, color=colour, label=f"{rate:g} 1/s")
            inset = STRAIN <= 0.08
            yield_axis.plot(100 * STRAIN[inset], curve[inset], color=colour)
            yield_axis.plot(100 * STRAIN[inset], stress(*several, rate)[inset], "--", color=colour)
        network = compile("egp").spec.defaults()[0] * ((1 + STRAIN) ** 2 - 1 / (1 + STRAIN))  # nearly incompressible
        stress_axis.plot(100 * STRAIN, network, color=Colour.FAINT, label="network alone (Gr)")
        stress_axis.annotate("softening (Sa, r0, r1, r2)", (8, 53), (20, 44), arrowprops={"arrowstyle": "->"},
                             color=Colour.BLACK)
        stress_axis.set(xlabel="strain [%]", ylabel="true stress [MPa]", title="one mode", ylim=(0, 90))
        stress_axis.legend()
        yield_axis.set(xlabel="strain [%]", title="yield: one mode (-), seventeen (--)", ylim=(0, 70))
        figure.savefig(Path(__file__).parents[3] / "docs" / "evidence" / "polycarbonate.png", dpi=110)


if __name__ == "__main__":
    main()
