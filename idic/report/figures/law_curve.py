"""One constitutive law at one material point: uniaxial stress over strain, and its derivative to each parameter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from idic.errors import InputError
from idic.laws import compile, get_law, uniaxial
from idic.report.figures.picture import CYCLE, Colour
from idic.report.figures.style import look, new_figure

_CURVE_STEPS = 400
_STRAIN, _RUBBER_STRAIN = 0.05, 1.0  # metals and composites; a law without memory that is for finite strain only
_REVERSAL_STRAIN_SHARE = 0.8  # the strain to which the load is reversed, as a part of the largest


def plot_law(name: str, path: Path | str, largest_strain: float | None = None) -> None:
    """Draw a law with its typical parameters under uniaxial stress, loaded and then reversed, into a picture file.

    Above the stress P11 (MPa), below its change for a relative change of one parameter, ``p dP11/dp`` (MPa).

    Parameters
    ----------
    name : str
        As in `idic laws`.
    path : path
        Its suffix chooses the format: .png, .svg, .pdf.
    largest_strain : float, optional
        5 %; 100 % for laws of finite elasticity.

    Raises
    ------
    InputError
        No such law, picture format or folder; a parameter without a typical value.
    """
    spec, path = get_law(name), Path(path)
    formats = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in formats:
        suffix = path.suffix or "no suffix"
        raise InputError("no such picture format", file=path, expected=".png, .pdf, .svg", found=suffix,
                         remedy="change the ending of the file name")
    if not path.parent.is_dir():
        raise InputError("no such folder", file=path.parent, expected="an existing folder", found="nothing there",
                         remedy="make the folder, or choose another path")
    without = next((p.name for p in spec.parameters if p.default is None), None)
    if without is not None:
        raise InputError(f"law {name} has no typical values to draw", key=without, expected="default=… of every "
                         "LawParameter", found="none", remedy="add one in the file of the law")
    law, params = compile(name, spec.kinematics[0]), spec.defaults()
    memory = law.n_state(0) > 0
    if largest_strain is None:
        largest_strain = _STRAIN if memory or "small" in spec.kinematics else _RUBBER_STRAIN
    parts = [np.linspace(0, 1, _CURVE_STEPS)] + ([np.linspace(1, _REVERSAL_STRAIN_SHARE, _CURVE_STEPS // 2)[1:]]
                                                 if memory else [])
    strain = largest_strain * np.concatenate(parts)
    curve = uniaxial(law, params, strain)
    with look():
        figure = new_figure(7.2, 6.4)
        stress, change = figure.subplots(2, 1, sharex=True)
        for line, style, label in ((slice(0, _CURVE_STEPS), "-", "loading"),
                                   (slice(_CURVE_STEPS - 1, None), "--", "reversed")):
            if line.stop is None and not memory:
                continue
            stress.plot(100 * strain[line], curve.P[line, 0, 0], style, color=Colour.BLACK, label=label)
            for i, parameter in enumerate(spec.parameters):
                change.plot(100 * strain[line], params[i] * curve.dP[line, i, 0, 0], style, color=CYCLE[i % len(CYCLE)],
                            label=parameter.name if style == "-" else None)  # fmt: skip
        if memory:
            stress.legend()
        stress.set(ylabel="P11 [MPa]", title=f"{name}, {spec.kinematics[0]} strain, uniaxial stress")
        change.axhline(0, color=Colour.FAINT, lw=0.8, zorder=0)
        change.set(xlabel="strain [%]", ylabel="p · dP11/dp [MPa]", title="per relative change of one parameter")
        values = ", ".join(f"{p.name} = {p.default:g} {p.unit}".strip(" -") for p in spec.parameters)
        figure.suptitle(values, fontsize=8, x=0.02, ha="left")
        figure.legend(*change.get_legend_handles_labels(), loc="outside lower center", ncols=6)
        figure.savefig(path, dpi=150)
