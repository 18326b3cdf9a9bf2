"""Small meshes of every visible cell, a texture that is known everywhere, and exact pictures of it."""

import numpy as np

from idic.correlation import PixelMap
from idic.fe import Block
from idic.images import Camera

SHAPE = (90, 130)


def grid(nx, ny, low=(0.0, 0.0), high=(5.0, 3.4), jitter=0.0, seed=0):
    """Nodes (n, 2) mm and counter-clockwise quads; interior nodes moved by up to `jitter`."""
    x, y = np.meshgrid(np.linspace(low[0], high[0], nx + 1), np.linspace(low[1], high[1], ny + 1))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    i = np.arange(nx * ny)
    first = i // nx * (nx + 1) + i % nx
    inside = ((nodes > low) & (nodes < high)).all(axis=1)
    nodes[inside] += np.random.default_rng(seed).uniform(-jitter, jitter, (inside.sum(), 2))
    return nodes, np.column_stack([first, first + 1, first + nx + 2, first + nx + 1])


def split(quads):
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def with_middles(nodes, cells, bend=0.0):
    """Quadratic cells: a node in the middle of every edge, moved by up to `bend`."""
    rng, number, points, rows = np.random.default_rng(1), {}, list(nodes), []
    for cell in cells:
        middles = []
        for one, two in zip(cell, np.roll(cell, -1)):
            key = (min(one, two), max(one, two))
            if key not in number:
                number[key] = len(points)
                points.append((nodes[one] + nodes[two]) / 2 + rng.uniform(-bend, bend, 2))
            middles.append(number[key])
        rows.append([*cell, *middles])
    return np.array(points), np.array(rows)


def make_mesh(kind, jitter=0.08, bend=0.03):
    """(nodes, blocks) of one cell, or of two blocks of different cells ("mixed", "mixed orders")."""
    nodes, quads = grid(6, 4, jitter=jitter)
    if kind == "mixed":
        return nodes, [Block("quad4", quads[:11], 0), Block("tri3", split(quads[11:]), 11)]
    if kind == "mixed orders":
        nodes, curved = with_middles(nodes, quads[:11])
        return nodes, [Block("tri3", split(quads[11:]), 0), Block("quad8", curved, 26)]
    cells = split(quads) if kind.startswith("tri") else quads
    if kind in ("tri6", "quad8"):
        nodes, cells = with_middles(nodes, cells, bend)
    return nodes, [Block(kind, cells, 0)]


def make_map(kind="quad4", mask=None, shape=SHAPE, camera=None, **distortion):
    nodes, blocks = make_mesh(kind, **distortion)
    camera = camera or Camera.from_table(0.05, (13.3, 77.6), rotation_deg=2.0)
    return PixelMap.of(nodes, blocks, camera, shape, mask)


class Texture:
    """A sum of waves: grey values at any point, so that deformed pictures need no interpolation."""

    def __init__(self, seed=0, shortest_px=6.0, longest_px=20.0, n=150, mean=128.0, std=40.0):
        rng = np.random.default_rng(seed)
        direction = rng.uniform(0, 2 * np.pi, n)
        size = 2 * np.pi / rng.uniform(shortest_px, longest_px, n)
        self.waves = np.column_stack([size * np.cos(direction), size * np.sin(direction)])
        self.phase = rng.uniform(0, 2 * np.pi, n)
        self.scale, self.mean = std * np.sqrt(2 / n), mean

    def __call__(self, points):
        return self.mean + self.scale * np.cos(points @ self.waves.T + self.phase).sum(axis=-1)

    def picture(self, shape=SHAPE, gradient=np.eye(2), shift=(0.0, 0.0), centre=(0.0, 0.0)):
        """The image after x -> centre + shift + gradient (x - centre), exact."""
        rows, columns = np.mgrid[: shape[0], : shape[1]]
        x = np.stack([columns, rows], axis=-1).astype(float)
        back = (x - np.asarray(centre) - np.asarray(shift)) @ np.linalg.inv(gradient).T + np.asarray(centre)
        return self(back.reshape(-1, 2)).reshape(shape)



def brightness_columns(f_image, pixel_map, patch, mean, valid):
    """Columns (-(f - mean), -1) of every patch  # patch (n_pixels,), mean (n_patches,) -> (n_pixels, 2 n_patches)"""
    columns = np.zeros((pixel_map.n_pixels, 2 * len(mean)))
    every = np.arange(pixel_map.n_pixels)
    columns[every, 2 * patch] = -(f_image[pixel_map.iy, pixel_map.ix] - mean[patch])
    columns[every, 2 * patch + 1] = -1.0
    return columns * valid[:, None]
