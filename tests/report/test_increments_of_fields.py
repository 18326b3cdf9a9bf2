"""`idic check` tells displacements against the stage before from those against the reference, by the log."""

from __future__ import annotations

import numpy as np
import pytest
from experiment_file.point_plate import write_point_plate
from typer.testing import CliRunner

from idic.cli.app import app

E, NU, AREA_MM2 = 72e3, 0.33, 40.0
X, Y = (each.ravel() for each in np.meshgrid(np.arange(-24, 24.01, 1.6), np.arange(-9.6, 9.61, 1.6)))
EVEN = np.array([0, 0, 1, 2, 3, 4, 5, 6, 7, 8]) * 1e3
UNEVEN = np.array([0, 300, 1500, 1800, 3600, 3900, 6000, 6200, 7900]) * 1.0
CYCLES = np.array([0, 2, 4, 2, 0, 2, 4, 6, 4, 2, 0]) * 1e3
HELD = np.array([0, 2, 4, 6, 6, 6, 6, 6, 4, 2]) * 1e3


def checked(folder, force: np.ndarray, strain: np.ndarray) -> str:
    """What `idic check` shows of stages of this strain along x."""
    rng = np.random.default_rng(3)
    rows = ["stage,x_mm,y_mm,ux_mm,uy_mm"]
    for k, e in enumerate(strain):
        ux, uy = e * (X + 24) + rng.normal(0, 4e-4, X.size), -NU * e * Y + rng.normal(0, 4e-4, X.size)
        rows += [f"{k},{a:.3f},{b:.3f},{u:.6f},{v:.6f}" for a, b, u, v in zip(X, Y, ux, uy, strict=True)]
    (folder / "fields.csv").write_text("\n".join(rows) + "\n")
    (folder / "log.csv").write_text("force_N\n" + "\n".join(f"{f + rng.normal(0, 4):.2f}" for f in force) + "\n")
    write_point_plate(folder, "fields.csv", 0.8, 6)
    shown = CliRunner().invoke(app, ["check", str(folder)])
    assert shown.exit_code == 0, shown.output
    return " ".join(shown.output.split())


@pytest.mark.parametrize("force", [EVEN, UNEVEN, CYCLES])
def test_increments_are_named(tmp_path, force):
    text = checked(tmp_path, force, np.diff(force, prepend=force[0]) / AREA_MM2 / E)
    assert "seem to count from the stage before" in text and "export the displacements against the first stage" in text


def plastic(force: np.ndarray) -> np.ndarray:
    """Elastic to 6 kN, then eight times as soft."""
    return (force + 8.0 * np.maximum(force - 6e3, 0.0)) / AREA_MM2 / E


@pytest.mark.parametrize("force, strain", [
    (EVEN, EVEN / AREA_MM2 / E), (UNEVEN, UNEVEN / AREA_MM2 / E), (CYCLES, CYCLES / AREA_MM2 / E),
    (EVEN, plastic(EVEN)), (HELD, HELD / AREA_MM2 / E + 1e-4 * np.arange(10)),  # creep
    (EVEN, np.zeros(10)),  # noise alone, with that of the reference in all stages
])
def test_total_displacements_are_not(tmp_path, force, strain):
    assert "stage before" not in checked(tmp_path, force, strain)
