"""Elastoplastic solids in tension by CalculiX (C3D20R): the foreign truth of tests before cameras with a lens."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "external"))
from test_material_cards import pulled_by_calculix  # noqa: E402

from idic.fe import Mesh, ExpectedOutput, gathered, inp_text  # noqa: E402
from idic.laws import compile, point  # noqa: E402

DECK = """*MATERIAL, NAME=M
*ELASTIC
{E}, {nu}
*PLASTIC
{yield_stress}, 0
{far}, 2
*SOLID SECTION, ELSET=BODY, MATERIAL=M
*BOUNDARY
{held}
*AMPLITUDE, NAME=GRIP
{grip}
*TIME POINTS, NAME=FRAMES, GENERATE
1, {end}, 1
*STEP, NLGEOM, INC=10000
*STATIC
{step}, {end}, 1e-6, {step}
*BOUNDARY, AMPLITUDE=GRIP
RIGHT, 1, 1, 1
*NODE PRINT, NSET=ALL, TIME POINTS=FRAMES
U
*NODE PRINT, NSET=RIGHT, TOTALS=ONLY, TIME POINTS=FRAMES
RF
*END STEP
"""


def pulled(folder: Path, mesh: Mesh, values: dict[str, float], grip: np.ndarray, held: Sequence[str],
           increments: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Motion (n_frames, n_nodes, 3) mm and force (n_frames,) N of RIGHT, whose x follows `grip` (n_frames,) mm.

    values : E, nu, yield_stress, hardening_modulus, MPa; held : lines of *BOUNDARY; increments : at least, per frame
    """
    v = values
    (folder / "body.inp").write_text(inp_text(replace(mesh, edge_sets={}), "body") + DECK.format(
        E=v["E"], nu=v["nu"], yield_stress=v["yield_stress"], far=v["yield_stress"] + 2.0 * v["hardening_modulus"],
        held="\n".join(held), grip="\n".join(f"{k}, {x:.9g}" for k, x in enumerate(grip)), end=len(grip) - 1,
        step=1.0 / increments))
    done = subprocess.run(["ccx", "-i", "body"], cwd=folder, capture_output=True, text=True, timeout=1800, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    wanted = ExpectedOutput(mesh.node_labels, 3, np.arange(1.0, len(grip)), ("RIGHT.x",), mesh.node_sets,
                    float(np.ptp(mesh.nodes)))
    found = gathered("calculix_dat", folder, "body", wanted)
    return found.u, found.forces["RIGHT.x"]


def as_the_law_sees_it(folder: Path, values: dict[str, float], strain: float) -> dict[str, float]:
    """The parameters with which idic's law follows one element of CalculiX best, up to a nominal strain.

    idic has the Kirchhoff stress in the yield condition, CalculiX the Cauchy stress: they differ by the elastic
    dilatation, 0.15 % at 250 MPa.
    """
    law = compile("j2_linear", "finite")
    found = np.array([values[name] for name in law.spec.parameter_names])
    card = (f"*MATERIAL, NAME=M\n*ELASTIC\n{values['E']}, {values['nu']}\n*PLASTIC\n{values['yield_stress']}, 0\n"
            f"{values['yield_stress'] + 2.0 * values['hardening_modulus']}, 2\n")
    course = np.concatenate([np.linspace(0.0, 0.01, 21), np.linspace(0.01, strain, 41)[1:]])
    theirs = pulled_by_calculix(folder, card, course)
    free = [law.spec.parameter_names.index(name) for name in ("E", "yield_stress", "hardening_modulus")]
    for _ in range(5):  # Gauss and Newton
        curve = point.uniaxial(law, found, course)
        slopes = curve.dP[1:, free, 0, 0] * found[free]
        found[free] *= 1.0 + np.linalg.lstsq(slopes, theirs - curve.P[1:, 0, 0], rcond=None)[0]
    return dict(zip(law.spec.parameter_names, found.tolist(), strict=True))


def with_surfaces(mesh: Mesh, front: np.ndarray, **sets: np.ndarray) -> Mesh:
    """The mesh with node sets, element set BODY, and the faces FRONT, all of whose nodes are in `front`, and REST."""
    faces = mesh.boundary_faces()
    seen = np.array([np.isin(mesh.face_nodes(face), front).all() for face in faces])
    return replace(mesh, node_sets=sets, element_sets={"BODY": np.arange(mesh.n_elements)},
                   edge_sets={"FRONT": faces[seen], "REST": faces[~seen]})
