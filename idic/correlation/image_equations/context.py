"""Input of the equations of a frame: its simulated motion, and the data common to all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation.image_equations.comparison import Reference
from idic.correlation.image_equations.equations import Weights
from idic.fe import FrameState
from idic.images import AnyCamera
from idic.model import Experiment
from idic.parameters import ParameterSet


@dataclass(frozen=True)
class FrameResponse:
    """The simulated motion of one frame and its derivatives by the degrees of freedom that move the simulation.

    u : (n_nodes, dim) mm; channels : (n_channels,); du : (n_nodes, dim, n_moving); dchannels : (n_channels, n_moving);
    local_du : (n_nodes, dim, m) influence of the frame-local unknowns; local_dchannels : (n_channels, m).
    """

    frame: int
    u: np.ndarray
    channels: np.ndarray
    du: np.ndarray
    dchannels: np.ndarray
    local_du: np.ndarray
    local_dchannels: np.ndarray

    @classmethod
    def of(cls, state: FrameState, reference: int) -> FrameResponse:
        """What the correlation needs of a simulated frame; reference : number of the first simulated frame."""
        return cls(state.frame + reference, state.seen_u.copy(), state.channels.copy(), state.seen_du.copy(),
                   state.dchannels.copy(), state.seen_local_du.copy(), state.local_dchannels.copy())


@dataclass(frozen=True)
class CorrelationContext:
    """Data of one camera common to all frames at one set of parameters.

    experiment : with the mesh of these parameters (`Experiment.at_geometry`); names : every free degree of freedom;
    moving : those with columns in `FrameResponse.du`; local_precision : (m, m) prior of the frame-local unknowns
    (logged noise, or smoothness of a measured edge), whose mean is zero; others : the same for the further cameras;
    local_scatter : (m, m) the logged noise alone, None where that is all of it.
    """

    experiment: Experiment
    parameters: ParameterSet
    names: tuple[str, ...]
    moving: tuple[str, ...]
    camera: AnyCamera
    reference: Reference
    weights: Weights
    local_precision: np.ndarray
    others: tuple[CorrelationContext, ...] = ()
    local_scatter: np.ndarray | None = None

    @property
    def cameras(self) -> tuple[CorrelationContext, ...]:
        """One context per camera, the main camera first."""
        return (self, *self.others)
