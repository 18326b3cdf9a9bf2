"""One constitutive law at one material point: uniaxial stress over strain, and what each parameter does to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.materials import compile, get_law
from idic.materials.point import uniaxial

_STEPS = 120


def plot_law(name: str, path: Path | str, largest_strain: float = 0.05) -> None:
    """Draw a law with its typical parameters under uniaxial stress, loaded and then reversed, into a picture file.

    Above the stress P11 (MPa), below its change for a relative change of one parameter, ``p dP11/dp`` (MPa).

    Parameters
    ----------
    name : str
        As in `idic laws`.
    path : path
        Its suffix chooses the format: .png, .svg, .pdf.

    Raises
    ------
    InputError
        No such law.
    """
    from matplotlib.figure import Figure

    spec = get_law(name)
    law, params = compile(name, spec.kinematics[0]), spec.defaults()
    strain = largest_strain * np.concatenate([np.linspace(0, 1, _STEPS), np.linspace(1, 0.8, _STEPS // 4)[1:]])
    curve = uniaxial(law, params, strain)
    figure = Figure(figsize=(7.0, 6.5), layout="constrained")
    stress, change = figure.subplots(2, 1, sharex=True)
    stress.plot(100 * strain, curve.P[:, 0, 0], color="black")
    stress.set_ylabel("P11 (MPa)")
    stress.set_title(", ".join(f"{p.name} = {p.default:g} {p.unit}".strip(" -") for p in spec.parameters), fontsize=8)
    figure.suptitle(f"{name} ({spec.kinematics[0]} strain), uniaxial stress")
    for i, parameter in enumerate(spec.parameters):
        change.plot(100 * strain, params[i] * curve.dP[:, i, 0, 0], label=parameter.name)
    change.axhline(0, color="0.8", lw=0.8, zorder=0)
    change.set_xlabel("strain (%)")
    change.set_ylabel("p · dP11/dp (MPa)")
    change.legend(fontsize=8)
    figure.savefig(path, dpi=150)
