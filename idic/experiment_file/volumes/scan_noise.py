"""The noise of the scans: given, or from scans of one state, whose noise is correlated between voxels."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import scipy

from idic.errors import InputError
from idic.experiment_file.schema.cameras import ScannerTable
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh
from idic.images import DEGREES, Scanner, VolumeStack, cube_corners, volume_noise, whole_shift
from idic.model import CorrelatedNoise, Noise

MIN_SCANS = 2
CUBE_SIDES = (24, 16)  # voxels, of the cubes whose differences are looked at
SHIFT_SIDE = 64  # voxels, of the block that tells how far a scan has moved as a whole
SPLINE_REACH = 12  # voxels, of the weights of an interpolated value
MIN_NOISE_RATIO = 1.08  # of the noise in sums to that of a voxel, or the other way: less changes nothing


def scan_noise(config: ExperimentFile, stack: VolumeStack, still: tuple[int, ...], n_references: int, mesh: Mesh,
               scanner: Scanner, interpolation: str, file: Path) -> tuple[Noise, tuple[str, ...]]:
    """Noise of one scan.

    n_references : scans that are averaged to the reference; interpolation : of `Options`

    Raises
    ------
    InputError
        Neither a value nor two scans at rest, or scans that show no noise.
    """
    table = config.scanner or ScannerTable()
    if table.noise_std_gv is not None:
        return Noise(table.noise_std_gv, "given"), ()
    if len(still) < MIN_SCANS:
        raise InputError("the noise of the scans is not known", file=file, key="experiment.still_frames",
                         expected="two scans of the same state, or noise_std_gv under [scanner]",
                         found="neither of them",
                         remedy="scan the specimen twice at the first load: still_frames = [0, 1]; or give the "
                                "standard deviation of the grey values of one scan")
    low, high = _box(stack, scanner.project(mesh.nodes))
    measured = [entry for pair in pairwise(still) if (entry := _of_pair(stack, pair, low, high, config)) is not None]
    if not measured:
        raise InputError("two scans at rest show no noise", file=file, key="experiment.still_frames",
                         expected="two scans of one state, each with its own noise, of 40 voxels or more along each "
                                  "axis", found="copies of each other, scans that differ by more than noise, or small "
                                                "ones",
                         remedy="name two scans of one state, or give noise_std_gv under [scanner]")
    std = float(np.sqrt(np.mean([entry.std_gv**2 for entry in measured])))
    sums = float(np.sqrt(np.mean([entry.sum_std_gv**2 for entry in measured])))
    correlation = np.mean([entry.correlation for entry in measured], axis=0)
    if 1.0 / MIN_NOISE_RATIO < sums / std < MIN_NOISE_RATIO:
        return Noise(std, "still_frames"), ()
    degree = DEGREES[interpolation]
    compared = std * np.sqrt((1.0 / n_references + _interpolated(correlation, degree))
                             / (1.0 / n_references + _interpolated(None, degree)))
    plane = correlation[len(correlation) // 2]
    rows = tuple(tuple(float(value) for value in row) for row in plane)
    return Noise(float(compared), "still_frames", correlated=CorrelatedNoise(std, sums, rows, std, "still_frames")), ()


def _box(stack: VolumeStack, nodes_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slices, rows and columns around the mesh: the first, and the one behind the last  # (3,), (3,)"""
    shape = np.array(stack.shape)
    low = np.clip(np.floor(nodes_px.min(axis=0))[::-1], 0, shape - 1).astype(int)
    return low, np.clip(np.ceil(nodes_px.max(axis=0))[::-1] + 1, low + 1, shape).astype(int)


def _of_pair(stack: VolumeStack, pair: tuple[int, int], low: np.ndarray, high: np.ndarray, config: ExperimentFile):
    """The noise that two scans show; None where they show none."""
    def reader(frame):
        return lambda z, y, x: stack.block(frame, z, y, x)

    first, second = (reader(frame) for frame in pair)
    middle, half = (low + high) // 2, np.minimum((high - low) // 2, SHIFT_SIDE // 2)
    block = [slice(int(m - h), int(m + h)) for m, h in zip(middle, half, strict=True)]
    shift = whole_shift(first(*block), second(*block))
    whole_volume = np.zeros(3, dtype=int), np.array(stack.shape)  # where the mesh has no room for enough cubes
    for (start, end), side in product(((low, high), whole_volume), CUBE_SIDES):
        corners = cube_corners(start, end, side)
        if len(corners):
            noise = volume_noise(first, second, corners, side, config.options.lowpass_px or 0.0, shift)
            if noise is not None:
                return noise
    return None


def _interpolated(correlation: np.ndarray | None, degree: int) -> float:
    """Mean variance of an interpolated value over that of a voxel; correlation : None: independent voxels

    The correlation along the axes is taken as that between them: a product.
    """
    impulse = np.zeros(2 * SPLINE_REACH + 9)
    impulse[len(impulse) // 2] = 1.0
    voxels, gain = np.arange(-SPLINE_REACH, SPLINE_REACH + 1), 1.0
    lags = np.abs(voxels[:, None] - voxels[None, :])
    for axis in range(3):
        along = np.zeros(2 * SPLINE_REACH + 1)
        along[0] = 1.0
        if correlation is not None:
            reach = len(correlation) // 2
            place = [reach] * 3
            for lag in range(1, reach + 1):
                place[axis] = reach + lag
                along[lag] = correlation[tuple(place)]
        weights = [scipy.ndimage.map_coordinates(impulse, [len(impulse) // 2 + fraction - voxels], order=degree,
                                                 mode="mirror")
                   for fraction in np.linspace(0.0, 1.0, 16, endpoint=False)]
        gain *= float(np.mean([w @ along[lags] @ w for w in weights]))
    return gain
