"""The error of the simulated motion of a solid by its mesh, from a simulation on a finer one in a few frames.

    e(x, t) = u_finer(x, t) - u(x, t),      e_c(t) = F_c,finer(t) - F_c(t)           (docs/method.md, equation 14.8)

The field is the mean-square projection of that difference onto the shape functions of the given mesh, as the sums know
no others: what a quadratic element bulges between the nodes of a linear one counts. Both simulations take the same few
steps, so that their difference has no error of time, and no derivatives. Linear elements are computed as quadratic
ones, quadratic bricks on half their size. The field is one more column of the normal equations: what it does to the
parameters and the residual that it causes follow from the normal equations, without an image.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.errors import NotConverged
from idic.fe import Control, Mesh, can_halve, can_raise_order, quadrature_rule, shape_functions, shape_gradients
from idic.identification.finer_models.refinement import carried_local, refined
from idic.model import Experiment, ForwardModel, build_drives, build_forward
from idic.parameters import ParameterSet

MAX_NODES = 12_000  # of the finer mesh of a solid: more would cost as much as the identification

LOOSE = Control(tolerance=1e-5)  # of the forces, which the error of a mesh moves by 1e-3 and more


@dataclass(frozen=True)
class MeshError:
    """The error in some frames, linear in between, zero in the reference.

    u : per frame (n_nodes, components) mm, channels : per frame (n_channels,)
    """

    reference: int
    u: Mapping[int, np.ndarray]
    channels: Mapping[int, np.ndarray]

    def at(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Motion and channels of a frame up to the last known one."""
        after = min(k for k in self.u if k >= frame)
        before = max((k for k in self.u if k < frame), default=self.reference)
        share = (frame - before) / (after - before)
        u, channels = share * self.u[after], share * self.channels[after]
        if before in self.u:
            u, channels = u + (1.0 - share) * self.u[before], channels + (1.0 - share) * self.channels[before]
        return u, channels


def is_counted(experiment: Experiment) -> bool:
    """Whether the error of the motion is estimated: solid elements but quadratic tetrahedra, as far as the finer mesh
    is not too large. In the plane a whole step on the finer mesh is cheap
    (`idic.identification.systematic.discretisation`).
    """
    mesh = experiment.mesh
    if experiment.solver is not None or experiment.n_dim == 2 or experiment.options.weighting != "noise":
        return False
    raised = can_raise_order(mesh)
    return (raised or can_halve(mesh)) and (4 if raised else 7) * mesh.n_nodes <= MAX_NODES


def projection(mesh: Mesh, carry: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """Mean-square projection of nodal fields of a finer mesh onto the functions of the given one.

    carry : (n_fine, n_given) the given functions at the fine nodes

    Returns
    -------
    function (n_fine, k) -> (n_given, k)
    """
    values, weights = [], []
    for block in mesh.blocks:
        xi, w = quadrature_rule(block.cell)
        n, (q, nodes) = block.n_elements, shape_functions(block.cell, xi).shape
        jacobians = np.einsum("qad,eai->eqdi", shape_gradients(block.cell, xi), mesh.nodes[block.connectivity])
        weights.append((w * np.abs(np.linalg.det(jacobians))).ravel())
        columns = np.repeat(block.connectivity[:, None], q, axis=1).ravel()
        values.append(sparse.csr_array((np.tile(shape_functions(block.cell, xi).ravel(), n), columns,
                                        np.arange(0, n * q * nodes + 1, nodes)), shape=(n * q, mesh.n_nodes)))
    at_points = sparse.vstack(values, format="csr")
    given = (at_points @ carry).tocsr()
    weighed = (given.T * np.concatenate(weights)).tocsr()
    solve = splu((weighed @ given).tocsc()).solve
    return lambda field: solve(weighed @ (at_points @ field))


def mesh_error(experiment: Experiment, forward: ForwardModel, parameters: ParameterSet, local: np.ndarray,
               known: Mapping[int, np.ndarray]) -> MeshError | None:
    """The error at these parameters; None where a simulation does not converge.

    Parameters
    ----------
    local : (n_frames, m) mm
    known : (n_nodes, components) mm of the frames in which the error is wanted, the last one included: first guesses
    """
    finer = refined(experiment, raise_bricks=True)
    there = build_forward(finer.experiment)
    start = carried_local(build_drives(experiment), build_drives(finer.experiment), experiment, finer, local)
    first, dim = experiment.reference, experiment.n_dim
    frames = np.array([first, *sorted(known)])
    guesses = [np.zeros_like(experiment.mesh.nodes), *(known[int(k)][:, :dim] for k in frames[1:])]
    steps = frames - first
    try:
        coarse = replace(forward, control=LOOSE).march_at(parameters, local, steps, guesses)
        fine = replace(there, control=LOOSE).march_at(parameters, start, steps)  # carried guesses cost more: they fold
        onto_given = projection(finer.experiment.mesh, finer.carry)
        found = {first + a.frame: (onto_given(b.seen_u - finer.carry @ a.seen_u), b.channels - a.channels)
                 for a, b in zip(coarse, fine, strict=True)}
    except NotConverged:
        return None
    del found[first]
    return MeshError(first, {k: u for k, (u, _) in found.items()}, {k: own for k, (_, own) in found.items()})
