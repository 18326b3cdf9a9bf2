"""The example `bulge`: height images of a membrane that bulges, with a metal strip on it (five parameters)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from string import Template

import numpy as np

from idic.fe import Mesh
from idic_studies.examples.bulge_mesh import FULL, REDUCED, Columns, bulge_mesh
from idic_studies.examples.bulge_model import (
    FIXED,
    PRESSURE_COLUMN,
    TRUTH,
    BulgeTest,
    bulge_test,
    model_toml,
    true_displacements,
)
from idic.virtual_tests import SectionImages, empty_folder, roughness, write_images, write_inp, write_loads, write_truth

RMS_UM = 1.5  # roughness of the surface
FOREIGN = Columns(101, 115, 180, (2.0, 4.0, 5.0))  # the twin: another mesh, finer, and finer in time
FOREIGN_LAYERS, FOREIGN_STEPS = 3, 5

TOML = """\
# A bulge test, as `idic example bulge` writes it: a rubber membrane with a thin metal strip, clamped at both sides, is
# blown up from below; a profilometer measures its height. The truth is in truth.json.
# Try:  idic check experiment.toml,  then  idic identify experiment.toml --out run
$origin

[experiment]
title = "Bulge test, metal strip on rubber"
images = "images/*.tif"            # 32-bit float; the first, before any pressure, is the reference
quantity = "height"
height_unit = "um"
loads = "loads.csv"                # one row per image
mesh = "mesh.inp"                  # the half x >= 0 of the cross-section; y is up
mesh_unit = "mm"
kind = "plane_strain"
surface = "TOP"                    # the edges that are seen from above
symmetry = "x"                     # the images show both halves

[camera]
pixel_size_mm = $pixel_size
origin_px = [$column, $row]        # the axis of symmetry
axes = ["+col", "-row"]
noise_std_gv = $noise              # of one image, um

$model
[options]
substeps = 1                       # increments per frame
edge_margin_px = $margin
"""
SAME = ("# The images were computed on this very mesh, with one increment per frame, so nothing but the images' noise\n"
        "# stands between the model and the truth.")
OTHER = ("# The images were computed on a finer mesh and with finer increments than the model has: what that costs is\n"
         "# in the residual and in the parameters.")


@dataclass(frozen=True)
class Size:
    """Pixel size (um), image (rows, columns), frames after the reference, mesh, correlation length (um), margin (px).

    floor_um : what stands for the noise where none is added: float32 at 90 um, and the spline's own error, which is
    largest where the edge of the strip bends the profile within a pixel.
    """

    pixel_um: float
    shape: tuple[int, int]
    frames: int
    columns: Columns
    length_um: float
    margin_px: int
    floor_um: float


FULL_SIZE = Size(0.332, (557, 768), 200, FULL, 3.0, 3, 1e-4)
REDUCED_SIZE = Size(1.328, (140, 192), 50, REDUCED, 5.0, 1, 3e-4)


def write_bulge(out: Path | str, reduced: bool = False, noise: float | None = None, seed: int = 0,
                foreign: bool = False, thickness_um: float = 2.0, size: Size | None = None) -> Path:
    """Write the bulge test as an experiment folder with truth.json.

    Parameters
    ----------
    reduced : bool
        50 images of 192 x 140 px and a mesh of 96 elements instead of 200 of 768 x 557 px and 643 elements.
    noise : float, optional
        Standard deviation of the height noise / that of the roughness (1.5 um); default: none.
    foreign : bool
        The truth on another, finer mesh and with five increments per frame: the model is then not exact.
    thickness_um : float
        Of the membrane: 2 or 5.
    size : Size, optional
        In place of the two sizes that `reduced` chooses from.

    Returns
    -------
    Path
        The experiment.toml.

    Raises
    ------
    InputError
        For a folder that is not empty.
    """
    size = size or (REDUCED_SIZE if reduced else FULL_SIZE)
    folder = empty_folder(out)
    noise_rng = np.random.default_rng(seed).spawn(2)[1]
    std = RMS_UM * (noise or 0.0)
    clean = write_bulge_model(folder, size, seed, foreign, thickness_um, std)

    def images():
        for k in range(clean.n_frames):
            yield (clean.heights(k) + std * noise_rng.standard_normal(size.shape)).astype(np.float32)

    write_images(folder, images())
    return folder / "experiment.toml"


def write_bulge_model(folder: Path, size: Size, seed: int = 0, foreign: bool = False, thickness_um: float = 2.0,
                      std: float = 0.0) -> SectionImages:
    """Write everything of the experiment folder but its images; returns these, free of noise.

    std : noise that will be added to the images, um
    """
    pattern_rng = np.random.default_rng(seed).spawn(2)[0]
    user = bulge_test(thickness_um, size.columns, size.frames)
    mesh, u = _truth(user, thickness_um, foreign)
    column, row = (size.pixel_um * (np.arange(n) - 0.5 * (n - 1)) for n in size.shape[::-1])
    write_loads(folder, user.times, {PRESSURE_COLUMN: user.pressures})
    write_inp(user.mesh, folder / "mesh.inp", "bulge test, half the cross-section")
    total = float(np.hypot(std, size.floor_um))
    text = Template(TOML).substitute(
        origin=OTHER if foreign else SAME, pixel_size=f"{1e-3 * size.pixel_um:.6g}", column=0.5 * (size.shape[1] - 1),
        row=0.5 * (size.shape[0] - 1), noise=f"{total:.4g}", model=model_toml(), margin=size.margin_px)
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    write_truth(folder, TRUTH, total, added_noise_std_gv=std, height_unit="um", fixed=FIXED, contrast_gv=RMS_UM,
                thickness_um=thickness_um, same_mesh=not foreign, seed=seed)
    return SectionImages(mesh, "TOP", u, roughness(pattern_rng, RMS_UM, size.length_um), column, -row, 1e3)


def _truth(user: BulgeTest, thickness_um: float, foreign: bool) -> tuple[Mesh, np.ndarray]:
    """Mesh and displacements (n_frames, n_nodes, 2) mm that the images are rendered from."""
    if not foreign:
        return user.mesh, true_displacements(user)
    fine = np.linspace(0.0, 1.0, FOREIGN_STEPS * (len(user.times) - 1) + 1)
    fine_test = replace(user, mesh=bulge_mesh(1e-3 * thickness_um, FOREIGN, FOREIGN_LAYERS), times=fine
                        * user.times[-1],
                    pressures=fine * user.pressures[-1])
    return fine_test.mesh, true_displacements(fine_test)[::FOREIGN_STEPS]

