"""The two-step method: a free FE-DIC of all frames, then finite-element model updating on the measured motion.

    [options]
    method = "two_step"              # displacements weighted by the matrix of the FE-DIC
    method = "two_step_unweighted"   # every node alike: plain least squares of displacements
    dic_regularisation = "none"      # auto | none | mechanical | gradient

Law, simulation, exact sensitivities, channels, steps and error bars are those of the integrated method; a frame
contributes its measured motion (`idic.correlation.measured`) in the place of its pixels. Weighted by the matrix of
an FE-DIC without regularisation, on the mesh of the simulation, the two methods agree to first order in the noise
(Mathieu et al. 2015, doi:10.1007/s11340-014-9888-9): they differ in the effect of the noise on a
free FE-DIC, which has many unknowns in every single frame.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from idic.correlation import GreyReference, MeasuredReference, mean_information
from idic.errors import InputError
from idic.measure import Regularisation, build_smoother, dic_stack, measured_nodes
from idic.model import Experiment, Options

INTEGRATED, WEIGHTED, UNWEIGHTED = "integrated", "two_step", "two_step_unweighted"
METHODS = (INTEGRATED, WEIGHTED, UNWEIGHTED)
_SAMPLED_NODES = 200


def regularisation_of(options: Options) -> Regularisation:
    """How the free FE-DIC of an experiment is regularised: "auto" is none for two steps, mechanical otherwise."""
    regularisation = options.dic_regularisation
    if regularisation == "auto":
        regularisation = "none" if options.is_two_step else "mechanical"
    return Regularisation.smooth(regularisation)


def check_method(experiment: Experiment) -> None:
    """Refuse experiments that the two-step method cannot treat.

    Raises
    ------
    InputError
        Height images; a camera or a geometry that is a degree of freedom; generalised least squares.
    """
    model = experiment.model
    if not experiment.options.is_two_step:
        return
    moved = [name for view in experiment.views for name in model.parameters.free
             if name.startswith(f"{view.recording.camera_name}.")]
    moved += [morph.name for morph in model.morphs if model.parameters[morph.name].free]
    problems = {
        "height images": experiment.recording.quantity != "grey",
        f"{', '.join(moved)} as degrees of freedom, which move the mesh over the image": bool(moved),
        'estimator = "generalised"': experiment.options.estimator == "generalised",
        f"weighting = {experiment.options.weighting!r}": experiment.options.weighting != "noise"}
    for problem, applies in problems.items():
        if applies:
            raise InputError("two steps do not go with this", file="experiment.toml", key="[options] method",
                             expected="grey images, a camera and a mesh that are known, weights by noise",
                             found=problem,
                             remedy="change that, or use the integrated method")


def measure(experiment: Experiment) -> np.ndarray:
    """The first step: nodal motion of all frames in the image  # (n_frames, n_nodes, 2) px, NaN: not measured"""
    return dic_stack(experiment, regularisation_of(experiment.options)).u_px


def measured_reference(experiment: Experiment, image: GreyReference, motion_px: np.ndarray) -> MeasuredReference:
    """The reference of the second step.

    image, motion_px : reference image and measured motion of the first step
    """
    model = experiment.model
    still = image.compare(experiment, model.reference, np.zeros((model.mesh.n_nodes, 2)))
    is_measured = measured_nodes(still.H)
    smoother = build_smoother(image.pixel_map.nodes_px, model.mesh.surface_cells(model.surface),
                              regularisation_of(experiment.options))
    penalty = sparse.csc_array(smoother.matrix(float(np.mean(image.fx**2 + image.fy**2)) / 2, ~is_measured))
    motion = np.where(is_measured[:, None], motion_px, np.nan)
    information = None
    if experiment.options.method == UNWEIGHTED:
        nodes = np.flatnonzero(is_measured)
        chosen = nodes[np.unique(np.linspace(0, len(nodes) - 1, min(_SAMPLED_NODES, len(nodes))).astype(int))]
        information = mean_information(still, penalty, chosen)
    return MeasuredReference(image, motion, information, penalty)
