"""The whole identification with CalculiX in place of the built-in solver, on the public plate with a hole.

A quarter of an hour on one core: every evaluated point takes six simulations of half a minute to a minute.
"""

from __future__ import annotations

import shutil

import pytest

from idic import identify
from idic.fe import PERMISSION

CASE = "open-case-1-plate-with-hole-elastoplastic"
SOLVER = """
[solver]
kind = "external"
template = "plate.inp.template"
mesh = "mesh.inp"
element_types = { quad8 = "CPS8R" }
command = ["ccx", "-i", "{job}"]
reader = "calculix_dat"
timeout_s = 3600
environment = { OMP_NUM_THREADS = "1" }
"""
FLOW = "(SPECIMEN.yield_stress + {p} * SPECIMEN.hardening_modulus)"  # Kirchhoff stress at plastic strain p
CAUCHY = "{{{flow} / (1 + (1 - 2 * SPECIMEN.nu) * {flow} / SPECIMEN.E)}}, {p}"
DECK = """*INCLUDE, INPUT=mesh.inp
*MATERIAL, NAME=ALUMINIUM
*ELASTIC
{SPECIMEN.E}, {SPECIMEN.nu}
*PLASTIC
FLOW
*SOLID SECTION, ELSET=SPECIMEN, MATERIAL=ALUMINIUM
{geometry.thickness / 100}
*BOUNDARY
LEFT, 1, 2
RIGHT, 2, 2
*AMPLITUDE, NAME=GRIP
{TABLE.boundary.RIGHT.x}
*TIME POINTS, NAME=FRAMES
{TIME.points}
*STEP, NLGEOM, INC=10000
*STATIC
{TIME.end / TIME.frames}, {TIME.end}, 1e-6, {TIME.end / TIME.frames}
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""
STRAINS = (0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.5)
OPTIONS = {"options.estimator": "ordinary", "options.element_order": "quadratic"}
OFF = {"E": 1.01, "nu": 0.99, "yield_stress": 1.01, "hardening_modulus": 0.98}  # where the second one starts
AGREEMENT = 0.003  # less than any start is off: all four have moved, in one iteration or several


def with_calculix(folder):
    """The same experiment, simulated by CalculiX in a hundredth of the thickness (docs/external-solver.md)."""
    file = folder / "experiment.toml"
    text, force = file.read_text(), 'component = "x" }'
    assert text.count(force) == 1
    file.write_text(text.replace(force, 'component = "x", factor = 100 }') + SOLVER)
    lines = [CAUCHY.format(flow=FLOW.format(p=p), p=p) for p in STRAINS]
    (folder / "plate.inp.template").write_text(DECK.replace("FLOW", "\n".join(lines)))
    return folder


@pytest.mark.slow
def test_calculix_and_the_built_in_solver_identify_the_same_parameters(tmp_path, ccx, shared_data, monkeypatch):
    """Elements, mesh, images, estimator and law are the same; each solver's own end is where its own steps end."""
    monkeypatch.setenv(PERMISSION, ccx)
    for name in ("own", "theirs"):
        shutil.copytree(shared_data(CASE), tmp_path / name, copy_function=shutil.copyfile)
        (tmp_path / name).chmod(0o755)
    own = identify(tmp_path / "own", tmp_path / "run-own", overrides=OPTIONS | {"options.substeps": 1})
    assert own["status"] == "converged"
    start = {f"material.SPECIMEN.{name}.value": own["parameters"][f"SPECIMEN.{name}"]["value"] * off
             for name, off in OFF.items()}
    theirs = identify(with_calculix(tmp_path / "theirs"), tmp_path / "run-theirs", overrides=OPTIONS | start)
    assert theirs["status"] == "converged"
    for name in OFF:
        ratio = theirs["parameters"][f"SPECIMEN.{name}"]["value"] / own["parameters"][f"SPECIMEN.{name}"]["value"]
        assert abs(ratio - 1.0) < AGREEMENT, (name, ratio)
