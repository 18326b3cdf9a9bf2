"""One Gauss-Newton image pass: spline, frame share, projection on 10 fields and reduction of every frame.

Baselines on some of the frames, in the same run: the literal route (pixel-sized sensitivities) and nodal sums as one
writes them with SciPy (spline_filter, map_coordinates, sparse matrices). Both make everything constant beforehand.
"""

import time

import numpy as np
import pytest
from jobs.bench_jobs import best_of
from scipy import ndimage, sparse

from idic.correlation import PixelMap, ReferenceImage, nodal_equations
from correlation.pixel_equations import normal_equations
from idic.fe import Block
from idic.images import Camera, lowpass, prefilter

pytestmark = [pytest.mark.bench, pytest.mark.slow]

PARAMETERS, DEGREE, LOWPASS = 10, 5, 0.6  # the defaults: quintic spline, low-pass of 0.6 px
IMAGES = 8  # different images, taken in turn: more than a cache holds
CASES = {  # frames, rows and columns, elements along columns and rows, frames of the slow baselines
    "200 frames of 420 x 193 px, 3000 quad4": (200, (193, 420), (120, 25), 8),
    "50 frames of 2000 x 2000 px, 3000 quad4": (50, (2000, 2000), (55, 55), 1),
}


def setting(shape, elements):
    """Reference, frames, nodal motion and 10 smooth fields (2 n_nodes, 10)."""
    rng = np.random.default_rng(0)
    f, *frames = (rng.integers(0, 256, shape).astype(np.uint8) for _ in range(IMAGES + 1))
    nx, ny = elements
    x, y = np.meshgrid(np.linspace(4.2, shape[1] - 5.2, nx + 1), np.linspace(4.2, shape[0] - 5.2, ny + 1))
    number = np.arange(x.size).reshape(x.shape)
    conn = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    nodes = np.column_stack([x.ravel(), y.ravel()])
    pm = PixelMap.of(nodes, [Block("quad4", conn, 0)], Camera.from_table(1.0, axes=("+col", "+row")), shape)
    u = 0.001 * (pm.nodes_px - np.array(shape[::-1]) / 2) + 0.3
    wave = np.arange(1, PARAMETERS + 1)
    fields = np.stack([np.sin(np.outer(x.ravel() / shape[1], wave)), np.cos(np.outer(y.ravel() / shape[0], wave))], 1)
    return f, frames, pm, u, fields.reshape(-1, PARAMETERS)


def pass_of(reference, frames, u, fields, n_frames):
    """M, b and functional of all frames, as the correlation tasks make them."""

    def run():
        total = np.zeros((PARAMETERS + 2, PARAMETERS + 2)), np.zeros(PARAMETERS + 2), 0.0
        for k in range(n_frames):
            share = nodal_equations(reference, prefilter(frames[k % IMAGES], DEGREE, LOWPASS), u, "frame")
            gram = share.gram(fields)
            total = total[0] + gram.matrix, total[1] + gram.rhs, total[2] + share.rr
        return total

    return run


def scipy_residual(reference, g, moved):
    """f - g(moved) in double precision  # (n_pixels,)"""
    spline = ndimage.spline_filter(lowpass(g, LOWPASS).astype(float), DEGREE, mode="mirror")
    return reference.f.astype(float) - ndimage.map_coordinates(spline, moved[:, ::-1].T, order=DEGREE, mode="mirror",
                                                               prefilter=False)  # fmt: skip


def literal(reference, frames, u, fields, n_frames):
    """Equations 6 and 7 of the paper with pixel-sized sensitivity fields; all that is constant is made beforehand."""
    pm = reference.pixel_map
    weights, points = pm.shape_matrix().tocsr(), pm.points()
    slopes = np.column_stack([reference.fx, reference.fy]).astype(float)

    def run():
        M, b = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        for k in range(n_frames):
            r = scipy_residual(reference, frames[k % IMAGES], points + weights @ u)
            phi = [weights @ fields[component::2] for component in (0, 1)]  # new in every frame: (n_pixels, n) each
            L = slopes[:, :1] * phi[0] + slopes[:, 1:] * phi[1]
            M += L.T @ L
            b += L.T @ r
        return M, b

    return run


def scipy_pipeline(reference, frames, u, fields, n_frames):
    """Nodal sums with SciPy: sparse interpolation, map_coordinates, one nodal matrix for all frames (F = 1)."""
    pm = reference.pixel_map
    weights, points = pm.shape_matrix().tocsr(), pm.points()
    slopes = np.column_stack([reference.fx, reference.fy]).astype(float)
    rows = sparse.hstack([weights.multiply(slopes[:, :1]), weights.multiply(slopes[:, 1:])]).tocsr()  # (n_px, 2n)
    transposed, columns = rows.T.tocsr(), np.concatenate([fields[0::2], fields[1::2]])
    H = transposed @ rows

    def run():
        M, b = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        for k in range(n_frames):
            r = scipy_residual(reference, frames[k % IMAGES], points + weights @ u)
            M += columns.T @ (H @ columns)
            b += columns.T @ (transposed @ r)
        return M, b

    return run


@pytest.mark.parametrize("name", CASES)
def test_one_image_pass_over_all_frames(name, measured):
    n_frames, shape, elements, sample = CASES[name]
    f, frames, pm, u, fields = setting(shape, elements)
    reference = ReferenceImage.of(pm, f, DEGREE, lowpass_px=LOWPASS)
    M, b, _ = pass_of(reference, frames, u, fields, 1)()
    slow_M, slow_b = scipy_pipeline(reference, frames, u, fields, 1)()
    exact = normal_equations(pm, lowpass(f, LOWPASS), lowpass(frames[0], LOWPASS), u,
                             fields.reshape(-1, 2, PARAMETERS), DEGREE)  # fmt: skip
    n = PARAMETERS
    assert np.abs(M[:n, :n] / exact.M - 1).max() < 2e-3  # float32 sums
    # SciPy's routes take the gradient as it is, ours convects it: F = 1.001
    assert np.abs(slow_M - exact.M).max() < 5e-3 * np.abs(exact.M).max()
    assert np.abs(slow_b - exact.b).max() < 5e-3 * np.abs(exact.b).max()
    assert np.abs(b[:n] - exact.b).max() < 5e-3 * np.abs(exact.b).max()
    began = time.perf_counter()
    pass_of(reference, frames, u, fields, n_frames)()
    pass_s = time.perf_counter() - began
    idic_s, by_scipy, by_pixels = best_of([pass_of(reference, frames, u, fields, sample),
                                         scipy_pipeline(reference, frames, u, fields, sample),
                                         literal(reference, frames, u, fields, sample)], 3)  # fmt: skip
    measured(f"image pass, {name}, 10 parameters, one core",
             f"{pass_s:.1f} s ({1e3 * pass_s / n_frames:.1f} ms per frame, "
             f"{pm.n_pixels * n_frames / pass_s / 1e6:.0f} Mpx/s)",
             f"SciPy pipeline {by_scipy / idic_s:.0f} times slower, "
             f"literal pixel-sized route {by_pixels / idic_s:.0f} times")
    assert by_scipy / idic_s > 3 and by_pixels / idic_s > 3
