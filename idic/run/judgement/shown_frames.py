"""The frames that a report shows, and that a judgement looks at one by one."""

from __future__ import annotations

import numpy as np

from idic.model import Experiment

N_SHOWN_FRAMES = 4


def shown_frames(experiment: Experiment) -> tuple[int, ...]:
    """Frames spread over the test, the last one always among them."""
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    if not frames:
        return ()
    picks = np.linspace(0, len(frames) - 1, min(N_SHOWN_FRAMES, len(frames)) + 1)[1:] if len(frames) > 1 else [0]
    return tuple(dict.fromkeys(frames[int(round(p))] for p in picks))
