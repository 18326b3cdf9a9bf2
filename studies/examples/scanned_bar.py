"""The example `volume` with the motion of CalculiX: elements, law and solver of others."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.errors import NotConverged
from idic.fe import ExpectedOutput, Mesh, gathered, inp_text
from idic.virtual_tests import write_volume
from idic_studies.trial.scenes.calculix import calculix

INCREMENTS = 8  # per scan, at least
MAX_SECONDS = 1800
FAR = 2.0  # plastic strain to which the hardening is given
JOB = "bar"

STEP = """*MATERIAL, NAME=M
*ELASTIC
{E}, {nu}
*PLASTIC
{yield_stress}, 0
{far_stress}, {far}
*SOLID SECTION, ELSET=BODY, MATERIAL=M
*AMPLITUDE, NAME=GRIP
{course}
*BOUNDARY
BOTTOM, 1, 3
TOP, 1, 2
*TIME POINTS, NAME=SCANS, GENERATE
1, {end}, 1
*STEP, NLGEOM, INC=10000
*STATIC
{step}, {end}, 1e-6, {step}
*BOUNDARY, AMPLITUDE=GRIP
TOP, 3, 3, 1
*NODE PRINT, NSET=ALL, TIME POINTS=SCANS
U
*NODE PRINT, NSET=TOP, TOTALS=ONLY, TIME POINTS=SCANS
RF
*END STEP
"""


def write_scanned_bar(out: Path | str, reduced: bool = False, noise: float | None = None, seed: int = 0,
                      foreign: bool = False) -> Path:
    """Write the folder of the example. Arguments as in `idic.virtual_tests.write_example`.

    CalculiX has the Cauchy stress in the yield condition, the law of idic the Kirchhoff stress: they differ by the
    elastic dilatation, 0.6 % here.

    Raises
    ------
    InputError
        If ccx is not installed.
    """
    calculix()
    return write_volume(out, reduced, noise, seed, foreign, calculix_tension)


def calculix_tension(mesh: Mesh, elongation: np.ndarray, truth: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n_scans, n_nodes, 3) mm and force (n_scans,) N of the bar between rigid grips.

    Raises
    ------
    NotConverged
        If CalculiX gave up.
    """
    values = {name.removeprefix("BODY."): value for name, value in truth.items()}
    end = len(elongation) - 1
    text = inp_text(replace(mesh, edge_sets={}), "bar") + STEP.format(
        **values, far=FAR, far_stress=values["yield_stress"] + FAR * values["hardening_modulus"], end=end,
        step=1.0 / INCREMENTS, course="\n".join(f"{k}, {u:.9g}" for k, u in enumerate(elongation)))
    with tempfile.TemporaryDirectory(prefix="bar-") as folder:
        (Path(folder) / f"{JOB}.inp").write_text(text, encoding="ascii")
        process = subprocess.run([calculix(), "-i", JOB], cwd=folder, capture_output=True, text=True,
                                 timeout=MAX_SECONDS, check=False)
        if process.returncode != 0:
            raise NotConverged(f"CalculiX ended with exit code {process.returncode}: {process.stdout[-400:]}")
        request = ExpectedOutput(mesh.node_labels, 3, np.arange(1.0, end + 1.0), ("TOP.z",), mesh.node_sets,
                                 float(np.ptp(mesh.nodes)))
        outputs = gathered("calculix_dat", Path(folder), JOB, request)
    return outputs.u, outputs.forces["TOP.z"]
