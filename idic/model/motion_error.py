"""A known error of the simulated motion and channels, which is added to the simulation.

The mesh of a model is coarser than its body, and a thick body is not in plane stress: its motion at the same parameters
differs from that of a finer mesh, or of bricks. A diagnosis adds the difference, so that no cause is blamed for it
(`idic.diagnose.discretisation`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.fe import FrameState


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

    def with_thickness(self, thickness: MotionError) -> MotionError:
        """With the error of plane stress on top."""
        return MotionError(self.u + thickness.u, self.channels + thickness.channels, thickness)

    @property
    def of_mesh(self) -> MotionError:
        """Without the error of plane stress."""
        thickness_error = self.thickness
        if thickness_error is None:
            return self
        return MotionError(self.u - thickness_error.u, self.channels - thickness_error.channels)
