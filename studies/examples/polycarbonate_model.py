"""The mechanics of the example `polycarbonate`: half the length and half the thickness of a strip that necks.

Dimensions, law and constants are those of a published virtual tension test (Neggers et al. 2015, section 3); the taper,
the grips (no motion across, free in thickness) and one element through half the thickness are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from string import Template

import numpy as np

from idic.fe import Direction, Mesh, Body, Reaction, Section, constrain, dofs_of, make_mesh, march
from idic.laws import compile as compile_law

HALF_LENGTH, WIDTH, HALF_THICKNESS = 50.0, 21.0, 0.25  # mm
TAPER_SHARE = 0.025  # so much narrower in the middle, linear to the grips
GRIP_SPEED_MM_PER_S = 0.05  # mm/s of the grip: 1e-3/s of the half length
DURATION_S = 200.0  # s
TRUTH = {
    "strip.Gr": 26.0, "strip.Sa": 27.0, "strip.r0": 0.965, "strip.r1": 50.0, "strip.r2": -3.0, "strip.tau0": 0.7,
    "strip.mu": 0.08, "strip.kappa": 3750.0, "strip.G1": 634.0, "strip.eta0": 1.47e11,
}  # fmt: skip
START_FACTOR = 1.1

MODEL = """\
[material.strip]                   # Eindhoven Glassy Polymer, one Maxwell mode
law = "egp"
Gr = { value = $Gr, unit = "MPa", identify = true }
Sa = { value = $Sa, identify = true }
r0 = { value = $r0, identify = true }
r1 = { value = $r1, identify = true }
r2 = { value = $r2, identify = true }
tau0 = { value = $tau0, unit = "MPa", identify = true }
mu = { value = $mu, identify = true }
kappa = { value = $kappa, unit = "MPa", identify = true }
G1 = { value = $G1, unit = "MPa", identify = true }
eta0 = { value = $eta0, identify = true }   # MPa s

[[boundary]]                       # planes of symmetry: half the length, half the thickness
nodes = "MIDDLE"
ux = 0.0
[[boundary]]
nodes = "MIDPLANE"
uz = 0.0

[[boundary]]                       # the moving grip
nodes = "GRIP"
ux = { column = "grip_displacement_mm" }
uy = 0.0

[[channel]]
column = "force_N"
simulated = { reaction = "GRIP", component = "x", factor = 2.0 }   # half the thickness is modelled
noise_std = $force_noise
"""


@dataclass(frozen=True)
class Divisions:
    """Elements along, across and through half the thickness."""

    along: int
    across: int
    through: int = 1

    def finer(self, factor: float) -> Divisions:
        """So many times as many along and across."""
        return Divisions(round(factor * self.along), round(factor * self.across), self.through)


FULL_MESH = Divisions(120, 12)  # 1440 hex8, 3146 nodes: at half thickness equivalent to two layers at full thickness
REDUCED_MESH = Divisions(40, 4)


@dataclass(frozen=True)
class Pulled:
    """The simulated test: times (n_frames,) s, grip (n_frames,) mm, u (n_frames, n_nodes, 3) mm, force (n_frames,) N.

    steps : number of increments taken
    """

    times: np.ndarray
    grip: np.ndarray
    u: np.ndarray
    force: np.ndarray
    steps: int


def strip_mesh(n: Divisions) -> Mesh:
    """hex8 elements, numbered across the thickness first, then across the width: a narrow band.

    Node sets MIDDLE (x = 0), GRIP (x = 50 mm), MIDPLANE (z = 0); face set FRONT (z = 0.25 mm); element set ``strip``.
    """
    x, y, z = np.meshgrid(np.linspace(0, HALF_LENGTH, n.along + 1), np.linspace(-0.5, 0.5, n.across + 1) * WIDTH,
                          np.linspace(0, HALF_THICKNESS, n.through + 1), indexing="ij")
    nodes = np.stack([x, y * (1.0 - TAPER_SHARE * (1.0 - x / HALF_LENGTH)), z], axis=-1).reshape(-1, 3)
    at = np.arange(len(nodes)).reshape(x.shape)
    low = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
    cells = np.stack([c[..., :-1] for c in low] + [c[..., 1:] for c in low], axis=-1).reshape(-1, 8)
    sets = {"MIDDLE": np.flatnonzero(nodes[:, 0] == 0.0), "GRIP": np.flatnonzero(nodes[:, 0] == HALF_LENGTH),
            "MIDPLANE": np.flatnonzero(nodes[:, 2] == 0.0)}
    bare = make_mesh(nodes, [("hex8", cells)])
    front = np.array([f for f in bare.boundary_faces() if np.all(nodes[bare.face_nodes(f), 2] == HALF_THICKNESS)])
    return make_mesh(nodes, [("hex8", cells)], node_sets=sets, element_sets={"strip": np.arange(len(cells))},
                     edge_sets={"FRONT": front})


def strip_model(mesh: Mesh, times: np.ndarray, law: str = "egp") -> Body:
    """The finite-element model of the test at these frame times (n_frames,) s."""
    sets = mesh.node_sets
    none = np.zeros((len(times), 0))
    fixed_dofs = [dofs_of(sets["MIDDLE"], "x", 3), dofs_of(sets["MIDPLANE"], "z", 3), dofs_of(sets["GRIP"], "y", 3)]
    pulled = dofs_of(sets["GRIP"], "x", 3)
    rows = [(dofs, np.zeros((len(dofs), 0)), none) for dofs in fixed_dofs]
    rows.append((pulled, np.ones((len(pulled), 1)), GRIP_SPEED_MM_PER_S * times[:, None]))
    return Body(mesh, "solid", (Section("strip", compile_law(law, "finite"), mesh.element_sets["strip"]),),
                 constrain(rows, len(times)), channels=(Reaction(pulled, 2.0),))


def directions(model: Body) -> tuple[Direction, ...]:
    """Derivatives by every parameter of the law."""
    names = model.sections[0].law.spec.parameter_names
    return tuple(Direction(name, material=(0, k)) for k, name in enumerate(names))


def pull(mesh: Mesh, n_frames: int, substeps: int = 1, values: np.ndarray | None = None) -> Pulled:
    """Pull the strip in `n_frames` frames after the reference; `values` (10,) instead of the true parameters."""
    times = np.linspace(0.0, DURATION_S, n_frames + 1)
    values = np.array(list(TRUTH.values())) if values is None else values
    states = [(s.u.copy(), s.channels[0], s.steps) for s in march(strip_model(mesh, times), {"strip": values}, times,
                                                                  substeps=substeps)]
    return Pulled(times, GRIP_SPEED_MM_PER_S * times, np.array([u for u, *_ in states]),
                  np.array([f for _, f, _ in states]),
                  len(states[-1][2].times))


def model_toml(force_noise: float, factor: float = START_FACTOR) -> str:
    """The [material], [[boundary]], [[channel]] tables of experiment.toml, parameters at `factor` times the truth."""
    values = {name.partition(".")[2]: f"{factor * value:.6g}" for name, value in TRUTH.items()}
    return Template(MODEL).substitute(values, force_noise=force_noise)
