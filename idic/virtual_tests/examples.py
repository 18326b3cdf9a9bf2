"""The built-in examples: complete experiment folders whose truth is known (`idic example`, `idic demo`).

An example is a function ``(reduced, foreign) -> VirtualTest`` in `EXAMPLES`; one whose images are not grey writes its
folder itself and stands in `WRITERS`. The examples of the studies stand in two such tables of theirs. The truth is
computed on another, finer mesh than the one the user gets (`bulge`, `polycarbonate`: with `foreign`), and the images
are rendered by `idic.virtual_tests.rendering`, which shares no code with the correlator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from string import Template

import numpy as np

from idic.errors import InputError
from idic.studies import studies_module
from idic.virtual_tests.demo import demo
from idic.virtual_tests.experiment_files import empty_folder, write_images, write_loads, write_truth
from idic.virtual_tests.meshes import write_inp
from idic.virtual_tests.stereo_plate import write_stereo
from idic.virtual_tests.rendering.render import Sensor, clean_image, noisy_channel, render
from idic.virtual_tests.virtual_test import VirtualTest
from idic.virtual_tests.volume_bar import write_volume

IMAGES_AT_A_TIME = 2  # rendered by threads; each takes some 50 MB
EXAMPLES: dict[str, Callable[[bool, bool], VirtualTest]] = {
    "demo": lambda reduced, foreign: demo(reduced),
}
WRITERS = {  # (out, reduced, noise, seed, foreign) -> experiment.toml, or the folder of several
    "stereo": write_stereo, "volume": write_volume,
}
OF_THE_STUDIES = ("bulge", "polycarbonate", "polycarbonate-plans", "volume-calculix")  # in the tables of their room


def write_example(
    name: str,
    out: Path | str,
    reduced: bool = False,
    noise: float | None = None,
    bits: int = 8,
    seed: int = 0,
    foreign: bool = False,
) -> Path:
    """Write a complete experiment folder: images, loads.csv, mesh.inp, experiment.toml and truth.json.

    Parameters
    ----------
    name : str
        One of `EXAMPLES`, `WRITERS` or `OF_THE_STUDIES`.
    reduced : bool
        A smaller version for a quick look: fewer and smaller images, a coarser mesh.
    noise : float, optional
        Standard deviation of the camera noise / standard deviation of f on the specimen; default 0.04 in `demo`, none
        in the others.
    bits : int
        8, 12 or 16, of grey images; height images are 32-bit float.
    seed : int
        Of the speckle and of all noise; the same seed gives the same files.
    foreign : bool
        `bulge`, `polycarbonate`: the truth on a finer mesh and with finer increments than the user's; `demo`:
        always so.

    Returns
    -------
    Path
        The experiment.toml; of planned tests the folder that holds theirs.

    Raises
    ------
    InputError
        Unknown name, bits or negative noise; a folder that is not empty; an example of the studies without them.
    """
    names = (*EXAMPLES, *WRITERS, *OF_THE_STUDIES)
    if name not in names:
        raise InputError(
            f"there is no example {name}",
            key="NAME",
            expected=f"one of {', '.join(names)}",
            found=name,
            remedy="correct the name, e.g.  idic example demo --out FOLDER",
        )
    if noise is not None and not 0.0 <= noise < 1.0:
        raise InputError(
            "the noise is given relative to the contrast of the speckle",
            key="--noise",
            expected="0 … 1, e.g. 0.04",
            found=str(noise),
            remedy="give a number from 0 (no noise) to below 1",
        )
    examples, writers = EXAMPLES, WRITERS
    if name in OF_THE_STUDIES:
        of_the_studies = studies_module("examples", f"idic example {name}")
        examples, writers = of_the_studies.EXAMPLES, of_the_studies.WRITERS
    if name in writers:
        return writers[name](out, reduced, noise, seed, foreign)
    Sensor((1, 1), bits=bits)  # complains about unusual bits before anything is written
    folder = empty_folder(out)
    test = examples[name](reduced, foreign)
    speckle_rng, camera_rng, channel_rng = np.random.default_rng(seed).spawn(3)
    levels = 2.0**bits
    texture = test.texture(speckle_rng, levels)
    bare = Sensor(test.shape, bits=bits, background=test.background * levels, supersampling=test.supersampling)
    contrast = _contrast(test, texture, bare)
    sensor = replace(bare, noise_std=(test.default_noise if noise is None else noise) * contrast)
    log_noise = {c.column: c.added_std(sensor.noise_std) for c in test.columns}
    write_images(folder, render(test.displacements, test.nodes, test.cells, test.camera, texture, sensor, camera_rng,
                                threads=IMAGES_AT_A_TIME))
    write_loads(folder, test.times, {c.column: noisy_channel(c.values, log_noise[c.column], channel_rng)
                                     for c in test.columns})
    write_inp(test.mesh, folder / "mesh.inp", test.title)
    (folder / "experiment.toml").write_text(
        Template(test.toml).substitute(noise_std_gv=f"{sensor.total_noise_std:.4g}"), encoding="utf-8"
    )
    write_truth(
        folder,
        test.truth,
        sensor.total_noise_std,
        added_noise_std_gv=sensor.noise_std,
        contrast_gv=contrast,
        channel_noise_std=log_noise,
        seed=seed,
        bits=bits,
        **test.notes,
    )
    return folder / "experiment.toml"


def _contrast(test: VirtualTest, texture, sensor: Sensor) -> float:
    """Standard deviation of the noise-free reference image on the specimen, in grey values."""
    image = clean_image(
        np.zeros_like(test.nodes), test.nodes, test.cells, test.camera, texture, replace(sensor, background=np.nan)
    )
    return float(np.nanstd(image))
