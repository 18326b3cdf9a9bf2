"""One pass over a scan: reading and filtering its block, the kernel, the sums at the nodes; CPU time per voxel.

Elements with straight edges against bent ones, which take the kernel of buffers, and the recursive filter against the
truncated kernel that it took the place of, each in the same run.
"""

import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from jobs.bench_jobs import brick_px
from scipy.ndimage import gaussian_filter

from idic.correlation import VolumeReference, build_voxel_map
from idic.correlation.volume.block_filter import REACH, filtered
from idic.correlation.volume.spline_block import coefficients_in
from idic.correlation.volume.voxel_map import MAX_BEND
from idic.fe import Block
from idic.images import POLES, ArrayVolumes

pytestmark = [pytest.mark.bench, pytest.mark.slow]

SIDE, ELEMENTS, PARAMETERS, REPEATS = 176, 10, 4, 8  # 16 voxels per element and axis: 30 000 hex8 on 512 cubed


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
    nodes, conn = brick_px(SIDE, ELEMENTS, 6.0)
    volumes = ArrayVolumes([f, np.roll(f, 1, axis=0)])
    voxel_map = build_voxel_map(nodes, [Block("hex8", conn)], f.shape)
    return VolumeReference.of(voxel_map, volumes, (0,)), volumes, 0.01 * (nodes - SIDE / 2) + [0.3, -0.2, 1.1]


def test_a_pass_over_a_scan(monkeypatch, measured):
    """Goal 12 ns; all elements as bent ones: the kernel that these took, too, until they had one of their own."""
    modes = np.random.default_rng(1).normal(size=(3 * (ELEMENTS + 1)**3, PARAMETERS))
    figures = {}
    for name, max_bend in (("straight", MAX_BEND), ("bent", -1.0)):
        monkeypatch.setattr("idic.correlation.volume.voxel_map.MAX_BEND", max_bend)
        reference, volumes, u = setting()
        assert reference.pixel_map.affine.all() == (name == "straight")
        figures[name] = least_ns(partial(pass_over, reference, volumes, u, modes), reference.pixel_map.n_pixels)
    measured(f"a pass over a scan of {SIDE} voxels cubed, {ELEMENTS}³ hex8, n = {PARAMETERS}",
             f"{figures['straight']:.1f} ns per voxel",
             f"{figures['bent']:.1f} of bent elements: {figures['bent'] / figures['straight']:.2f} x; goal 12")
    assert figures["straight"] < figures["bent"] and figures["straight"] < 40.0  # a slow or shared machine


def pass_over(reference, volumes, u, modes):
    return reference.equations(volumes, 1, u).gram(modes)


def test_memory_of_a_pass_hardly_grows_with_the_volume(measured):
    """Each in a process of its own; 27 000 hex8; above 26 million voxels the reference is made anew in every pass."""
    grown = []
    for side in (256, 384, 512):
        process = subprocess.run([sys.executable, "volume_job.py", str(side), "30"], capture_output=True, text=True,
                                 cwd=Path(__file__).with_name("jobs"), check=True)
        voxels, blocks, at_rest, mapping, reference, of_pass, peak = map(float, process.stdout.split())
        measured(f"{side}³ voxels, 30³ hex8, n = {PARAMETERS}: a pass", f"{1e9 * of_pass / voxels:.1f} ns per voxel",
                 f"{blocks:.0f} blocks; {peak:.0f} MB, {at_rest:.0f} before; once: voxels "
                 f"{1e9 * mapping / voxels:.0f}, reference {1e9 * reference / voxels:.0f} ns per voxel")
        grown.append(peak - at_rest)
    assert grown[2] < 2.5 * grown[0]  # of nine times the voxels: a byte per voxel, and what is stored up to its limit


def spline_taps(degree):
    """The recursive filter as a kernel, along one axis, cut after `REACH` voxels  # (2 r + 1,)"""
    distance = np.abs(np.arange(-REACH[degree], REACH[degree] + 1))
    taps = np.ones(1)
    for z in POLES[degree]:
        taps = np.convolve(taps, (1.0 - z) / (1.0 + z) * np.asarray(z, float)**distance)
    middle = len(taps) // 2
    return np.ascontiguousarray(taps[middle - REACH[degree]:middle + REACH[degree] + 1], dtype=np.float32)


@pytest.mark.parametrize("degree", [3, 5])
def test_the_recursive_filter_is_faster_and_gives_the_same(degree, measured):
    block = 40.0 * np.random.default_rng(0).normal(size=(150,) * 3).astype(np.float32)
    n_voxels, taps = (150 - 2 * REACH[degree])**3, spline_taps(degree)

    def truncated():
        values = block
        for axis in range(3):
            values = filtered(values, taps, axis)
        return values

    expected = truncated()
    begin = (REACH[degree],) * 3

    def recursive():
        return coefficients_in(block, 0.0, degree, begin, expected.shape, 0)

    assert np.abs(recursive().reshape(expected.shape) - expected).max() < 2e-6 * np.abs(expected).max()
    old, new = least_ns(truncated, n_voxels), least_ns(recursive, n_voxels)
    measured(f"spline filter of a block, degree {degree}", f"{new:.1f} ns per voxel",
             f"truncated kernel {old:.1f}: {old / new:.2f} x")
    assert new < old
