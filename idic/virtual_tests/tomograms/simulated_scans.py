"""Scans of an experiment as its model predicts them: its scanner, its motion, a texture of the stated contrast.

They are rendered in voxels: the scanner of each scan is linear, so an element stays what it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.correlation import camera_at
from idic.experiment_file import DesignTable
from idic.identification import DOT_SIGMA_PER_SPECKLE
from idic.images import Scanner, sensor_levels
from idic.model import Experiment
from idic.virtual_tests.experiment_files import SCANS, write_scan
from idic.virtual_tests.solid_speckle import PERIOD_CELLS, solid_speckle
from idic.virtual_tests.tomograms.reconstruction import IndependentNoise
from idic.virtual_tests.tomograms.tomograph import Tomograph
from idic.virtual_tests.virtual_test import GREY_LEVELS, with_contrast

SPECKLE_PX = 4.0  # where there is no plan: as the default of [design]
AIR_SHARE = 0.1  # of the grey levels, beside the specimen
SAMPLE_PX = 64  # side of the block in the middle of the mesh that tells the contrast
MASK = "mask.npy"


@dataclass(frozen=True)
class ScanGrey:
    """Grey values of the new scans: contrast_gv : standard deviation of the texture; noise_gv : of a voxel"""

    contrast_gv: float
    noise_gv: float
    bits: int

    @property
    def total_noise_gv(self) -> float:
        """With that of rounding."""
        return float(np.hypot(self.noise_gv, 12.0**-0.5))


def scan_grey(experiment: Experiment, bits: int, noise_gv: float | None, planned: DesignTable | None) -> ScanGrey:
    """Contrast and noise as they are planned, else those of the recorded scans on the range of the new ones."""
    noise = experiment.recording.noise
    recorded_gv = float(noise.std_gv if noise.correlated is None else noise.correlated.recorded_gv)
    if planned is not None:
        return ScanGrey(planned.contrast_gv * 2.0**bits / GREY_LEVELS, recorded_gv if noise_gv is None else noise_gv,
                        bits)
    sample = _middle(experiment)
    factor = 2.0**bits / sensor_levels(sample)
    return ScanGrey(float(sample.std()) * factor, recorded_gv * factor if noise_gv is None else noise_gv, bits)


def write_simulated_scans(folder: Path, experiment: Experiment, motion: Sequence[np.ndarray], grey: ScanGrey,
                          planned: DesignTable | None, texture_rng: np.random.Generator,
                          noise_rng: np.random.Generator) -> None:
    """Write a scan for each of the nodal displacements `motion` (n_nodes, 3) mm, and the mask where there is one."""
    model, recording = experiment.model, experiment.recording
    scanner, levels = camera_at(experiment, model.parameters), 2.0**grey.bits
    assert isinstance(scanner, Scanner)
    size_px = SPECKLE_PX if planned is None else planned.speckle_px
    speckle = solid_speckle(texture_rng, DOT_SIGMA_PER_SPECKLE * size_px)
    texture = with_contrast(speckle, grey.contrast_gv, 0.5 * levels, 1.0, np.full(3, PERIOD_CELLS * speckle.cell_mm))
    tomograph = Tomograph(recording.volumes.shape, np.ones(3), np.zeros(3), bits=grey.bits, air_gv=AIR_SHARE * levels,
                          noise=IndependentNoise(grey.noise_gv))
    places = scanner.project(model.mesh.nodes)
    mesh = replace(model.mesh, nodes=places)
    for k, u in enumerate(motion):
        moved = scanner.at(k).project(model.mesh.nodes + u) - places
        planes: Iterator[np.ndarray] = tomograph.scan(mesh, moved, texture.value, noise_rng)
        write_scan(folder / SCANS / f"scan_{k:03d}.tif", planes, tomograph.shape, tomograph.dtype, scanner.voxel_mm)
    if experiment.voxel_mask is not None:
        np.save(folder / MASK, experiment.voxel_mask(*(slice(0, n) for n in tomograph.shape)).astype(np.uint8))


def _middle(experiment: Experiment) -> np.ndarray:
    """A block of the reference in the middle of the mesh  # (slices, rows, columns)"""
    recording, model = experiment.recording, experiment.model
    places = model.camera.project(model.mesh.nodes)
    low, high = (edge(places, axis=0)[::-1] for edge in (np.min, np.max))
    half = np.minimum(0.25 * (high - low), SAMPLE_PX / 2)
    box = [slice(max(int(a), 0), min(int(b) + 1, n)) for a, b, n in
           zip(0.5 * (low + high) - half, 0.5 * (low + high) + half, recording.volumes.shape, strict=True)]
    return np.asarray(recording.volumes.block(model.reference, *box))
