"""Every field of one frame under the names of tables and files: docs/fields.md lists them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.measure.fields.series import FieldSeries, component_of
from idic.measure.fields.strain import rotated

STRAINS = ("xx", "yy", "xy", "1", "2")


def field_columns(series: FieldSeries, k: int, measure: str = "green_lagrange", angle_deg: float = 0.0,
                  noise: bool = True) -> Mapping[str, np.ndarray]:
    """Nodal fields of the k-th frame of a series.

    Parameters
    ----------
    measure : see `idic.measure.fields.strain`
    angle_deg : of the x axis of all components
    noise : whether the standard deviations of the measurement are wanted

    Returns
    -------
    {name: (n,)}
        ``u_x_mm``, ``u_y_mm``, of a solid and of two cameras ``u_z_mm`` and ``z_mm``; ``strain_xx``, ``_yy``,
        ``_xy``, ``_1``, ``_2``; the same with ``_measured`` and ``_std``; ``stress_xx_MPa``, ``_yy_``, ``_xy_``; the
        states by their names.
    """
    turn, frame = _axes(angle_deg), _frame(series, k)
    columns: dict[str, np.ndarray] = {}
    for tail, u in (("", frame.simulated), ("_measured", frame.measured)):
        if u is None:
            continue
        columns |= {f"u_{axis}_{series.unit}{tail}": (u[0] @ turn.T)[:, i] for i, axis in enumerate("xy")}
        E = frame.strain(measure, angle_deg, tail[1:] or "simulated")[0]
        columns |= {f"strain_{name}{tail}": component_of(E, name) for name in STRAINS}
    if noise and series.noise is not None and series.measured is not None:
        spread = np.sqrt(np.mean((series.noise @ turn.T) ** 2, axis=0))
        columns |= {f"u_{axis}_{series.unit}_std": spread[:, i] for i, axis in enumerate("xy")}
        columns |= {f"strain_{name}_std": frame.strain_std(name, measure, angle_deg)[0] for name in STRAINS}
    if frame.stress is not None:
        stress = rotated(frame.stress[0], angle_deg)
        columns |= {f"stress_{name}_{series.stress_unit}": component_of(stress, name) for name in ("xx", "yy", "xy")}
    columns |= {f"{name}_{series.unit}": values[0] for name, values in frame.depth.items()}
    columns |= {f"{name}_{series.unit}_measured": values[0] for name, values in frame.measured_depth.items()}
    if noise and series.depth_noise is not None:
        spread = np.sqrt(np.mean(series.depth_noise**2, axis=0))
        columns |= {f"{name}_{series.unit}_std": spread for name in frame.measured_depth}
    return columns | {name: values[0] for name, values in frame.states.items()}


def _frame(series: FieldSeries, k: int) -> FieldSeries:
    """The series with one frame."""
    return FieldSeries(series.surface, (series.frames[k],), series.simulated[k:k + 1],
                       None if series.measured is None else series.measured[k:k + 1], series.noise,
                       None if series.stress is None else series.stress[k:k + 1],
                       {name: values[k:k + 1] for name, values in series.states.items()}, series.smoothed, series.kind,
                       series.unit, series.stress_unit,
                       {name: values[k:k + 1] for name, values in series.depth.items()},
                       {name: values[k:k + 1] for name, values in series.measured_depth.items()})


def _axes(angle_deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, s], [-s, c]])
