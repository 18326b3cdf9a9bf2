"""Scans of an experiment as its model predicts them: its scanner, its motion, a texture of the stated contrast.

They are rendered in voxels: the scanner of each scan is linear, so an element stays what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import camera_at
from idic.experiment_file import DesignTable
from idic.images import Scanner, sensor_levels
from idic.model import Experiment
from idic.virtual_tests.tomograms.reconstruction import IndependentNoise
from idic.virtual_tests.tomograms.tomograph import Tomograph

PLANNED_BITS = 8  # in which [design] states the contrast
AIR_SHARE = 0.1  # of the grey levels, beside the specimen
SAMPLE_PX = 64  # side of the block in the middle of the mesh that tells the contrast


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
        return ScanGrey(planned.contrast_gv * 2.0**(bits - PLANNED_BITS), recorded_gv if noise_gv is None else noise_gv,
                        bits)
    sample = _middle(experiment)
    factor = 2.0**bits / sensor_levels(sample)
    return ScanGrey(float(sample.std()) * factor, recorded_gv * factor if noise_gv is None else noise_gv, bits)


def simulated_scans(experiment: Experiment, motion: Sequence[np.ndarray], grey: ScanGrey,
                    texture: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
                    ) -> Iterator[tuple[Tomograph, Iterator[np.ndarray]]]:
    """The tomograph and the planes of a scan for each of the nodal displacements `motion` (n_nodes, 3) mm

    texture : grey value of material points (n, 3) in voxels of the reference
    """
    model = experiment.model
    scanner, levels = camera_at(experiment, model.parameters), 2.0**grey.bits
    assert isinstance(scanner, Scanner)
    tomograph = Tomograph(experiment.recording.volumes.shape, np.ones(3), np.zeros(3), bits=grey.bits,
                          air_gv=AIR_SHARE * levels, noise=IndependentNoise(grey.noise_gv))
    places = scanner.project(model.mesh.nodes)
    mesh = replace(model.mesh, nodes=places)
    for k, u in enumerate(motion):
        moved = scanner.at(k).project(model.mesh.nodes + u) - places
        yield replace(tomograph, voxel_mm=scanner.voxel_mm), tomograph.scan(mesh, moved, texture, rng)


def _middle(experiment: Experiment) -> np.ndarray:
    """A block of the reference in the middle of the mesh  # (slices, rows, columns)"""
    recording, model = experiment.recording, experiment.model
    places = model.camera.project(model.mesh.nodes)
    low, high = (edge(places, axis=0)[::-1] for edge in (np.min, np.max))
    half = np.minimum(0.25 * (high - low), SAMPLE_PX / 2)
    box = [slice(max(int(a), 0), min(int(b) + 1, n)) for a, b, n in
           zip(0.5 * (low + high) - half, 0.5 * (low + high) + half, recording.volumes.shape, strict=True)]
    return np.asarray(recording.volumes.block(model.reference, *box))
