"""Warnings of `idic check` on cameras with a lens: free poses, lenses and positions that the test does not
determine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from idic.correlation import determined_by_texture
from idic.errors import InputError, NotConverged
from idic.fe import followed, normal_axis, seen_first
from idic.images import PLACEMENT_STEM, PlacedCamera
from idic.model import Experiment, Measured, Model, Noise, Remedies

N_FRAMES = 6  # that are compared; all are simulated
LONGEST_S = 1200.0  # of an identification, of which the simulation here is a tenth
ASSUMED_NOISE_GV = 2.0  # where it is not known yet
MIN_CORRELATION = 0.99  # of two degrees of freedom that are determined, but hardly apart


def rig_warnings(experiment: Experiment, time_s: float) -> Iterator[str]:
    """Warnings; time_s : expected of the identification.

    The spectrum is that of `idic.identification.design` at the start values, in one simulation: the same directions
    that the identification would leave out in the end.
    """
    yield from _held_thickness(experiment.model)
    compared = [camera for camera in experiment.cameras if camera.texture is not None]
    if compared and not determined_by_texture(experiment, experiment.model.parameters.free):
        names = ", ".join(camera.name for camera in compared)
        yield (f"texture of {names} changes nothing: no lens, pose, placement or shape is free: "
               + Remedies(experiment).possible("set identify_calibration", "give [[dof]] such as placement.t_z"))
    stems = {PLACEMENT_STEM, *(view.recording.camera_name for view in experiment.views
                               if isinstance(view.model.camera, PlacedCamera))}
    rig_parameters = [name for name in experiment.model.parameters.free if name.partition(".")[0] in stems]
    if len(stems) == 1 or not rig_parameters:
        return
    if time_s > LONGEST_S:
        yield (f"whether {', '.join(rig_parameters)} can be separated is not checked here, because it takes minutes: "
               "idic design reports it")
        return
    from idic.identification import Design  # a fifth of the start of a check, where no rig is to be judged

    try:
        summary = Design.of("check", _thinned(experiment)).full.summary()
    except (InputError, NotConverged) as problem:
        yield f"whether {', '.join(rig_parameters)} can be separated is not known before the run: {problem}"
        return
    for entry in summary["not_identifiable"]:
        yield f"{entry['name']} will not be identified: it {_sentence(entry['reason'])}; hold it, or give it a prior"
    names, matrix = summary["correlation"]["names"], np.array(summary["correlation"]["matrix"])
    for i, first in enumerate(names):
        for j, second in enumerate(names[:i]):
            if (first in rig_parameters or second in rig_parameters) and abs(matrix[i, j]) > MIN_CORRELATION:
                yield (f"{second} and {first} are hardly separated (correlation {matrix[i, j]:.3f}): error bars will "
                       "be large")


def _sentence(reason: str) -> str:
    return reason.removeprefix("it ")


def _thinned(experiment: Experiment) -> Experiment:
    """The experiment with few frames to compare, and a noise where none is known."""
    model, recording = experiment.model, experiment.recording
    counted = [k for k in range(model.reference + 1, model.n_frames) if k not in recording.excluded]
    frames = {counted[i] for i in np.linspace(0, len(counted) - 1, min(N_FRAMES, len(counted))).astype(int)}
    noise = Noise(ASSUMED_NOISE_GV, "assumed")
    return replace(experiment, recording=replace(recording, excluded=tuple(k for k in range(model.reference + 1,
                                                                                            model.n_frames)
                                                                           if k not in frames), noise=noise
                                                 if recording.noise.std_gv is None else recording.noise),
                   cameras=tuple(replace(camera, noise=noise) if camera.noise.std_gv is None else camera
                      for camera in experiment.cameras))


def _held_thickness(model: Model) -> Iterator[str]:
    """Measured edges whose visible surface does not determine the motion through the thickness."""
    mesh, surface = model.mesh, model.surface
    if mesh.n_dim == 2 or surface is None or normal_axis(mesh, surface) is not None:
        return
    for name in dict.fromkeys(entry.nodes for entry in model.prescribed if isinstance(entry.drive, Measured)):
        nodes = model.node_set(name)
        leaders = seen_first(mesh, surface, nodes)
        if len(leaders) and followed(mesh.nodes[nodes], leaders)[1].size:
            yield (f"measured edge {name}: its hidden nodes follow the seen ones across the thickness as well, which "
                   "fixes the thickness there; in a mesh whose seen surface is normal to an axis it is free")
