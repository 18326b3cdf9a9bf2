"""The experiment of the bench: a plate with a hole before two cameras of 2 Mpx, E, yield stress and hardening free.

``python stereo_job.py FOLDER FRAMES [ENLARGED [PROCESSES]]``. Images are traced at an eighth of the resolution,
enlarged by cubic interpolation (8 times: 2 Mpx), and noise is added to every pixel: the cost of an identification does
not depend on the size of a speckle. Of many frames the truth takes one increment each.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import tifffile
from scipy.ndimage import zoom

from idic.images import PinholeCamera
from idic.virtual_tests import PlateSize, PlateTest, Rig, Scene, Sensor, record

ENLARGED, NOISE_GV, MANY_FRAMES, MARGIN = 8, 2.0, 20, 4  # MARGIN : px of the traced images
SHAPE = (125, 250)  # traced; 1000 x 2000 px in the experiment


def enlarged(camera: PinholeCamera, times: int) -> PinholeCamera:
    """The same camera with smaller pixels: pixel centres at integers in both."""
    shift = 0.5 * (times - 1)
    return replace(camera, fx=times * camera.fx, fy=times * camera.fy, cx=times * camera.cx + shift,
                   cy=times * camera.cy + shift)


def write_image(file: Path, scene: Scene, u: np.ndarray, camera: PinholeCamera, size: PlateSize, times: int,
                seed: tuple[int, ...]) -> None:
    """One image of the displacements `u` (n_nodes, 3) mm."""
    texture, rng = size.speckle(np.random.default_rng(0)), np.random.default_rng(seed)
    traced = scene.image(u, camera, texture.value, Sensor(SHAPE, background=25.6, supersampling=1))
    large = zoom(traced, times, order=3, grid_mode=True, mode="nearest")
    tifffile.imwrite(file, record(large, sensor(times), rng))


def sensor(times: int) -> Sensor:
    """Of the large images."""
    return Sensor((times * SHAPE[0], times * SHAPE[1]), noise_std=NOISE_GV)


def write(folder: Path, n_frames: int, times: int = ENLARGED, processes: int = 1) -> None:
    """The experiment folder."""
    stages = round(0.3 * n_frames), round(0.2 * n_frames)
    size = PlateSize(0.125, SHAPE, (*stages, n_frames - sum(stages)), (3, 5, 3, 1), (3, 5, 3, 1))
    test = PlateTest.simulated(size, PlateTest.INCREMENTS if n_frames <= MANY_FRAMES else 1)
    file = replace(test, displacements=test.displacements[:1]).write(folder, 0.0)  # its images are replaced
    large = replace(test.rig, cameras=tuple(enlarged(camera_of_test, times) for camera_of_test in test.rig.cameras),
                    shape=(times * SHAPE[0], times * SHAPE[1]))
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        written = [pool.submit(write_image, folder / name / f"frame_{k:03d}.tif", test.scene, u, camera, size, times,
                               (number, k))
                   for number, (name, camera) in enumerate(zip(("images", "right"), test.rig.cameras, strict=True))
                   for k, u in enumerate(test.displacements)]
        for task in written:
            task.result()
    _describe(file, large, sensor(times).total_noise_std, times)


def _describe(file: Path, rig: Rig, noise_gv: float, times: int) -> None:
    """The large cameras and their noise in the files of the experiment; nu known; edges, which the enlargement blurs,
    left out."""
    rig.write_calibration(file.parent / "calibration.json")
    lines = []
    for line in file.read_text().splitlines():
        if line.startswith("noise_std_gv"):
            line = f"noise_std_gv = {noise_gv:.4f}"
        elif line.startswith("nu ="):
            line = "nu = 0.3"
        lines.append(line)
    lines += ["", "[options]", f"edge_margin_px = {MARGIN * times}", f"border_px = {min(MARGIN * times, 50)}"]
    file.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True)
    write(Path(sys.argv[1]), *map(int, sys.argv[2:]))
