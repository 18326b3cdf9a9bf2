"""The mechanics of the example `bulge`: a clamped elastomer membrane with a metal strip, blown up by a pressure.

Plane strain, half the cross-section. The dimensions, laws and constants are those of a published virtual bulge test
(neo-Hookean elastomer, aluminium strip with power-law hardening); pressures are chosen for a rise of 90 um.
"""

from __future__ import annotations

from dataclasses import dataclass
from string import Template

import numpy as np

from idic.fe import Direction, Loads, Mesh, Body, Section, constrain, dofs_of, march
from idic.laws import compile as compile_law
from idic_studies.examples.bulge_mesh import FULL, Columns, bulge_mesh

BULK_MODULUS_MPA = 660.0  # MPa, 100 times the elastomer's shear modulus: known, never identified
TRUTH = {
    "elastomer.C10": 3.3,
    "strip.E": 15700.0,
    "strip.yield_stress": 3.33,
    "strip.K": 338.0,
    "strip.n": 0.83,
}
FIXED = {"elastomer.kappa": BULK_MODULUS_MPA, "strip.nu": 0.35}
PRESSURE_COLUMN = "pressure_MPa"
PEAK_PRESSURE = {2.0: 0.870e-3, 5.0: 2.200e-3}  # MPa at the last frame, by thickness of the elastomer in um
REFERENCE_STRAIN = {2.0: 2e-3, 5.0: 9e-3}  # ep0: the strain at which the flow stress is known best

MATERIALS = """\
[material.elastomer]
law = "neo_hookean"
C10 = { value = $C10, unit = "MPa", identify = true }
kappa = { value = $kappa, unit = "MPa" }   # known: 1 % of kappa moves the result more than the noise

[material.strip]
law = "j2_power"                   # sigma = yield_stress + K ep^n
E = { value = $E, unit = "MPa", identify = true }
nu = $nu
yield_stress = { value = $yield_stress, unit = "MPa", identify = true }
K = { value = $K, unit = "MPa", identify = true }
n = { value = $n, identify = true }
"""

BOUNDARIES = """\
[[boundary]]                       # the axis of symmetry
nodes = "AXIS"
ux = 0.0

[[boundary]]                       # the frame that the membrane is clamped to
nodes = "CLAMP"
ux = 0.0
uy = 0.0

[[boundary]]                       # the pressure below turns with the membrane
edges = "WETTED"
pressure = { column = "pressure_MPa", follower = true }
"""


@dataclass(frozen=True)
class BulgeTest:
    """The bulge test before any image: mesh, frame times (n_frames,) s and pressures (n_frames,) MPa."""

    mesh: Mesh
    times: np.ndarray
    pressures: np.ndarray


def bulge_test(thickness_um: float = 2.0, columns: Columns = FULL, n_frames: int = 200) -> BulgeTest:
    """The test with an elastomer of 2 or 5 um: `n_frames` frames in one second after the flat reference."""
    times = np.linspace(0.0, 1.0, n_frames + 1)
    return BulgeTest(bulge_mesh(1e-3 * thickness_um, columns), times, PEAK_PRESSURE[thickness_um] * times)


def model_toml(start: float = 1.3) -> str:
    """The [material] and [[boundary]] tables of experiment.toml, identified parameters at `start` times the truth."""
    values = {name.partition(".")[2]: value for name, value in (FIXED | TRUTH).items()}
    values |= {name.partition(".")[2]: float(f"{start * value:.6g}") for name, value in TRUTH.items()}
    return f"{Template(MATERIALS).substitute(values)}\n{BOUNDARIES}"


def bulge_model(test: BulgeTest) -> Body:
    """The finite-element model of the test."""
    mesh = test.mesh
    none = np.zeros((len(test.times), 0))
    clamp, axis = mesh.node_sets["CLAMP"], mesh.node_sets["AXIS"]
    fixed_dofs = [dofs_of(axis, "x", 2), dofs_of(clamp, "x", 2), dofs_of(clamp, "y", 2)]
    return Body(
        mesh=mesh,
        kind="plane_strain",
        sections=(
            Section("elastomer", compile_law("neo_hookean", "finite"), mesh.element_sets["elastomer"]),
            Section("strip", compile_law("j2_power", "finite"), mesh.element_sets["strip"]),
        ),
        constraints=constrain([(dofs, np.zeros((len(dofs), 0)), none) for dofs in fixed_dofs], len(test.times)),
        loads=Loads(
            pressure_faces=(mesh.edge_sets["WETTED"],),
            pressure_histories=test.pressures[:, None],
        ),
    )


def law_values(values: dict[str, float], model: Body) -> dict[str, np.ndarray]:
    """Parameters per section, in the order of its law."""
    return {s.name: np.array([values[f"{s.name}.{p}"] for p in s.law.spec.parameter_names]) for s in model.sections}


def directions(model: Body, names: tuple[str, ...]) -> tuple[Direction, ...]:
    """Directions of differentiation by parameters ``SECTION.name``."""
    sections = [s.name for s in model.sections]
    of_names = []
    for name in names:
        section, _, parameter = name.partition(".")
        index = sections.index(section)
        of_names.append(Direction(name, material=(index,
                                                  model.sections[index].law.spec.parameter_names.index(parameter))))
    return tuple(of_names)


def true_displacements(test: BulgeTest) -> np.ndarray:
    """Displacements at the true parameters  # (n_frames + 1, n_nodes, 2) mm"""
    model = bulge_model(test)
    return np.array([state.u.copy() for state in march(model, law_values(FIXED | TRUTH, model), test.times)])
