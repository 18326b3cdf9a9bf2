"""What readings tell of their own smooth error: ``python studies/evidence/channel_error_bound.py [--draws 4000]``.

A modulus that the force alone tells, E = force / (what E = 1 gives), by ordinary least squares; the errors of the
readings are those of `channel_errors.py`. The intervals are those of somebody who knows in advance all that is drawn
but the draw itself: the forms of the course, the noise, and that its size is one of `SIZES_KNOWN`, each as probable.
The interval is the quantile of 95 % of the mean over these courses by their restricted likelihood. What it does not
reach, no estimate from the readings does. Prints how often intervals hold, and their mean width over the narrowest
constant one that holds in 95 of 100 draws.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.linalg import null_space
from scipy.special import ndtr

SIZES, SIZES_KNOWN, LENGTHS = (0.003, 0.01, 0.03), np.geomspace(0.001, 0.1, 16), np.linspace(0.25, 1.0, 7)
NOISE_SHARE, FRAMES, QUANTILE_95 = 5e-4, (9, 30, 100), 1.959964
HALVINGS = 40


def correlation(n: int, length: float) -> np.ndarray:
    """Of a course over n frames  # (n, n)"""
    s = np.linspace(0.0, 1.0, n)
    return np.exp(-0.5 * ((s[:, None] - s) / length) ** 2) + 1e-9 * np.eye(n)


def half_widths(contrasts: np.ndarray, variances: np.ndarray, covariances: list[np.ndarray]) -> np.ndarray:
    """Half of the intervals of 95 %  # (draws,)

    contrasts : (draws, n - 1) of the readings, free of E; per course : variance of E, covariance of the contrasts
    """
    logs = np.empty((len(contrasts), len(covariances)))
    for k, covariance in enumerate(covariances):
        root = np.linalg.cholesky(covariance)
        white = np.linalg.solve(root, contrasts.T)
        logs[:, k] = -0.5 * (white**2).sum(axis=0) - np.log(np.diagonal(root)).sum()
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    std = np.sqrt(variances)
    low, high = np.full(len(logs), std.min()), np.full(len(logs), 3.0 * std.max())
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        inside = (weights * (2.0 * ndtr(middle[:, None] / std) - 1.0)).sum(axis=1) < 0.95
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


def line(rng: np.random.Generator, n: int, kind: str, size: float, draws: int) -> str:
    """Of one world; readings grow evenly up to 1."""
    reading = np.linspace(0.0, 1.0, n + 1)[1:]
    shape = reading if kind == "share" else reading**0.1
    free, weights = null_space(reading[None, :]), reading / (reading @ reading)
    known = [known_size**2 * shape[:, None] * correlation(n, length) * shape + NOISE_SHARE**2 * np.eye(n)
             for known_size in SIZES_KNOWN for length in LENGTHS]
    courses = [np.linalg.cholesky(correlation(n, length)) @ rng.standard_normal(n)
               for length in rng.uniform(LENGTHS[0], LENGTHS[-1], draws)]
    errors = size * shape * np.array(courses) + NOISE_SHARE * rng.standard_normal((draws, n))
    half = half_widths(errors @ free, np.array([weights @ V @ weights for V in known]),
                       [free.T @ V @ free for V in known])
    of_E = np.abs(errors @ weights)
    held, constant = (of_E < half).mean(), np.quantile(of_E, 0.95)
    return (f"{n:4} frames {kind:9} {100 * size:4.1f} %   held {100 * held:5.1f} +- "
            f"{100 * np.sqrt(held * (1 - held) / draws):3.1f} %   width/constant {half.mean() / constant:5.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=4000)
    draws, rng = parser.parse_args().draws, np.random.default_rng(64)
    for n in FRAMES:
        for kind in ("share", "absolute"):
            print("\n".join(line(rng, n, kind, size, draws) for size in SIZES))


if __name__ == "__main__":
    main()
