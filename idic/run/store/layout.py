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

from idic.identification import chunk_frames
from idic.path_names import path_name

DESCRIPTION = "run.json"
DESCRIPTION_SCHEMA = "idic.run-description/1"
BASE = "base"
ENRICHED = "enriched"  # RUN/enriched: the model of a diagnosis as an experiment
EXPERIMENTS = "experiments"  # RUN/experiments/NAME: the parts of a joint identification
FROM_PYTHON = "experiment-from-python"  # RUN/experiment-from-python: the experiment where it was no folder before
CHUNK_BYTES = 8_000_000  # bytes of a chunk; larger chunks are not read faster
FIELDS, FLOOR, FREE = "fields", "floor", "free"  # groups of the judgement of the last point
SCRATCH = "scratch"  # RUN/scratch: folders of an external solver
OF_LINKS = (FROM_PYTHON, ENRICHED, SCRATCH)  # folders in which there may be links: to data, of an external solver


def local_label(index: int) -> str:
    """The simulation with this frame-local unknown shifted."""
    return f"local-{index}"


def group_name(evaluation: int, label: str) -> str:
    """The group of a simulation or system of an evaluated point."""
    return f"evaluations/{evaluation:03d}/{path_name(label)}"


def stored_frames(n_frames: int, record_bytes: int) -> int:
    """Frames per stored chunk of nodal arrays; record_bytes : largest record of a frame.

    A process that writes or reads a simulation holds one such chunk, independent of the length of the test and the
    number of parameters.
    """
    return int(np.clip(CHUNK_BYTES // max(record_bytes, 1), 1, chunk_frames(n_frames)))
