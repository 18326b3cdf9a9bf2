"""What a recording is identified from: how much of its load the compared frames hold, and which loaded ones they lack.

Noise is all that a fit leaves in frames at rest, whatever its parameters are: a good residual counts where the load is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.model import Experiment

MIN_LOADED = 0.1  # of the largest change of a reading or drive: a loaded frame
MIN_REACHED = 0.5  # of the load of the dropped frames; what a law does above twice the compared load is not seen
DROPPED = ("unexplained", "lost")  # frames that are left out by what their image shows, not by the user


def load_of_frames(experiment: Experiment) -> np.ndarray | None:
    """Largest change of a logged drive or channel since the reference, as a share of its largest  # (n_frames,)

    None where nothing is logged, or nothing changes.
    """
    model = experiment.model
    courses = [np.asarray(drive.values, dtype=float) for drive in model.logged_drives]
    courses += [np.asarray(channel.values, dtype=float) for channel in model.channels]
    shares = []
    for course in courses:
        change = np.abs(course - course[model.reference])
        if np.nanmax(change, initial=0.0) > 0.0:
            shares.append(np.nan_to_num(change / np.nanmax(change)))
    return np.max(shares, axis=0) if shares else None


def basis_content(entries: Sequence[Mapping], load: np.ndarray | None) -> dict:
    """What the frames of a recording leave to identify from.

    Parameters
    ----------
    entries : of every frame, as `idic.identification.frame_fit.frame_entries` gives them
    load : (n_frames,) `load_of_frames`; None counts every frame but the references as loaded

    Returns
    -------
    ``loaded``, ``compared``, ``dropped`` : numbers of loaded frames, of those that are compared, of those that are
    dropped by their image; ``load_compared``, ``load_dropped`` : their largest loads as a share of the test's (None:
    nothing is logged); ``sufficient`` : whether the compared frames stand for the loaded ones
    """
    loaded = [k for k, entry in enumerate(entries)
              if not entry["reference"] and (load is None or load[k] >= MIN_LOADED)]
    compared = [k for k in loaded if entries[k]["used"]]
    dropped = [k for k in loaded if entries[k]["status"] in DROPPED and not entries[k]["used"]]
    peaks = [None if load is None else float(max((load[k] for k in frames), default=0.0))
             for frames in (compared, dropped)]
    is_short = load is not None and peaks[0] < MIN_REACHED * peaks[1]
    return {"loaded": len(loaded), "compared": len(compared), "dropped": len(dropped), "load_compared": peaks[0],
            "load_dropped": peaks[1], "sufficient": not dropped or not (is_short or len(dropped) > len(compared))}
