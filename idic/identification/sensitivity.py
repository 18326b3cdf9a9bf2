"""How sensitivities are computed: direct differentiation of the simulation, or one perturbed simulation per
parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from idic.errors import InputError
from idic.model import Experiment, Model, is_camera_time

DIRECT, PERTURBED, AUTO = "direct", "perturbed", "auto"
DIRECT_SHARE = 0.12  # extra cost of one directly differentiated parameter in forward runs (studies/bench measures it)


def choose_sensitivity(choice: str, n_moving: int, workers: int, n_shape: int = 0,
                       has_camera_time: bool = False) -> str:
    """Choose "direct" or "perturbed" by their cost.

    Direct differentiation takes 1 + 0.12 n forward runs one after the other; n + 1 perturbed runs fill the workers.

    Parameters
    ----------
    choice : "direct", "perturbed" or "auto"
    n_moving : number of parameters that change the simulation
    n_shape : how many of them move nodes of the mesh: they take a run each either way
    has_camera_time : whether one is the time offset of a camera: its derivative is the velocity
    """
    if choice != AUTO:
        return choice
    if has_camera_time:
        return DIRECT
    perturbed = math.ceil((n_moving + 1) / max(workers, 1))
    direct = 1.0 + n_shape + DIRECT_SHARE * (n_moving - n_shape)
    return DIRECT if direct <= perturbed else PERTURBED


def checked_sensitivity(choice: str, model: Model) -> str:
    """`choice`; an external solver allows perturbed runs only, the time offset of a camera direct ones.

    Raises
    ------
    InputError
        Direct differentiation with an external solver, perturbed runs with a time offset of a camera.
    """
    if choice == PERTURBED and any(map(is_camera_time, model.parameters.free)):
        raise InputError("perturbed runs do not see the time offset of a camera", file="experiment.toml",
                         key="--sensitivity", expected="direct (or auto)", found=choice,
                         remedy="leave --sensitivity out")
    if model.solver is None:
        return choice
    if choice == DIRECT:
        raise InputError("an external solver gives no derivatives", file=model.solver.experiment_file,
                         key="--sensitivity", expected="perturbed (or auto)", found="direct",
                         remedy="leave --sensitivity out: idic makes one perturbed run per parameter")
    return PERTURBED


def perturbations(experiment: Experiment, sensitivity: str, values: Mapping[str, float],
                  moving: Iterable[str]) -> dict[str, float]:
    """Change of each moving parameter in its perturbed run (internal units); empty with direct differentiation."""
    if sensitivity == DIRECT:
        return {}
    parameters = experiment.model.parameters.with_values(values)
    return {name: parameters[name].perturbation(experiment.options.perturbation) for name in moving}
