"""What the channels read in a simulated frame: reactions, mean displacements of node sets, loads.

Reactions come from the solver; the others are linear in the nodal motion or follow from the load histories.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.fe import FrameState, PathControl
from idic.model.drives import COMPONENTS, DriveTable
from idic.model.records.model import Model
from idic.model.records.parts import Channel, Controlled
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


def build_readings(model: Model, loads: LoadHistories) -> Readings | None:
    """The rows of an experiment's channels; None where all of them are reactions."""
    channels = model.channels
    if all(channel.kind == "reaction" for channel in channels):
        return None
    motion, load = np.zeros((len(channels), model.mesh.nodes.size)), np.zeros((len(channels), len(loads.stems)))
    for row, channel in enumerate(channels):
        if channel.kind == "displacement":
            motion[row] = channel.factor * _mean_displacement(model, channel)
        elif channel.kind == "pressure":
            load[row, read_load(channel, loads)] = channel.factor
    return Readings(motion, load)


def _mean_displacement(model: Model, place: Channel | Controlled) -> np.ndarray:
    """Weights of a mean displacement of a node set, less that of another  # (n_dof,)"""
    weights = np.zeros(model.mesh.nodes.size)
    for name, sign in ((place.nodes, 1.0), (place.minus, -1.0)):
        if name is not None:
            nodes = model.node_set(name)
            weights[nodes * model.n_dim + COMPONENTS.index(place.component)] += sign / len(nodes)
    return weights


def controlled(model: Model) -> Controlled | None:
    """The motion or load whose size a gauge decides."""
    return next((drive for drive in model.drives if isinstance(drive, Controlled)), None)


def path_control(model: Model, drives: DriveTable) -> PathControl | None:
    """What the gauge reads and decides, with its course of the simulated frames; None without one."""
    drive = controlled(model)
    if drive is None:
        return None
    load = None
    if drives.controlled is None:
        place = next(i for i, entry in enumerate(model.loads) if isinstance(entry.drive, Controlled))
        load = int(np.argsort(drives.loads.solver_order)[place])
    return PathControl(_mean_displacement(model, drive), from_reference(model, drive.course),
                       drives.controlled, load)


def from_reference(model: Model, course: np.ndarray) -> np.ndarray:
    """A course of the simulated frames, zero at the reference  # (n_simulated, ...)"""
    cut = course[model.reference:].copy()
    cut[0] = 0.0
    return cut


def read_load(channel: Channel, loads: LoadHistories) -> int:
    """The pressure that a channel reads."""
    return loads.stems.index(f"boundary.{channel.nodes}.pressure")
