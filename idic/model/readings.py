"""What the channels read in a simulated frame: reactions, mean displacements of node sets, loads.

Reactions come from the solver; the others are linear in the nodal motion or follow from the load histories.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.fe.march import FrameState
from idic.model.drives import COMPONENTS, set_nodes
from idic.model.experiment import Channel, Experiment
from idic.model.loads import LoadHistories


@dataclass(frozen=True)
class Readings:
    """Rows of the channels that are no reactions.

    motion : (n_channels, n_dof) mean displacement of a set (less that of another) from nodal values; load :
    (n_channels, n_loads) the load that a channel reads.
    """

    motion: np.ndarray
    load: np.ndarray

    def of(self, state: FrameState, values: np.ndarray, derivatives: np.ndarray, local: np.ndarray) -> FrameState:
        """The state with all channels filled in.

        values (n_loads,), derivatives (n_loads, nd), local (n_loads, m): the loads of this frame and how they change
        along the directions and with the frame-local unknowns.
        """
        flat = lambda field: field.reshape(self.motion.shape[1], -1)  # noqa: E731  (n_dof, ...)
        return replace(
            state, channels=state.channels + self.motion @ state.u.ravel() + self.load @ values,
            dchannels=state.dchannels + self.motion @ flat(state.du) + self.load @ derivatives,
            local_dchannels=state.local_dchannels + self.motion @ flat(state.local_du) + self.load @ local)


def build_readings(experiment: Experiment, loads: LoadHistories) -> Readings | None:
    """The rows of an experiment's channels; None where all of them are reactions."""
    channels, n_dim = experiment.channels, experiment.n_dim
    if all(channel.kind == "reaction" for channel in channels):
        return None
    motion, load = np.zeros((len(channels), experiment.mesh.nodes.size)), np.zeros((len(channels), len(loads.stems)))
    for row, channel in enumerate(channels):
        if channel.kind == "displacement":
            for name, sign in ((channel.nodes, 1.0), (channel.minus, -1.0)):
                if name is not None:
                    nodes = set_nodes(experiment, name)
                    dofs = nodes * n_dim + COMPONENTS.index(channel.component)
                    motion[row, dofs] += sign * channel.factor / len(nodes)
        elif channel.kind == "pressure":
            load[row, read_load(channel, loads)] = channel.factor
    return Readings(motion, load)


def read_load(channel: Channel, loads: LoadHistories) -> int:
    """The pressure that a channel reads."""
    return loads.stems.index(f"boundary.{channel.nodes}.pressure")
