"""The example `polycarbonate`: a strip of a glassy polymer that necks, ten parameters from images and one force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from string import Template

import numpy as np

from idic.fe import Block, Mesh
from idic.images import Camera, sparse_speckle
from idic_studies.examples.polycarbonate_model import (
    FULL_MESH,
    REDUCED_MESH,
    TRUTH,
    Divisions,
    model_toml,
    pull,
    strip_mesh,
)
from idic.virtual_tests import LoggedColumn, Texture, VirtualTest, painted

TITLE = "Polycarbonate strip, necking"
FORCE_NOISE_N = 0.5  # N: a thousandth of the largest force
VISIBLE_LEFT_OF_MIDDLE_MM = 1.0  # mm that the image shows beyond the plane of symmetry
FOREIGN_MESH_REFINEMENT = 1.5  # the twin: so many times the divisions in the plane, and
FOREIGN_INCREMENTS_PER_STEP = 4  # so many increments for each of the model's
SAMPLES_PER_PIXEL_SIDE = 3  # a pixel gathers light over its area; 1: it takes the pattern's value in its middle

TOML = """\
# Tension of a polycarbonate strip that necks, as `idic example polycarbonate` writes it: 100 x 21 x 0.5 mm, a little
# narrower in its middle, pulled at 1e-3/s. By symmetry the model is half its length and half its thickness; the images
# show the middle of the strip. The truth is in truth.json.
# Try:  idic check experiment.toml,  then  idic identify experiment.toml --out run
$origin

[experiment]
title = "Polycarbonate strip, necking"
images = "images/*.tif"            # sorted naturally; the first is the reference
loads = "loads.csv"                # one row per image
mesh = "mesh.inp"
mesh_unit = "mm"
kind = "solid"
surface = "FRONT"                  # the faces that the camera sees

[camera]
pixel_size_mm = $pixel_size
origin_px = [$column, $row]        # the middle of the strip
axes = ["+col", "-row"]
noise_std_gv = $noise_std_gv

$model
[options]
substeps = $substeps               # increments per frame: the images were computed with these
"""
SAME = ("# The images were computed on this very mesh with these very increments, so nothing but the images' noise\n"
        "# and rounding stands between the model and the truth; a finer mesh or step moves the neck by several pixels.")
OTHER = ("# The images were computed on a finer mesh and with finer increments than the model has: a neck moves by\n"
         "# several pixels then. What that costs is in the residual and in the parameters.")


@dataclass(frozen=True)
class Size:
    """Pixel size (mm), image (rows, columns), frames after the reference, increments per frame, elements, dots (px).

    dot_px : sigma of a dot; finer ones are beyond the spline, coarser ones leave less contrast per pixel of motion.
    """

    pixel: float
    shape: tuple[int, int]
    frames: int
    substeps: int
    divisions: Divisions
    dot_px: float


FULL = Size(0.0931, (193, 420), 200, 1, FULL_MESH, 2.2)
REDUCED = Size(0.1862, (97, 210), 50, 2, REDUCED_MESH, 2.2)


def polycarbonate(reduced: bool = False, foreign: bool = False) -> VirtualTest:
    """The necking strip: 200 frames of 420 x 193 px, ten parameters and a force (reduced: 50 of 210 x 97)."""
    size = REDUCED if reduced else FULL
    return necking_strip(size, FOREIGN_MESH_REFINEMENT, FOREIGN_INCREMENTS_PER_STEP) if foreign else necking_strip(size)


def necking_strip(size: Size, finer: float = 1.0, steps: int = 1,
                  supersampling: int = SAMPLES_PER_PIXEL_SIDE) -> VirtualTest:
    """The same test at any size.

    finer : divisions of the truth's mesh in the plane over those of the model's; steps : increments over the model's;
    supersampling : samples per pixel and direction; above 1, pixels gather light over their area, as a camera's do.
    """
    foreign = (finer, steps) != (1.0, 1)
    mesh = strip_mesh(size.divisions)
    test = pull(mesh, size.frames, size.substeps)
    true_mesh, truth = mesh, test
    if foreign:
        true_mesh = strip_mesh(size.divisions.finer(finer))
        truth = pull(true_mesh, size.frames, size.substeps * steps)
    origin = (float(round(VISIBLE_LEFT_OF_MIDDLE_MM / size.pixel)), (size.shape[0] - 1) / 2)
    camera = Camera.from_table(pixel_size=size.pixel, origin=origin)
    toml = Template(TOML).safe_substitute(
        origin=OTHER if foreign else SAME, pixel_size=size.pixel, column=origin[0], row=origin[1],
        model=model_toml(FORCE_NOISE_N), substeps=size.substeps)
    nodes, cells, u = _both_halves(true_mesh, truth.u)
    return VirtualTest(
        title=TITLE, nodes=nodes, cells=cells, displacements=u, times=test.times,
        columns=(LoggedColumn("force_N", truth.force, FORCE_NOISE_N, exact_without_noise=True),
                 LoggedColumn("grip_displacement_mm", test.grip, 0.0)),
        camera=camera, shape=size.shape, texture=sprayed(camera, size), background=0.05, mesh=mesh,
        toml=toml, truth=TRUTH, default_noise=0.0, supersampling=supersampling,
        notes={"same_mesh": finer == 1.0, "increments_per_frame": size.substeps * steps})


def sprayed(camera: Camera, size: Size) -> Callable[[np.random.Generator, float], Texture]:
    """Sparse dark dots on bright paint: coarse, because a stretch of 1.7 thins out any pattern."""

    def make(rng: np.random.Generator, levels: float) -> Texture:
        pattern = sparse_speckle(rng, size.dot_px, 0.1 * levels, 0.86 * levels, 1.2 * max(size.shape))
        return painted(pattern, camera)

    return make


def _both_halves(mesh: Mesh, u: np.ndarray) -> tuple[np.ndarray, tuple[Block, ...], np.ndarray]:
    """In-plane nodes, visible faces and motion of the whole length: the camera sees across the plane of symmetry."""
    mirror = np.array([-1.0, 1.0])
    nodes = np.vstack([mesh.nodes[:, :2], mirror * mesh.nodes[:, :2]])
    (block,) = mesh.surface_cells("FRONT")
    mirrored_cells = block.connectivity[:, ::-1] + mesh.n_nodes  # mirrored cells run the other way round
    connectivity = np.vstack([block.connectivity, mirrored_cells])
    return (nodes, (Block(block.cell, np.ascontiguousarray(connectivity), 0),),
            np.concatenate([u[..., :2], mirror * u[..., :2]], axis=1))
