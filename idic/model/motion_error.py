"""A known error of the simulated motion and channels, which is added to what the simulation gives.

The mesh of a model is coarser than its body: its motion at the same parameters differs from that of a finer mesh. A
diagnosis adds the difference, so that no cause is blamed for it (`idic.diagnose.discretisation`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.fe.march import FrameState


@dataclass(frozen=True, eq=False)
class MotionError:
    """What a simulation lacks, per frame; zero in the reference and before.

    u : (n_frames, n_nodes, dim) mm; channels : (n_frames, n_channels)
    """

    u: np.ndarray
    channels: np.ndarray

    def added(self, state: FrameState, frame: int) -> FrameState:
        """The state of a frame with what it lacks; derivatives stay."""
        return replace(state, u=state.u + self.u[frame], channels=state.channels + self.channels[frame])
