"""Corners of a chessboard to a hundredth of a pixel: a model of two blurred edges that cross, fitted to the grey
values.

    g = m + gx x + gy y + A erf(u / (√2 w)) erf(v / (√2 w)),   u, v: distances to the two edges, w: their blur
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

STEPS = 12
WINDOW = 0.42               # of the spacing to the next corner: no other edge inside
MAX_HALF_PX = 9.0
MIN_HALF_PX = 2.5
MAX_SHIFT_PX = 1.5          # from the start: further off, the fit is of something else
_X, _Y, _T1, _T2, _W, _A, _M, _GX, _GY = range(9)


def fit_corners(image: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Corners of a grid, refined; a corner whose fit fails stays where it was  # (rows, columns, 2) px -> the same

    Parameters
    ----------
    image : array (ny, nx)
    field : array (rows, columns, 2)
        Corners as (column, row), rows and columns as on the board.
    """
    start = field.reshape(-1, 2)
    along, down = (np.gradient(field, axis=axis).reshape(-1, 2) for axis in (1, 0))
    half = float(np.clip(WINDOW * min(np.linalg.norm(d, axis=1).min() for d in (along, down)), MIN_HALF_PX,
                         MAX_HALF_PX))
    reach = int(np.ceil(half))
    dx, dy = (d.ravel() for d in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    in_window = dx**2 + dy**2 <= half**2
    dx, dy = dx[in_window], dy[in_window]
    middle = np.rint(start).astype(int)
    inside = ((middle >= reach) & (middle < np.array(image.shape[::-1]) - reach)).all(axis=1)
    refined = start.copy()
    if inside.any():
        grey = image[middle[inside, 1, None] + dy, middle[inside, 0, None] + dx].astype(float)
        offset, good = _fit(grey, dx, dy, start[inside] - middle[inside], along[inside], down[inside])
        chosen = np.flatnonzero(inside)[good]
        refined[chosen] = middle[chosen] + offset[good]
    return refined.reshape(field.shape)


def _fit(grey, dx, dy, offset, along, down):
    """Gauss–Newton for all corners at once  # grey (n, m) -> positions (n, 2) relative to the window, good (n,)"""
    n = len(grey)
    p = np.zeros((n, 9))
    p[:, :2] = offset
    p[:, _T1] = np.arctan2(along[:, 0], -along[:, 1])  # normals of the edges
    p[:, _T2] = np.arctan2(down[:, 0], -down[:, 1])
    p[:, _W], p[:, _M] = 1.0, grey.mean(axis=1)
    model, _ = _model(p, dx, dy, unit=True)
    p[:, _A] = (model * (grey - p[:, [_M]])).sum(axis=1) / (model**2).sum(axis=1)
    for _ in range(STEPS):
        model, slopes = _model(p, dx, dy)
        normal = np.einsum("nmi,nmj->nij", slopes, slopes)
        normal += 1e-9 * np.einsum("nii->n", normal)[:, None, None] * np.eye(9)
        step = np.linalg.solve(normal, np.einsum("nmi,nm->ni", slopes, grey - model)[..., None])[..., 0]
        step[:, :2] = np.clip(step[:, :2], -0.5, 0.5)
        step[:, [_T1, _T2, _W]] = np.clip(step[:, [_T1, _T2, _W]], -0.3, 0.3)
        p = p + step
        p[:, _W] = np.clip(p[:, _W], 0.3, 4.0)
    good = np.isfinite(p).all(axis=1) & (np.linalg.norm(p[:, :2] - offset, axis=1) < MAX_SHIFT_PX)
    return p[:, :2], good


def _model(p, dx, dy, unit=False):
    """Grey values (n, m) and derivatives (n, m, 9); ``unit``: the crossing alone, with A = 1."""
    x, y = dx - p[:, [_X]], dy - p[:, [_Y]]
    edges = []
    for t in (_T1, _T2):
        cosine, sine = np.cos(p[:, [t]]), np.sin(p[:, [t]])
        u, w = x * cosine + y * sine, p[:, [_W]]
        slope = np.sqrt(2.0 / np.pi) / w * np.exp(-0.5 * (u / w) ** 2)
        edges.append((erf(u / (np.sqrt(2.0) * w)), slope, cosine, sine, -x * sine + y * cosine, -u / w * slope))
    (e1, s1, c1, n1, a1, w1), (e2, s2, c2, n2, a2, w2) = edges
    if unit:
        return e1 * e2, None
    amplitude, ones = p[:, [_A]], np.ones_like(e1)
    slopes = np.stack([-amplitude * (s1 * c1 * e2 + s2 * c2 * e1), -amplitude * (s1 * n1 * e2 + s2 * n2 * e1),
                       amplitude * s1 * a1 * e2, amplitude * s2 * a2 * e1, amplitude * (w1 * e2 + w2 * e1),
                       e1 * e2, ones, ones * dx, ones * dy], axis=-1)
    return p[:, [_M]] + p[:, [_GX]] * dx + p[:, [_GY]] * dy + amplitude * e1 * e2, slopes
