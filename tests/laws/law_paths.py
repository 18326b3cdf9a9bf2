"""Deformation paths for the tests: many points, several steps, loading and unloading."""

import numpy as np

from idic.laws import point_stresses

SIZE = 0.02  # norm of F - I at the far end: elastic laws barely notice, the default J2 laws are far beyond yield


def random_path(rng, n: int, d: int, steps: int = 4, size: float = SIZE) -> np.ndarray:
    """(steps, n, d, d): out along one random direction, then part of the way along another."""
    first, second = rng.standard_normal((2, n, d, d))
    first, second = (x / np.linalg.norm(x, axis=(1, 2))[:, None, None] for x in (first, second))
    half = steps // 2
    out = [np.eye(d) + size * (k + 1) / half * first for k in range(half)]
    return np.array(out + [out[-1] + 0.5 * size * (k + 1) / (steps - half) * second for k in range(steps - half)])


def follow(law, mode, path, params, dt=1.0, state=None):
    """Stress (steps, n, d, d) and state at the end."""
    state = np.tile(law.initial_state(mode), (path.shape[1], 1)) if state is None else state
    stresses = []
    for F in path:
        P, state, ok = point_stresses(law, mode, F, state, params, dt)
        assert ok
        stresses.append(P)
    return np.array(stresses), state


def rotations(rng, n: int) -> np.ndarray:
    """(n, 3, 3) proper rotations."""
    q, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    return q * np.sign(np.linalg.det(q))[:, None, None]
