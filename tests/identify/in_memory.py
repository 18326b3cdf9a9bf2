"""The identification loop without files: the same records and functions as `idic.edge`, for many small runs."""

from __future__ import annotations

import numpy as np

from idic.correlation.rows import (CorrelationContext, FrameResponse, build_reference, camera_at, correlated_frames,
                                   frame_system, reference_gram)
from idic.correlation.system import Weights, reduce_systems
from idic.edge.prepare import gradient_noise_share
from idic.forward import build_forward
from idic.identify.loop import Evaluation, advance, start
from idic.identify.result import build_result


def identify_in_memory(experiment):
    """Identify an experiment with known noise and direct sensitivities  # status, parameters of the result"""
    forward = build_forward(experiment)
    names = experiment.parameters.free
    moving = tuple(name for name in names if forward.moves(name))
    seen = experiment.noise.std_gv * np.sqrt(gradient_noise_share(experiment))
    noises = np.array([channel.noise_std for channel in experiment.channels])
    weights = Weights(1.0 / (2.0 * seen**2), seen, noises**-2.0, noises)
    reference = build_reference(experiment, experiment.camera)
    local = np.zeros((experiment.n_frames, forward.drives.n_local))
    state, accepted, accepted_local = start(experiment), None, local
    while state.running:
        parameters = experiment.parameters.with_values(state.trial)
        context = CorrelationContext(experiment, parameters, names, moving, camera_at(experiment, parameters),
                                     reference, weights, forward.drives.local_precision)
        frames = correlated_frames(experiment, range(experiment.n_frames))
        systems = []
        for s in forward.march(parameters, moving, local, influence=forward.drives.n_local > 0):
            if s.frame + experiment.reference in frames:
                response = FrameResponse(s.frame + experiment.reference, s.u, s.channels, s.du, s.dchannels, s.local_du,
                                         s.local_dchannels)
                systems.append(frame_system(context, response, local[response.frame]))
        system = reduce_systems(systems)
        evaluated = Evaluation(state.evaluations, system, reference_gram(context, system.shared))
        state, _ = advance(state, experiment, evaluated, accepted, seen)
        if state.accepted_evaluation == evaluated.number:
            accepted, accepted_local = evaluated, local
        local = accepted_local.copy()
        change = np.array([state.trial[name] - state.accepted[name] for name in names])
        for record in accepted.system.frames:
            local[record.frame] += record.local_step + record.local_slope @ change
    result = build_result(experiment, state, accepted, seen, {}, [], {"forward_runs": state.evaluations})
    return state.status, result["parameters"]
