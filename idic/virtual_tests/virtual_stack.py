"""A virtual test without noise or image files: its folder, and the stack that its images are rendered in on demand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from idic.virtual_tests.experiment_files import write_loads, write_truth
from idic.virtual_tests.meshes import write_inp
from idic.virtual_tests.render import Sensor, Texture, clean_image
from idic.virtual_tests.virtual_test import VirtualTest

LEVELS = 256.0  # grey values of 8 bits; other sensors are steps of another size on the same scale


@dataclass(frozen=True, eq=False)
class RenderedStack:
    """The images of a virtual test before noise and rounding, on the scale of 8 bits."""

    test: VirtualTest
    texture: Texture
    sensor: Sensor

    @property
    def n_frames(self) -> int:
        return len(self.test.times)

    @property
    def shape(self) -> tuple[int, int]:
        return self.test.shape

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        test = self.test
        image = clean_image(test.displacements[k], test.nodes, test.cells, test.camera, self.texture, self.sensor)
        return image.astype(np.float32)


def write_virtual_model(folder: Path, test: VirtualTest, seed: int = 0, floor_gv: float = 0.0) -> RenderedStack:
    """Write everything of the experiment folder but its images; returns these.

    Parameters
    ----------
    seed : of the speckle, as in `idic.virtual_tests.examples.write_example`
    floor_gv : what stands for the noise where none is added: the error of the interpolating spline, in grey values
    """
    speckle_rng = np.random.default_rng(seed).spawn(3)[0]
    write_loads(folder, test.times, {column.column: column.values for column in test.columns})
    write_inp(test.mesh, folder / "mesh.inp", test.title)
    (folder / "experiment.toml").write_text(
        Template(test.toml).substitute(noise_std_gv=f"{floor_gv:.4g}"), encoding="utf-8"
    )
    write_truth(folder, test.truth, floor_gv, seed=seed, **test.notes)
    sensor = Sensor(test.shape, bits=0, background=test.background * LEVELS, supersampling=test.supersampling)
    return RenderedStack(test, test.texture(speckle_rng, LEVELS), sensor)
