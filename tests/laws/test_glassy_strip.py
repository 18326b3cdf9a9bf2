"""A polycarbonate strip that necks: the law in hex8 elements, against an independent implementation, with its
history."""

import numpy as np
import pytest

from idic.fe import Constraints, Direction, Body, Reaction, Section, dofs_of, make_mesh, march
from idic.laws import compile, get_law

LENGTH, WIDTH, THICKNESS = 50.0, 21.0, 0.5  # mm: the right half of the specimen, 2.5 % narrower at its middle
SPEED = 0.05                                # mm/s: 1e-3/s of the length
SPEC = get_law("egp")
DEFAULTS = SPEC.defaults()
STRESSES = [0, 5, 7, 8, 9]                  # Gr, tau0, kappa, G1, eta0


def strip(nx=40, ny=4, nz=2):
    """nx x ny x nz hexahedra, nodes numbered along the thickness first."""
    x, y, z = np.meshgrid(np.linspace(0, LENGTH, nx + 1), np.linspace(-0.5, 0.5, ny + 1) * WIDTH,
                          np.linspace(0, THICKNESS, nz + 1), indexing="ij")
    nodes = np.stack([x, y * (0.975 + 0.025 * x / LENGTH), z], axis=-1).reshape(-1, 3)
    at = np.arange(len(nodes)).reshape(nx + 1, ny + 1, nz + 1)
    low = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
    cells = np.stack([c[:, :, :-1] for c in low] + [c[:, :, 1:] for c in low], axis=-1)
    return make_mesh(nodes, [("hex8", cells.reshape(-1, 8))])


def pulled(mesh, times):
    """Symmetry on the left, grips on the right (free across the thickness), no motion of the middle plane in z."""
    x, _, z = mesh.nodes.T
    right = np.flatnonzero(x == LENGTH)
    grip = dofs_of(right, "x", 3)
    held = np.concatenate([dofs_of(np.flatnonzero(x == 0), "x", 3), dofs_of(right, "y", 3),
                           dofs_of(np.flatnonzero(np.isclose(z, THICKNESS / 2)), "z", 3)])
    basis = np.concatenate([np.zeros(len(held)), np.ones(len(grip))])[:, None]
    constraints = Constraints(np.concatenate([held, grip]), basis, SPEED * times[:, None])
    return Body(mesh, "solid", (Section("strip", compile("egp"), np.arange(mesh.n_elements)),), constraints,
                 channels=(Reaction(grip),))


@pytest.mark.slow
def test_the_strip_necks_at_575_N_and_its_sensitivities_keep_the_scaling_of_stress():
    times = np.arange(201.0)
    directions = [Direction(name, material=(0, k)) for k, name in enumerate(SPEC.parameter_names)]
    model = pulled(strip(), times)
    force, gap, largest = np.empty(201), 0.0, 0.0
    for frame in march(model, {"strip": DEFAULTS}, times, directions):
        force[frame.frame] = frame.channels[0]
        terms = frame.du[..., STRESSES] * DEFAULTS[STRESSES]
        gap, largest = max(gap, np.abs(terms.sum(axis=-1)).max()), max(largest, np.abs(terms).max())
        np.testing.assert_allclose(frame.dchannels[0, STRESSES] @ DEFAULTS[STRESSES], force[frame.frame],
                                   atol=1e-4)  # N: the solver's tolerance times terms of some 100 N
    assert force.argmax() == 35
    # another implementation, with the same steps, found 575.6, 474.0 and 481.4 N
    np.testing.assert_allclose(force[[35, 120, 200]], [575.6, 474.0, 481.4], atol=0.1)
    assert largest > 1.0 and gap < 1e-6  # mm: terms of 8.7 mm cancel
