"""One pass over a scan: reading and filtering its block, the kernel, the sums at the nodes; CPU time per voxel.

The recursive filter against the truncated kernel that it took the place of, in the same run.
"""

import time

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from idic.correlation import build_volume_reference, build_voxel_map
from idic.correlation.volume.block_filter import REACH, filtered, spline_taps
from idic.correlation.volume.spline_block import coefficients_in
from idic.fe import Block
from idic.images import ArrayVolumes

pytestmark = [pytest.mark.bench, pytest.mark.slow]

SIDE, ELEMENTS, PARAMETERS, REPEATS = 128, 12, 4, 12


def least_ns(run, n_voxels):
    """Least CPU time of this thread over some repeats, in ns per voxel."""
    times = []
    for _ in range(REPEATS):
        began = time.thread_time()
        run()
        times.append(time.thread_time() - began)
    return 1e9 * min(times) / n_voxels


def setting():
    rng = np.random.default_rng(0)
    f = gaussian_filter(rng.normal(size=(SIDE,) * 3).astype(np.float32), 1.5)
    f = np.clip(128.0 + 40.0 * f / f.std(), 0, 255).astype(np.uint8)
    x = np.linspace(6.0, SIDE - 7.0, ELEMENTS + 1)
    nodes = np.stack(np.meshgrid(x, x, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape((ELEMENTS + 1,) * 3)
    corners = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    conn = np.stack([number[c:ELEMENTS + c, b:ELEMENTS + b, a:ELEMENTS + a].ravel() for c, b, a in corners], axis=1)
    volumes = ArrayVolumes([f, np.roll(f, 1, axis=0)])
    voxel_map = build_voxel_map(nodes, [Block("hex8", conn)], f.shape)
    return build_volume_reference(voxel_map, volumes, (0,)), volumes, 0.01 * (nodes - SIDE / 2) + [0.3, -0.2, 1.1]


def test_a_pass_over_a_scan():
    reference, volumes, u = setting()
    modes = np.random.default_rng(1).normal(size=(u.size, PARAMETERS))
    whole = least_ns(lambda: reference.equations(volumes, 1, u).gram(modes), reference.pixel_map.n_pixels)
    print(f"{whole:.1f} ns per voxel and scan, n = {PARAMETERS}, CPU time")
    assert whole < 60.0  # twice what a machine of 2026 takes


@pytest.mark.parametrize("degree", [3, 5])
def test_the_recursive_filter_is_faster_and_gives_the_same(degree):
    block = 40.0 * np.random.default_rng(0).normal(size=(150,) * 3).astype(np.float32)
    n_voxels, taps = (150 - 2 * REACH[degree])**3, spline_taps(degree)

    def truncated():
        values = block
        for axis in range(3):
            values = filtered(values, taps, axis)
        return values

    expected = truncated()
    values = coefficients_in(block.copy(), degree, REACH[degree], 0).reshape(expected.shape)
    assert np.abs(values - expected).max() < 2e-6 * np.abs(expected).max()
    copies = [block.copy() for _ in range(REPEATS)]  # it overwrites
    old = least_ns(truncated, n_voxels)
    new = least_ns(lambda: coefficients_in(copies.pop(), degree, REACH[degree], 0), n_voxels)
    print(f"degree {degree}: {old:.1f} ns per voxel truncated, {new:.1f} recursive, ratio {old / new:.2f}")
    assert new < old
