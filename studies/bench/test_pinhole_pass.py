"""Image pass of a camera with a lens over that of a telecentric camera, on the same image and mesh."""

import time

import numpy as np
import pytest

from idic.correlation import PinholeView, PixelMap, ReferenceImage, View, ViewKind, build_ray_map, nodal_equations
from idic.fe import make_mesh
from idic.images import Camera, PinholeCamera, PlacedCamera, prefilter, rotation_of
from idic.virtual_tests import Patch, mesh_patches

pytestmark = [pytest.mark.bench, pytest.mark.slow]

SHAPE = (1000, 2000)  # 2 Mpx
MAX_RATIO = 1.3       # the goal
REPEATS = 7


def test_a_pass_through_a_lens_costs_at_most_a_third_more():
    nodes, conn = mesh_patches([Patch(lambda s, t: (95.0 * s - 47.5, 45.0 * t - 22.5), 38, 18)], "quad8")
    mesh = make_mesh(nodes, [("quad8", conn)])
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, SHAPE).astype(float)
    flat = Camera.from_table(0.05, (999.5, 499.5))
    lens = PlacedCamera(PinholeCamera(6000.0, 6000.0, 999.5, 499.5, k1=-0.1,
                                      rotation=rotation_of([0.0, 12.0, 0.0]) @ np.diag([1.0, -1.0, -1.0]),
                                      translation_mm=[0.0, 0.0, 300.0]))
    views = {"telecentric": (View(ViewKind.GREY, flat), PixelMap.of(nodes, mesh.blocks, flat, SHAPE)),
             "lens": (PinholeView(lens, mesh), build_ray_map(mesh, mesh.surface_cells(), lens, SHAPE))}
    u, du, spline = 0.01 * nodes, rng.normal(size=(*nodes.shape, 3)), prefilter(image, 5)
    references = {name: ReferenceImage.of(pixels, image, 5) for name, (_, pixels) in views.items()}
    times = {name: [] for name in views}
    for _ in range(REPEATS):
        for name, (view, pixels) in views.items():
            start = time.process_time()
            share = nodal_equations(references[name], spline, view.motion(nodes, u))
            share.gram(view.columns(nodes, u, du))
            times[name].append((time.process_time() - start) / pixels.n_pixels)
    ratio = min(times["lens"]) / min(times["telecentric"])
    print(f"image pass per pixel through a lens: {ratio:.2f} of the telecentric one")
    assert ratio <= MAX_RATIO
