"""Layout of a RUN folder: names of its files and groups, and how many frames a stored chunk holds.

Layout of an evaluated point (`evaluations/007`)::

    start/local            (n_frames, m)  values of the frame-local unknowns at this point, mm
    base/u, channels       the simulation; du, dchannels: its sensitivities (direct differentiation)
    base/local_du, ...     influence of the frame-local unknowns on their own frame
    SPECIMEN.E/u, channels the simulation at a perturbed parameter (perturbed runs)
    local-0/u, channels    the same with frame-local unknown 0 shifted in all frames (external solver)
"""

from __future__ import annotations

import numpy as np

DESCRIPTION = "run.json"
DESCRIPTION_SCHEMA = "idic.run-description/1"
BASE = "base"
EXPERIMENTS = "experiments"  # RUN/experiments/NAME: those of several experiments identified together
CHUNK_BYTES = 8_000_000  # larger ones are read no faster
SCRATCH = "scratch"  # RUN/scratch: folders of an external solver


def local_label(index: int) -> str:
    """The simulation with this frame-local unknown shifted."""
    return f"local-{index}"


def group_name(evaluation: int, label: str) -> str:
    """The group of a simulation or system of an evaluated point."""
    return f"evaluations/{evaluation:03d}/{label}"


def chunk_frames(n_frames: int) -> int:
    """Frames per chunk of nodal arrays and per correlation task: depends on the length of the test only, so that the
    sums are the same whatever number of workers there is."""
    return int(np.clip(-(-n_frames // 16), 1, 16))


def stored_frames(n_frames: int, record_bytes: int) -> int:
    """Frames per stored chunk of nodal arrays, of which the largest record of a frame has so many bytes.

    What a process holds of a simulation, while it writes or reads it, is one such chunk, however long the test is and
    however many parameters there are.
    """
    return int(np.clip(CHUNK_BYTES // max(record_bytes, 1), 1, chunk_frames(n_frames)))
