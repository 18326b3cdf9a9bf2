"""Meshes in the image, and pictures of a painted surface that moves exactly as their nodes say."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from idic.correlation import PixelMap, ReferenceImage
from idic.measure import Regularisation, build_smoother
from idic.fe import Mesh, make_mesh
from idic.images import ArrayStack, Camera, dense_speckle
from idic.model import Experiment, Model, Noise, Recording
from idic.parameters import ParameterSet
from idic.virtual_tests import Sensor, clean_image, painted

CAMERA = Camera.from_table(axes=("+col", "+row"))  # one "mm" is one px, rows count downwards


def grid(x0: float, y0: float, x1: float, y1: float, size: float, cell: str = "quad4") -> Mesh:
    """Even mesh of a rectangle of the image; quad4, tri3 or quad8."""
    nx, ny = round((x1 - x0) / size), round((y1 - y0) / size)
    step = 2 if cell == "quad8" else 1
    x, y = np.linspace(x0, x1, step * nx + 1), np.linspace(y0, y1, step * ny + 1)
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    width = len(x)
    c = (step * np.arange(ny)[:, None] * width + step * np.arange(nx)).ravel()
    if cell == "quad4":
        return make_mesh(nodes, [(cell, np.stack([c, c + 1, c + width + 1, c + width], axis=1))])
    if cell == "tri3":
        return make_mesh(nodes, [(cell, np.concatenate([np.stack([c, c + 1, c + width + 1], axis=1),
                                                        np.stack([c, c + width + 1, c + width], axis=1)]))])
    corner = [c, c + 2, c + 2 * width + 2, c + 2 * width]
    middle = [c + 1, c + width + 2, c + 2 * width + 1, c + width]
    conn = np.stack(corner + middle, axis=1)
    used = np.unique(conn)
    return make_mesh(nodes[used], [(cell, np.searchsorted(used, conn))])


def pictures(frame: tuple, motions, shape, noise: float = 0.0, seed: int = 1):
    """One float32 image per motion: the body is the mesh ``grid(*frame)`` and two rows of elements around it.

    motions : functions nodes (n, 2) -> displacement (n, 2) px; between nodes the displacement is that of the elements.
    """
    x0, y0, x1, y1, size, *cell = frame
    body = grid(x0 - 2 * size, y0 - 2 * size, x1 + 2 * size, y1 + 2 * size, size, *cell)
    rng = np.random.default_rng(seed)
    texture = painted(dense_speckle(np.random.default_rng(7), sigma_px=1.4, extent_px=600.0), CAMERA)
    sensor = Sensor(shape, bits=0, background=128.0, supersampling=2)
    return [(clean_image(motion(body.nodes), body.nodes, body.blocks, CAMERA, texture, sensor)
             + noise * rng.standard_normal(shape)).astype(np.float32) for motion in motions]


def rest(nodes: np.ndarray) -> np.ndarray:
    return np.zeros_like(nodes)


def wavy(nodes: np.ndarray, amplitude: float = 0.4, length: float = 150.0) -> np.ndarray:
    """A smooth displacement of some tenths of a pixel  # (n_nodes, 2)"""
    x, y = 2 * np.pi * nodes.T / length
    return amplitude * np.column_stack([np.sin(x + 0.3) * np.cos(0.7 * y) + 0.4, np.cos(0.8 * x) - 0.5 * np.sin(y)])


def set_up(mesh: Mesh, image, regularisation=Regularisation("none"), mask=None):
    """Reference and smoother."""
    pixel_map = PixelMap.of(mesh.nodes, mesh.blocks, CAMERA, image.shape, mask)
    return ReferenceImage.of(pixel_map, image), build_smoother(pixel_map.nodes_px, mesh.blocks, regularisation)


def experiment(mesh: Mesh, images, **changes) -> Experiment:
    """An experiment that has images, a mesh and a camera, and the fields of its records in `changes`."""
    n = len(images)
    model = Model("plane_stress", mesh, None, (), ParameterSet(()), (), (), (), CAMERA, np.arange(n, dtype=float))
    recording = Recording(ArrayStack(images), tuple(f"{k}" for k in range(n)), noise=Noise(None))
    of_model, of_recording = ({entry.name for entry in fields(record)} for record in (Model, Recording))
    return Experiment(
        "", "", replace(recording, **{name: changes.pop(name) for name in of_recording & set(changes)}),
        replace(model, **{name: changes.pop(name) for name in of_model & set(changes)}), **changes)
