"""The change of thickness of a sheet in plane stress against a solid of CalculiX: a plate with a hole that yields."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from fe.fe_bodies import body, dofs_of, grid, held, where
from scipy.spatial import cKDTree

from idic.fe import Reaction, inp_text, march
from idic.fe import read_calculix_dat

pytestmark = pytest.mark.slow

RADIUS, WIDE, LONG, THICKNESS = 3.0, 10.0, 14.0, 2.0  # mm; half sizes of the plate
E, NU, YIELD, HARDENING = 70e3, 0.3, 200.0, 1500.0  # MPa
STRETCH, STAGES = 0.004 * LONG, 4

MATERIAL = f"""*MATERIAL, NAME=M
*ELASTIC
{E}, {NU}
*PLASTIC
{YIELD}, 0
{YIELD + HARDENING}, 1
*SOLID SECTION, ELSET=BODY, MATERIAL=M
*BOUNDARY
X0, 1, 1
Y0, 2, 2
Z0, 3, 3
TOP, 1, 1
"""
STAGE = """*STEP, NLGEOM, INC=100
*STATIC
0.5, 1., 1e-3, 0.5
*BOUNDARY
TOP, 2, 2, {:.12g}
*NODE PRINT, NSET=ALL
U
*NODE PRINT, NSET=TOP, TOTALS=ONLY
RF
*END STEP
"""


def quarter(x: np.ndarray) -> np.ndarray:
    """Places of a quarter of the plate for (outwards, around[, through]) from 0 to 1."""
    out, around = x[:, 0] ** 1.5, x[:, 1]  # finer at the hole
    corner = np.minimum(2.0 * around, 1.0), np.minimum(2.0 - 2.0 * around, 1.0)
    edge = np.column_stack([WIDE * corner[1], LONG * corner[0]])
    rim = RADIUS * np.column_stack([np.cos(0.5 * np.pi * around), np.sin(0.5 * np.pi * around)])
    return np.column_stack([rim + out[:, None] * (edge - rim), 0.5 * THICKNESS * x[:, 2:]])


def sides(mesh) -> dict[str, np.ndarray]:
    return {name: where(mesh, lambda x, *_, axis=axis, at=at: np.abs(mesh.nodes[:, axis] - at) < 1e-9)
            for name, axis, at in (("X0", 0, 0.0), ("Y0", 1, 0.0), ("TOP", 1, LONG), ("Z0", mesh.n_dim - 1, 0.0))}


@pytest.fixture(scope="module")
def solid(ccx, tmp_path_factory):
    """Places of the nodes of the seen side, their motion at the last stage, and the forces on the end."""
    folder = tmp_path_factory.mktemp("solid")
    mesh = grid("hex20", (8, 14, 2), mapping=quarter)
    named = replace(mesh, node_sets=sides(mesh), element_sets={"BODY": np.arange(mesh.n_elements)})
    steps = "".join(STAGE.format(STRETCH * (k + 1) / STAGES) for k in range(STAGES))
    (folder / "plate.inp").write_text(inp_text(named, "plate") + MATERIAL + steps)
    subprocess.run([ccx, "-i", "plate"], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=500)
    records = read_calculix_dat(folder, "plate")
    seen = np.abs(mesh.nodes[:, 2] - 0.5 * THICKNESS) < 1e-9
    ends = [next(t for t in records.motions if abs(t - k) < 1e-6) for k in range(1, STAGES + 1)]
    motions = [records.motions[t][1][np.argsort(records.motions[t][0])][seen] for t in ends]
    return mesh.nodes[seen], np.array(motions), np.array([records.forces[t]["TOP.y"] for t in ends])


@pytest.fixture(scope="module")
def sheet():
    """The same of the model in plane stress, on another mesh."""
    mesh = grid("quad8", (16, 28), mapping=quarter)
    ends = sides(mesh)
    course = STRETCH * np.arange(STAGES + 1) / STAGES
    parts = [(ends["X0"], "x", 0.0), (ends["Y0"], "y", 0.0), (ends["TOP"], "x", 0.0), (ends["TOP"], "y", course)]
    model = body(mesh, "plane_stress", "j2_linear", "finite", held(mesh, parts, STAGES + 1), thickness=THICKNESS,
                 surface_side=1, channels=(Reaction(dofs_of(ends["TOP"], "y", 2)),))
    times = np.arange(STAGES + 1.0)
    frames = list(march(model, {"BODY": np.array([E, NU, YIELD, HARDENING])}, times))[-STAGES:]
    return mesh.nodes, np.array([frame.seen_u for frame in frames]), np.array([f.channels[0] for f in frames])


def relative_errors(solid, sheet, stage: int) -> tuple[float, float, float]:
    """Error of the rise of the seen side, rms over that of the solid: at the rim, within a thickness of the hole, and
    beyond, where the clamps are a thickness away."""
    at, theirs, _ = solid
    nodes, ours, _ = sheet
    far, near = cKDTree(nodes).query(at[:, :2])
    assert far.max() < 1e-9
    z, off = theirs[stage][:, 2], (ours[stage, near] - theirs[stage])[:, 2]
    beside = np.hypot(*at[:, :2].T) - RADIUS
    parts = (beside < 1e-6, (beside > 1e-6) & (beside < THICKNESS),
             (beside > THICKNESS) & (at[:, 1] < LONG - THICKNESS))
    return tuple(float(np.sqrt((off[part] ** 2).mean() / (z[part] ** 2).mean())) for part in parts)


def test_the_elastic_change_of_thickness_is_that_of_a_solid_but_for_the_rim(solid, sheet):
    """At the rim a solid of finite thickness is between plane stress and plane strain; a thickness away it is not."""
    rim, near, beyond = relative_errors(solid, sheet, 0)
    assert beyond < 0.01 and near < 0.025 and 0.03 < rim < 0.1
    (_, _, theirs), (_, _, ours) = solid, sheet
    np.testing.assert_allclose(ours, 2.0 * theirs, rtol=5e-3)  # the solid is the half above the mid-plane


def test_where_the_ligament_yields_plane_stress_is_a_tenth_off(solid, sheet):
    """Yielding gathers in bands as wide as the sheet is thick, which plane stress makes sharper than a solid does."""
    rim, near, beyond = relative_errors(solid, sheet, STAGES - 1)
    assert max(rim, near, beyond) < 0.15
