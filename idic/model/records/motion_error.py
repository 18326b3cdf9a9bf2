"""A known error of the simulated motion and channels, which is added to the simulation.

The mesh of a model is coarser than its body, and a thick body is not in plane stress: its motion at the same parameters
differs from that of a finer mesh, or of bricks. A diagnosis adds the difference, so that no cause is blamed for it
(`idic.simulation_error`, `idic.diagnose.discretisation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.fe import FrameState
from idic.model.records.parts import Channel


@dataclass(frozen=True, eq=False)
class MotionError:
    """Correction that is added to a simulation, per frame; zero in the reference and before.

    u : (n_frames, n_nodes, dim) mm; channels : (n_frames, n_channels); thickness : the part of it by which a body of
    real thickness differs from a sheet in plane stress, None: not counted
    """

    u: np.ndarray
    channels: np.ndarray
    thickness: MotionError | None = None

    def added(self, state: FrameState, frame: int) -> FrameState:
        """The state of a frame with the correction added; derivatives are unchanged."""
        return replace(state, u=state.u + self.u[frame], channels=state.channels + self.channels[frame])

    def scaled(self, factor: float) -> MotionError:
        """A multiple, without the part of the thickness."""
        return MotionError(factor * self.u, factor * self.channels)

    def plus(self, error: MotionError) -> MotionError:
        """The sum of two, without the part of the thickness."""
        return MotionError(self.u + error.u, self.channels + error.channels)

    def less(self, error: MotionError | None) -> MotionError:
        """By how much it is more than another one, None: than none; without the part of the thickness."""
        return MotionError(self.u, self.channels) if error is None else self.plus(error.scaled(-1.0))

    def on_top_of(self, mesh: MotionError | None) -> MotionError:
        """This error of plane stress on top of that of the mesh, None: of none."""
        return replace(self if mesh is None else self.plus(mesh), thickness=self)

    @property
    def of_mesh(self) -> MotionError:
        """Without the error of plane stress."""
        return self if self.thickness is None else self.less(self.thickness)

    def without_reactions(self, channels: Sequence[Channel]) -> MotionError:
        """The same error of motions and other channels: reactions are at their limit, whatever else is lacking."""
        factor = np.array([0.0 if channel.kind == "reaction" else 1.0 for channel in channels])
        return replace(self, channels=factor * self.channels)
