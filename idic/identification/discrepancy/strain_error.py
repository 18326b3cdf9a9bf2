"""What a law of small strains neglects: the same test under its finite form, in a few frames.

As the error of the mesh, the difference is one more column of the normal equations: what it does to the parameters
follows from them, whatever the residual shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.errors import NotConverged
from idic.identification.discrepancy.mesh_error import LOOSE, MAX_NODES, MeshError
from idic.laws import get_law
from idic.model import Experiment, ForwardModel, build_forward
from idic.parameters import ParameterSet


def with_finite_strains(experiment: Experiment) -> Experiment | None:
    """The experiment with the finite form of every law of small strains; None where there is none, or a law has no
    such form."""
    small = [material for material in experiment.materials if material.kinematics == "small"]
    if experiment.solver is not None or not small:
        return None
    if any("finite" not in get_law(material.law).kinematics for material in small):
        return None
    return replace(experiment, motion_error=None, materials=tuple(
        replace(material, kinematics="finite") for material in experiment.materials))


def strain_error(experiment: Experiment, forward: ForwardModel, parameters: ParameterSet, local: np.ndarray,
                 known: Mapping[int, np.ndarray]) -> MeshError | None:
    """Motion and channels under finite strains less those under small ones, in some frames; None where a law has no
    finite form, the model is large, or a simulation does not converge.

    local, known : as for `mesh_error`
    """
    finite = with_finite_strains(experiment) if experiment.mesh.n_nodes <= MAX_NODES else None
    if finite is None or not known:
        return None
    first = experiment.reference
    frames = np.array([first, *sorted(known)])
    steps, u = frames - first, [np.zeros_like(experiment.mesh.nodes),
                                *(known[int(k)][:, :experiment.n_dim] for k in frames[1:])]
    try:
        small, large = (replace(one, control=LOOSE).march_at(parameters, local, steps, u)
                        for one in (forward, build_forward(finite)))
        found = {first + a.frame: (b.seen_u - a.seen_u, b.channels - a.channels)
                 for a, b in zip(small, large, strict=True)}
    except NotConverged:
        return None
    del found[first]
    return MeshError(first, {k: u for k, (u, _) in found.items()}, {k: own for k, (_, own) in found.items()})
