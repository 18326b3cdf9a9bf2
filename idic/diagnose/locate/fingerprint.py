"""Time dependence of a mismatch: its amplitude against time, load, largest load so far, and rate of loading.

Each of them, from the onset on, is fitted to the amplitude by one factor; the share of the amplitude's weighted square
that it explains says which coordinate makes its course a single curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MIN_EXPLAINED_SHARE = 0.9  # of the square: the amplitude follows this
MAX_UNLOADED_LOAD = 0.35  # of the largest load: a frame after unloading
MIN_KEPT = 0.5  # of the largest amplitude: a lasting mismatch


@dataclass(frozen=True)
class Fingerprint:
    """shares : name of a state variable -> share of the amplitude explained, best first; remanence : how far the
    amplitude in the most unloaded frame is from that at the same load before the peak, over the largest before it, nan
    without unloading; words : in one sentence."""

    shares: dict[str, float]
    remanence: float
    words: str


def fingerprint(amplitude: np.ndarray, std: np.ndarray, times: np.ndarray, load: np.ndarray | None,
                onset: float) -> Fingerprint:
    """Compare the course of an amplitude with those of state variables.

    Parameters
    ----------
    amplitude, std : (T,); times : (T,) s from the reference; load : (T,) of the identified model, None where there is
        no channel; onset : fractional place in the evidence, 0 = the reference
    """
    shares = {name: _share(amplitude, std, x) for name, x in _variables(times, load, onset).items()}
    shares = dict(sorted(shares.items(), key=lambda item: -item[1]))
    remanence = _kept(amplitude, load)
    best, share = next(iter(shares.items()), ("", 0.0))
    words = (f"The amplitude follows {best} ({100.0 * share:.0f} %)" if share > MIN_EXPLAINED_SHARE
             else "The amplitude follows no single variable")
    if not np.isnan(remanence):
        words += (f"; {100.0 * remanence:.0f} % of it stays after unloading" if remanence > MIN_KEPT
                  else "; it goes back at unloading")
    return Fingerprint(shares, remanence, words + ".")


def _variables(times: np.ndarray, load: np.ndarray | None, onset: float) -> dict[str, np.ndarray]:
    is_later = np.arange(1, len(times) + 1) >= onset
    begin = times[is_later][0] if onset > 0 and is_later.any() else 0.0
    variables = {"the time since its onset": np.maximum(times - begin, 0.0), "a constant": is_later.astype(float)}
    if load is None:
        return variables
    size = np.abs(load)
    largest = np.maximum.accumulate(size)
    threshold = largest[is_later][0] if onset > 0 and is_later.any() else 0.0
    earlier = np.concatenate([[0.0], load[:-1]])
    rate = np.abs(load - earlier) / np.maximum(np.diff(times, prepend=0.0), 1e-12)
    return variables | {"the load": load, "the square of the load": load**2,
                        "the load above a threshold": np.maximum(size - threshold, 0.0),
                        "the largest load so far above a threshold": np.maximum(largest - threshold, 0.0),
                        "the square of the largest load so far above a threshold":
                            np.maximum(largest - threshold, 0.0) ** 2,
                        "the rate of loading": rate}


def _share(amplitude: np.ndarray, std: np.ndarray, x: np.ndarray) -> float:
    a, b = amplitude / std, x / std
    return float((a @ b) ** 2 / ((a @ a) * (b @ b))) if (a @ a) > 0.0 and (b @ b) > 0.0 else 0.0


def _kept(amplitude: np.ndarray, load: np.ndarray | None) -> float:
    """Amplitude in the most unloaded frame beyond that at the same load before the peak, over the largest before it.

    A specimen that keeps a fourth of its load shows a fourth of an elastic mismatch: nothing of that has stayed.
    """
    if load is None or len(load) < 3:
        return float("nan")
    size = np.abs(load)
    ratio = size / np.maximum(np.maximum.accumulate(size), 1e-300)
    unloaded = int(np.argmin(ratio))
    peak = np.abs(amplitude[:unloaded]).max(initial=0.0)
    if not (ratio[unloaded] < MAX_UNLOADED_LOAD and peak > 0.0):
        return float("nan")
    up = np.flatnonzero(np.diff(np.maximum.accumulate(size[:unloaded + 1]), prepend=0.0) > 0.0)  # frames of rising load
    elastic = np.interp(size[unloaded], np.r_[0.0, size[up]], np.r_[0.0, amplitude[up]])
    return float(np.abs(amplitude[unloaded] - elastic) / peak)
